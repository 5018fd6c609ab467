"""Mean of poses, and the fusion of poses that come with covariances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_place
from dqreg._records import one_line
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.rigid._matrices import from_matrix, to_matrix
from dqreg.rigid._mean import mean as mean_rotation
from dqreg.rigid._mean import shares
from dqreg.rigid._operands import as_rigid_poses
from dqreg.rigid.pose_covariance import MIN_EIGENVALUE, read_covariances
from dqreg.rigid.twist import adjoint, exp, left_jacobian_inverse, log

# Iterations at most, and the step at which they end: a few times rounding, in radians and in the translations' size.
_MAX_STEPS, _CONVERGED_STEP = 100, 1e-13
# The same for fused poses, in sigmas of the answer.
_STEP_SIGMAS = 1e-10
FAR_ORIGIN = (
    "About an origin far from the poses turns and shifts are one but for rounding: give covariances about a point near "
    "the poses, and that point as centre="
)


class PoseMean(NamedTuple):
    """Mean of poses and how sure it is.

    Covariances are (6, 6), rotation first, of left increments: ``T_true = exp(x) @ T_target_source``, about the origin
    of the target frame, or ``T_true = pose.about(exp(x), centre) @ T_target_source`` where a centre was given.

    Parameters
    ----------
    T_target_source : ndarray, (4, 4)
        The mean.
    covariance : ndarray, (6, 6)
        Covariance of the mean; NaN for a single pose without one.
    scatter : ndarray, (6, 6)
        Covariance of one pose, as the poses scatter about the mean; NaN for a single one.

    Examples
    --------
    >>> found = PoseMean(np.eye(4), np.eye(6), 4 * np.eye(6))
    >>> np.sqrt(found.covariance[3:, 3:].trace()).round(3).item()
    1.732
    """

    T_target_source: FloatArray
    covariance: FloatArray
    scatter: FloatArray

    def __repr__(self) -> str:
        return one_line(self)


def mean(
    T: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    covariances: ArrayLike | None = None,
    centre: ArrayLike | None = None,
) -> PoseMean:
    """Mean pose (Karcher): the one about which the twists add up to zero, ``sum w log(T_i mean^-1) = 0``.

    It does not depend on either frame: ``mean(A T B) = A mean(T) B``. With covariances it is the most likely pose of
    them all, as a filter fuses them (Barfoot and Furgale 2014).

    Parameters
    ----------
    T : array_like, (n, 4, 4)
        Rigid poses of one thing into one frame.
    weights : array_like, (n,), optional
        Weights, not negative; equal ones if not given.
    covariances : array_like, (n, 6, 6), optional
        Covariance of each pose, of left increments about ``centre``, in place of weights.
    centre : array_like, (3,), optional
        Point of the target frame that the increments turn about, those of ``covariances`` and of the answer:
        ``T_true = pose.about(exp(x), centre) @ T``. Default: the frame's origin. Give a point near the poses where
        these lie far away, as in UTM coordinates; for covariances of registrations to one target it is their
        ``settings["centre"]``.

    Returns
    -------
    PoseMean
        ``T_target_source``, its ``covariance`` and the ``scatter`` of the poses. Without covariances the first follows
        from the second: divided by n for equal weights.

    Raises
    ------
    InputError
        If there are no poses, one is not rigid, a weight negative, a covariance not positive (as those about a far
        origin are, by rounding), or both are given.
    DegenerateGeometryError
        If the rotations lie too far apart to have a mean.

    Examples
    --------
    >>> found = mean(exp([[0, 0, 0.1, 1, 0, 0], [0, 0, 0.3, 3, 0, 0]]))
    >>> log(found.T_target_source).round(3)[2].item(), found.covariance[2, 2].round(3).item()
    (0.2, 0.01)
    """
    poses = as_rigid_poses(T, "T")
    if poses.ndim != 3 or not len(poses):
        raise InputError(f"T must hold at least one pose, (n, 4, 4); got shape {poses.shape}")
    if weights is not None and covariances is not None:
        raise InputError("give weights or covariances, not both: a covariance is a weight")
    c = np.zeros(3) if centre is None else as_place(centre, "centre")
    w = shares(weights, len(poses))
    if w.ndim != 1:
        raise InputError(f"weights must be {len(poses)} numbers; got shape {w.shape}")
    found, twists = _karcher(poses, w)
    about = adjoint(_less(found, c))
    # Weights are shares, so this is the sample covariance with n - 1 where all are equal.
    rest = 1.0 - np.sum(w * w)
    scatter = (
        about @ np.einsum("n,ni,nj->ij", w, twists, twists) @ about.T / rest if rest > 0.0 else np.full((6, 6), np.nan)
    )
    if covariances is None:
        return PoseMean(found, scatter * np.sum(w * w), scatter)
    # About the centre the poses are near zero, and turns carry no far lever.
    fused, covariance = _fused(_less(poses, c), _less(found, c), _as_information(covariances, len(poses)))
    fused[:3, 3] += c
    return PoseMean(fused, covariance, scatter)


def _karcher(poses: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean, and the twists to each pose in the mean's own frame, where far origins cost no digits."""
    T = np.eye(4)
    T[:3, :3] = to_matrix(mean_rotation(from_matrix(poses[:, :3, :3]), w))
    T[:3, 3] = w @ poses[:, :3, 3]
    back = np.eye(4)
    for _ in range(_MAX_STEPS):
        back[:3, :3] = T[:3, :3].T
        back[:3, 3] = -T[:3, :3].T @ T[:3, 3]
        twists = log(back @ poses)
        step = w @ twists
        length = np.abs(twists[:, 3:]).max() + np.abs(T[:3, 3]).max()
        if np.abs(step[:3]).max() <= _CONVERGED_STEP and np.abs(step[3:]).max() <= _CONVERGED_STEP * length:
            return T, twists
        T = T @ exp(step)
    raise DegenerateGeometryError("the rotations lie too far apart to have a mean pose. Use fewer, nearer ones")


def _fused(poses: FloatArray, T: FloatArray, information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Most likely pose and its covariance, by Gauss-Newton on left increments."""
    back = np.stack([_inverse(each) for each in poses])
    for _ in range(_MAX_STEPS):
        residuals = log(T @ back)
        J = left_jacobian_inverse(residuals)
        JI = np.swapaxes(J, -1, -2) @ information
        normal = np.sum(JI @ J, axis=0)
        step = -_inverse_of(normal) @ np.einsum("nij,nj->i", JI, residuals)
        T = exp(step) @ T
        if step @ normal @ step <= _STEP_SIGMAS**2:
            break
    return T, _inverse_of(normal)


def _less(T: FloatArray, centre: FloatArray) -> FloatArray:
    """Poses with their translations less the centre. Shapes: T (..., 4, 4)."""
    near = T.copy()
    near[..., :3, 3] -= centre
    return near


def _inverse(T: FloatArray) -> FloatArray:
    back = np.eye(4)
    back[:3, :3], back[:3, 3] = T[:3, :3].T, -T[:3, :3].T @ T[:3, 3]
    return back


def _as_information(covariances: ArrayLike, count: int) -> FloatArray:
    C = read_covariances(covariances, "covariances", count, FAR_ORIGIN)
    known = np.isfinite(np.diagonal(C, axis1=-2, axis2=-1))
    if known.all():
        return _inverse_of(C)
    return np.asarray(_inverse_of(np.where(np.isinf(C), 1.0, C)) * known[:, :, None] * known[:, None, :])


def _inverse_of(C: FloatArray) -> FloatArray:
    """Inverses, (..., 6, 6), in units of the standard deviations: radians and metres lie far apart."""
    variances = np.diagonal(C, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    values, vectors = np.linalg.eigh(C / size[..., :, None] / size[..., None, :])
    if not (variances > 0.0).all() or not (values > MIN_EIGENVALUE).all():
        raise InputError(
            f"covariances must leave no motion unknown to all; the smallest variance is {variances.min():.3g}, and the "
            f"smallest eigenvalue of correlations {values.min():.3g}, where more than {MIN_EIGENVALUE:g} is no "
            f"rounding. {FAR_ORIGIN}"
        )
    half = vectors / np.sqrt(values)[..., None, :] / size[..., :, None]
    return np.asarray(half @ np.swapaxes(half, -1, -2))
