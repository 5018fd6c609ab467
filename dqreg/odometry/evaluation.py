"""Trajectory against truth: relative errors, KISS-ICP's metrics, drift, and whether the covariances keep their word."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float
from dqreg._rotations import nearest_rotation
from dqreg.errors import InputError, warn_of_old_name
from dqreg.files.trajectories import found_rows
from dqreg.odometry.kiss import load_kiss
from dqreg.odometry.trajectory import bridge_gaps
from dqreg.rigid import pose, twist
from dqreg.rigid.single_pose import orthonormal
from dqreg.rigid.twist import scaling_by

# A single step worse than this is a lost frame, whatever the scene: half the everyday lattice, which finds its way.
LOST_DEG = 5.0
# 97.5 % of chi-square with six degrees of freedom lie below.
CHI2_HIGH = 14.4494


@dataclasses.dataclass(frozen=True)
class Errors:
    """Errors of a trajectory.

    Attributes
    ----------
    steps : dict of int to tuple of ndarray
        For each number of frames: errors of the relative poses over that many frames, (n,) each, degrees and lengths.
    lost : int
        Frames without a pose, and steps more than 5 degrees off.
    absolute_rmse : float
        Root mean square distance of the places, after the best rigid alignment of both trajectories.
    kiss_ate : tuple of 2 floats
        KISS-ICP's absolute trajectory error: rotation in rad, translation.
    kiss_segments : tuple of 2 floats
        KISS-ICP's (KITTI's) mean error over 100 to 800 units of path: per cent, degrees a unit; NaN on shorter paths.
    """

    steps: dict[int, tuple[FloatArray, FloatArray]]
    lost: int
    absolute_rmse: float
    kiss_ate: tuple[float, float]
    kiss_segments: tuple[float, float]

    @property
    def evo_ape_rmse(self) -> float:
        """The old name of ``absolute_rmse``."""
        warn_of_old_name("evo_ape_rmse", "absolute_rmse")
        return self.absolute_rmse


def evaluate(poses: Any, truth: Any, steps: tuple[int, ...] = (1, 10)) -> Errors:
    """Compare a trajectory with the truth, frame by frame.

    Parameters
    ----------
    poses : array_like, (n, 4, 4)
        Estimated poses in any frame; NaN where none was found (bridged here, and counted as lost).
    truth : array_like, (n, 4, 4)
        True poses in any frame.
    steps : tuple of int
        Numbers of frames over which relative poses are compared.

    Returns
    -------
    Errors
        Arrays are empty where the trajectory is shorter than a step.

    Raises
    ------
    InputError
        If the shapes differ or nothing was found.

    Examples
    --------
    >>> path = np.stack([pose.from_parts(np.eye(3), [i, 0, 0]) for i in range(12)])
    >>> float(evaluate(path, path).absolute_rmse)
    0.0
    """
    raw, true = as_float(poses, "poses"), as_float(truth, "truth")
    if raw.shape != true.shape or raw.shape[1:] != (4, 4):
        raise InputError(f"poses and truth must both be (n, 4, 4); got {raw.shape} and {true.shape}")
    estimated, missing = bridge_gaps(raw)
    estimated, true = (np.stack([orthonormal(T) for T in rows]) for rows in (estimated, true))
    relative = {k: relative_errors(estimated, true, k) for k in steps}
    off = relative_errors(estimated, true, 1)[0] > LOST_DEG
    metrics = load_kiss("metrics")
    segments = tuple(map(float, metrics.sequence_error(list(true), list(estimated))))
    kiss_ate = tuple(map(float, metrics.absolute_trajectory_error(list(true), list(estimated))))
    return Errors(
        steps=relative,
        lost=len(missing) + int(np.count_nonzero(off & ~np.isin(np.arange(1, len(true)), missing))),
        absolute_rmse=_aligned_rmse(estimated[:, :3, 3], true[:, :3, 3]),
        kiss_ate=(kiss_ate[0], kiss_ate[1]),
        kiss_segments=(segments[0], segments[1]) if _path(true) > 100.0 else (np.nan, np.nan),
    )


def relative_errors(poses: FloatArray, truth: FloatArray, step: int) -> tuple[FloatArray, FloatArray]:
    """Errors of the motions over a number of frames. Shapes: poses, truth (n, 4, 4), turn_deg, shift (n - step, 0)."""
    left = pose.inverse(pose.inverse(truth[:-step]) @ truth[step:]) @ (pose.inverse(poses[:-step]) @ poses[step:])
    if not len(left):
        return np.zeros(0), np.zeros(0)
    return np.rad2deg(pose.angle_between(np.eye(4), left)), np.linalg.norm(left[:, :3, 3], axis=1)


def nees(
    poses: Any, covariances: Any, truth: Any, truth_sigma_deg: float = 0.0, truth_sigma: float = 0.0
) -> FloatArray:
    """Normalised squared error of each step: six on average where the covariances keep their word.

    Of two neighbouring frames the errors are taken as independent: their covariances about their sensors are carried to
    the later sensor and added.

    Parameters
    ----------
    poses : array_like, (n, 4, 4)
        Estimated poses T_map_frame; NaN where none was found.
    covariances : array_like, (n, 6, 6)
        Of each pose, as results of `Odometry` have them.
    truth : array_like, (n, 4, 4)
        True poses in any frame.
    truth_sigma_deg, truth_sigma : float
        Standard deviations of a true step: of its rotation, degrees, and of its translation.

    Returns
    -------
    ndarray, (n - 1,)
        NaN where a frame of the step has no pose or no covariance.

    Raises
    ------
    InputError
        If the shapes do not belong together.

    Examples
    --------
    >>> truth = np.stack([pose.from_parts(np.eye(3), [i, 0, 0]) for i in range(3)])
    >>> path = truth.copy()
    >>> path[2, 0, 3] += 0.3
    >>> nees(path, np.stack([0.01 * np.eye(6)] * 3), truth)
    array([0. , 4.5])
    """
    P, C, G = (as_float(v, n) for v, n in ((poses, "poses"), (covariances, "covariances"), (truth, "truth")))
    if P.shape[1:] != (4, 4) or G.shape != P.shape or C.shape != (len(P), 6, 6):
        raise InputError(
            "poses and truth must be (n, 4, 4), and covariances (n, 6, 6), one of each a frame; got "
            f"{P.shape}, {G.shape} and {C.shape}"
        )
    values = np.full(max(len(P) - 1, 0), np.nan)
    noise = np.diag(scaling_by(np.deg2rad(truth_sigma_deg) ** 2, truth_sigma**2))
    usable = found_rows(P) & np.isfinite(C).all(axis=(1, 2))
    for i in np.flatnonzero(usable[1:] & usable[:-1]):
        step, true = (pose.inverse(orthonormal(T[i])) @ orthonormal(T[i + 1]) for T in (P, G))
        error = twist.log(orthonormal(step @ pose.inverse(true)))
        # Increments about a sensor, turned from the map's axes to the sensor's own.
        R_before, R = P[i, :3, :3], P[i + 1, :3, :3]
        before, after = (np.kron(np.eye(2), r.T) for r in (R_before, R))
        # A left increment about the later sensor, seen from the earlier one: its axes, and its place.
        carry = twist.adjoint(step) @ after
        total = (
            before @ C[i] @ before.T + carry @ C[i + 1] @ carry.T + twist.adjoint(step) @ noise @ twist.adjoint(step).T
        )
        values[i] = error @ np.linalg.pinv(total, hermitian=True) @ error
    return values


def _aligned_rmse(places: FloatArray, truth: FloatArray) -> float:
    a, b = places - places.mean(axis=0), truth - truth.mean(axis=0)
    turn = nearest_rotation(a.T @ b)
    return float(np.sqrt(np.mean(np.sum((a @ turn - b) ** 2, axis=1))))


def _path(truth: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum())
