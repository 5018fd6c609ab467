"""Trajectories on disk: KITTI (twelve numbers a line), TUM (time, position, quaternion x y z w) and g2o (written)."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.files.untrusted import read_record
from dqreg.rigid import Trajectory, quaternion

FORMATS = ("kitti", "tum", "g2o")
# Rows and columns of a 6x6 matrix with the translation first; what is written of a motion of which nothing is known.
SHIFT_FIRST, UNKNOWN = np.r_[3:6, 0:3], 1e-9


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory in KITTI's or TUM's format; the number of columns tells which.

    Parameters
    ----------
    path : str or Path
        KITTI (12 or 16 numbers a line) or TUM (8).

    Returns
    -------
    Trajectory
        KITTI has no times: the numbers of the lines, from 0, stand in.

    Raises
    ------
    InputError
        If the file is missing or holds something else, or TUM's times do not increase.
    """
    poses, times = read_poses(path)
    try:
        return Trajectory(np.arange(float(len(poses))) if times is None else times, poses)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def form_of(path: str | Path, form: str | None) -> str:
    """Format that was asked for, or that the name of a file stands for."""
    path = Path(path)
    by_name = (
        "tum" if path.suffix == ".tum" or path.stem.endswith("_tum") else "g2o" if path.suffix == ".g2o" else "kitti"
    )
    form = form or by_name
    if form not in FORMATS:
        raise InputError(f"unknown trajectory format {form!r}; known are {', '.join(FORMATS)}")
    return form


def text_of(poses: FloatArray, times: FloatArray, form: str) -> str:
    """Lines of a file. Shapes: poses (n, 4, 4), times (n,)."""
    if form == "kitti":
        lines = [" ".join(map(repr, row.ravel().tolist())) for row in poses[:, :3]]
    else:
        lines = [_tum_line(time, T) for time, T in zip(times, poses, strict=True)]
    return "\n".join(lines) + "\n"


def graph_of(numbers: IntArray, poses: FloatArray, covariances: FloatArray | None) -> str:
    """The placed frames and the steps between them as a g2o file, as GTSAM and Ceres' examples read it.

    Covariances are of left increments about the sensors in the map's axes, rotation first; a step is as uncertain as
    the later frame is in the map. Shapes: numbers (n,), poses (n, 4, 4), covariances (n, 6, 6).
    """
    lines = [f"VERTEX_SE3:QUAT {k} {_place(T)}" for k, T in zip(numbers, poses, strict=True)]
    lines.append(f"FIX {numbers[0]}")
    for k in range(1, len(poses)):
        step = np.linalg.inv(poses[k - 1]) @ poses[k]
        information = np.eye(6) if covariances is None else _information(poses[k, :3, :3], covariances[k])
        upper = " ".join(map(repr, information[np.triu_indices(6)].tolist()))
        lines.append(f"EDGE_SE3:QUAT {numbers[k - 1]} {numbers[k]} {_place(step)} {upper}")
    return "\n".join(lines) + "\n"


def _information(R: FloatArray, covariance: FloatArray) -> FloatArray:
    """Information of a right increment in the sensor's axes, translation first."""
    if not np.isfinite(covariance).all() or not covariance.any():
        return UNKNOWN * np.eye(6)
    axes = np.kron(np.eye(2), R)
    found = np.asarray(np.linalg.pinv(axes.T @ covariance @ axes, hermitian=True), dtype=np.float64)
    shifted: FloatArray = found[np.ix_(SHIFT_FIRST, SHIFT_FIRST)]
    return shifted


def _place(T: FloatArray) -> str:
    w, x, y, z = quaternion.from_matrix(T[:3, :3]).tolist()
    return " ".join(map(repr, [*T[:3, 3].tolist(), x, y, z, w]))


def _tum_line(time: float, T: FloatArray) -> str:
    return f"{time:.9f} {_place(T)}"


def read_poses(path: str | Path) -> tuple[FloatArray, FloatArray | None]:
    """Poses of a file, rigid to the last digit, and its times; None for KITTI. Shapes: poses (n, 4, 4), times (n,)."""
    lines = read_record(path, "a trajectory").splitlines()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of a file without rows
            rows = np.loadtxt(lines, ndmin=2)
    except (ValueError, UserWarning) as error:
        raise InputError(f"cannot read the trajectory {path}: {error}") from error
    if not rows.size or rows.shape[1] not in (8, 12, 16) or not np.isfinite(rows).all():
        raise InputError(
            f"{path} is no trajectory: lines of {rows.shape[1]} numbers; expected finite numbers, 12 (KITTI) or 8 (TUM)"
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    times = None
    if rows.shape[1] == 8:
        times, w_first = rows[:, 0], rows[:, [7, 4, 5, 6]]
        with np.errstate(over="ignore"):
            length = np.linalg.norm(w_first, axis=1, keepdims=True)
        if not ((length > 0.5) & (length < 1e3)).all():
            worst = float(length[np.argmax(np.abs(length - 1.0))][0])
            raise InputError(f"{path}: a quaternion of length {worst:.3g}; expected unit quaternions x y z w")
        poses[:, :3, :3], poses[:, :3, 3] = quaternion.to_matrix(w_first / length), rows[:, 1:4]
    else:
        poses[:, :3] = rows.reshape(len(rows), -1, 4)[:, :3]
    # What overflows is no rotation.
    with np.errstate(over="ignore", invalid="ignore"):
        gap = np.abs(poses[:, :3, :3].transpose(0, 2, 1) @ poses[:, :3, :3] - np.eye(3)).max()
    if not gap <= 1e-2 or not (np.linalg.det(poses[:, :3, :3]) > 0.0).all():
        raise InputError(f"{path}: a rotation block departs from a rotation by {gap:.3g}; expected rigid poses")
    U, _, Vt = np.linalg.svd(poses[:, :3, :3])
    poses[:, :3, :3] = U @ Vt
    return poses, times
