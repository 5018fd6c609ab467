"""Fast helpers on 4x4 poses ``T_target_source``: p_target = R p_source + t.

They run inside loops and trust that a pose is rigid; ``dqreg._arrays.as_pose`` is the check at the door.
Nothing here changes its arguments, and read-only or strided arrays are taken as they are. A pose of NaN gives
points of NaN. Arrays of a wrong shape raise `InputError`, as does a rotation block that is no rotation in `log`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError, MissingDependencyError
from dqreg.rigid._algebra import normalize
from dqreg.rigid._matrices import to_matrix
from dqreg.rigid._operands import as_poses, as_rigid_poses, as_triples
from dqreg.rigid._pose_action import apply, move_lines, move_planes, rotate
from dqreg.rigid.pose_mean import PoseMean, mean
from dqreg.rigid.twist import adjoint, exp, left_jacobian, left_jacobian_inverse, log

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

__all__ = [
    "PoseMean",
    "about",
    "adjoint",
    "angle_between",
    "apply",
    "exp",
    "from_parts",
    "inverse",
    "left_jacobian",
    "left_jacobian_inverse",
    "log",
    "mean",
    "move_lines",
    "move_planes",
    "offset_between",
    "random",
    "rotate",
    "to_rigid_transform",
]


def from_parts(R: ArrayLike, t: ArrayLike) -> FloatArray:
    """Pose of a rotation matrix and a translation (Walker eq. 1).

    Parameters
    ----------
    R : array_like, (..., 3, 3)
        Rotation matrices.
    t : array_like, (..., 3)
        Translations.

    Returns
    -------
    ndarray, (..., 4, 4)
        Poses.

    Raises
    ------
    InputError
        If R is not (..., 3, 3), or t not (..., 3). That R is a rotation is not checked.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> from_parts(np.eye(3), [1, 2, 3])[:3].tolist()
    [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]]
    """
    rotation, translation = as_float(R, "R"), as_triples(t, "t")
    if rotation.shape[-2:] != (3, 3):
        raise InputError(f"R must hold 3x3 matrices in the last two axes; got shape {rotation.shape}")
    T = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = translation
    T[..., 3, 3] = 1.0
    return T


def to_rigid_transform(T_target_source: ArrayLike) -> RigidTransform:
    """Write poses as SciPy's class. The way back is not needed: every function takes one where it takes a pose.

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.

    Returns
    -------
    scipy.spatial.transform.RigidTransform
        The same motions.

    Raises
    ------
    MissingDependencyError
        If SciPy is older than 1.16.
    """
    from scipy.spatial import transform

    if not hasattr(transform, "RigidTransform"):
        raise MissingDependencyError("RigidTransform came with SciPy 1.16; pip install 'scipy>=1.16'")
    return transform.RigidTransform.from_matrix(as_rigid_poses(T_target_source, "T_target_source"))


def inverse(T_target_source: ArrayLike) -> FloatArray:
    """Inverse pose in closed form: ``R^T``, ``-R^T t``.

    Parameters
    ----------
    T_target_source : array_like, (..., 4, 4)
        Rigid poses.

    Returns
    -------
    ndarray, (..., 4, 4)
        T_source_target.

    Raises
    ------
    InputError
        If T_target_source is not (..., 4, 4) or (..., 3, 4). That it is rigid is not checked.

    Examples
    --------
    >>> inverse(from_parts(np.eye(3), [1, 2, 3]))[:3, 3].tolist()
    [-1.0, -2.0, -3.0]
    """
    T = as_poses(T_target_source, "T_target_source")
    R_back = np.swapaxes(T[..., :3, :3], -1, -2)
    return from_parts(R_back, -(R_back @ T[..., :3, 3, np.newaxis])[..., 0])


def angle_between(T_a: ArrayLike, T_b: ArrayLike) -> FloatArray:
    """Angle of the rotation that leads from one pose to the other.

    By atan2 of the skew part and the trace, so that small angles and angles near pi keep their digits; the
    arc cosine of the trace cannot tell 1e-9 from 0.

    Parameters
    ----------
    T_a, T_b : array_like, (..., 4, 4)
        Rigid poses into the same frame.

    Returns
    -------
    ndarray, (...)
        Radians in [0, pi]; a single number for two single poses.

    Raises
    ------
    InputError
        If T_a or T_b is not (..., 4, 4) or (..., 3, 4).
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> round(float(angle_between(np.eye(4), exp([0, 0, 0.25, 7, 8, 9]))), 12)
    0.25
    """
    R_a, R_b = as_poses(T_a, "T_a")[..., :3, :3], as_poses(T_b, "T_b")[..., :3, :3]
    R = np.swapaxes(R_a, -1, -2) @ R_b
    skew = R - np.swapaxes(R, -1, -2)
    # Every 2 sin(angle) u_i stands twice in the skew matrix, hence the root of two.
    twice_sine = np.linalg.norm(skew, axis=(-2, -1)) / np.sqrt(2.0)
    return np.asarray(np.arctan2(twice_sine, np.trace(R, axis1=-2, axis2=-1) - 1.0))


def offset_between(T_a: ArrayLike, T_b: ArrayLike, at: ArrayLike | None = None) -> FloatArray:
    """Distance between where the two poses put the same point.

    Parameters
    ----------
    T_a, T_b : array_like, (..., 4, 4)
        Rigid poses into the same frame.
    at : array_like, (..., 3), optional
        Source point or points to compare at; the source origin if not given. Where parts lie far from their
        origin, compare at the part: there the answer means something.

    Returns
    -------
    ndarray, (...)
        Distances in the unit of the poses.

    Raises
    ------
    InputError
        If T_a or T_b is not (..., 4, 4) or (..., 3, 4), or the points not (..., 3).
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> round(float(offset_between(np.eye(4), exp([0, 0, np.pi, 0, 0, 0]), at=[1, 0, 0])), 12)
    2.0
    """
    # The difference of the poses is formed first: two far points would cancel digits.
    difference = as_poses(T_a, "T_a") - as_poses(T_b, "T_b")
    apart = difference[..., :3, 3]
    if at is not None:
        apart = apart + (difference[..., :3, :3] @ as_triples(at, "at")[..., np.newaxis])[..., 0]
    return np.asarray(np.linalg.norm(apart, axis=-1))


def about(T: ArrayLike, centre: ArrayLike) -> FloatArray:
    """Carry out the motion T about a given centre instead of the origin: ``R (p - centre) + centre + t``.

    Parameters
    ----------
    T : array_like, (..., 4, 4)
        Rigid poses.
    centre : array_like, (..., 3)
        Point that the rotation leaves in place.

    Returns
    -------
    ndarray, (..., 4, 4)
        Poses.

    Raises
    ------
    InputError
        If T is not (..., 4, 4) or (..., 3, 4), or the centre not (..., 3).
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> apply(about(exp([0, 0, np.pi, 0, 0, 0]), [1, 0, 0]), [[1, 0, 0], [3, 0, 0]]).round(12).tolist()
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    """
    poses, c = as_poses(T, "T"), as_triples(centre, "centre")
    R = poses[..., :3, :3]
    return from_parts(R, poses[..., :3, 3] + c - (R @ c[..., np.newaxis])[..., 0])


def random(rng: np.random.Generator, *, reach: float = 0.0, shape: tuple[int, ...] = ()) -> FloatArray:
    """Poses drawn uniformly: all rotations alike, translations alike within a ball.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    reach : float
        Radius of the ball, in the unit of the translation; 0 draws rotations only.
    shape : tuple of int
        Leading axes; none for a single pose.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rigid poses.

    Examples
    --------
    >>> random(np.random.default_rng(0), reach=10.0, shape=(5,)).shape
    (5, 4, 4)
    """
    R = to_matrix(normalize(rng.standard_normal((*shape, 4))))
    direction = rng.standard_normal((*shape, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    # The cube root makes equal volumes equally likely.
    return from_parts(R, reach * np.cbrt(rng.uniform(size=(*shape, 1))) * direction)
