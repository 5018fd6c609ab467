"""Exponential and logarithm of SE(3): six numbers (rotation vector, translation part) to a 4x4 pose and back.

A twist is a left increment, ``T = exp(twist) @ T0``. Its first three numbers are the rotation vector w (axis
times angle), its last three the velocity part v of the screw motion; the translation of ``exp(twist)`` is
``left_jacobian(w) @ v``, which is v itself only where w is zero or along v.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid._algebra import cross_matrix
from dqreg.rigid._matrices import from_matrix
from dqreg.rigid._operands import as_poses
from dqreg.rigid._powers import log as quaternion_log
from dqreg.rigid.rotations import from_rotation_vector, left_jacobian, left_jacobian_inverse


def exp(twist: ArrayLike) -> FloatArray:
    """Pose of a screw motion.

    Parameters
    ----------
    twist : array_like, (..., 6)
        Rotation vector in radians, then translation part.

    Returns
    -------
    ndarray, (..., 4, 4)
        Rotation ``I + sin(a)/a [w x] + (1 - cos(a))/a^2 [w x]^2`` with ``a = |w|``, translation
        ``left_jacobian(w) @ v``.

    Examples
    --------
    >>> exp([0, 0, np.pi / 2, 1, 2, 3]).round(6)[:3, 3].tolist()
    [-0.63662, 1.909859, 3.0]
    """
    w, v = _halves(twist)
    T = np.zeros((*w.shape[:-1], 4, 4))
    T[..., :3, :3] = from_rotation_vector(w)
    T[..., :3, 3] = _times(left_jacobian(w), v)
    T[..., 3, 3] = 1.0
    return T


def log(T: ArrayLike) -> FloatArray:
    """Twist of a pose: the inverse of `exp`, with a rotation of at most pi.

    Parameters
    ----------
    T : array_like, (..., 4, 4)
        Rigid poses.

    Returns
    -------
    ndarray, (..., 6)
        Rotation vector in radians, then translation part. Of the two twists of a half-turn: the one whose
        rotation vector has a positive first non-zero component.

    Examples
    --------
    >>> log(exp([0.1, 0.2, 0.3, 4, 5, 6])).round(12).tolist()
    [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
    """
    poses = as_poses(T, "T")
    w = 2.0 * quaternion_log(from_matrix(poses[..., :3, :3]))[..., 1:]
    return np.concatenate([w, _times(left_jacobian_inverse(w), poses[..., :3, 3])], axis=-1)


def adjoint(T: ArrayLike) -> FloatArray:
    """Matrix that carries twists through a pose: ``exp(adjoint(T) @ twist) = T @ exp(twist) @ inverse(T)``.

    It moves a covariance of left increments to another frame: ``A @ covariance @ A.T``.

    Parameters
    ----------
    T : array_like, (..., 4, 4)
        Rigid poses.

    Returns
    -------
    ndarray, (..., 6, 6)
        ``[[R, 0], [[t x] R, R]]``.

    Examples
    --------
    >>> adjoint(exp([0, 0, 0, 1, 0, 0]))[3:, :3].tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    """
    poses = as_poses(T, "T")
    R = poses[..., :3, :3]
    matrix = np.zeros((*poses.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = R
    matrix[..., 3:, :3] = cross_matrix(poses[..., :3, 3]) @ R
    return matrix


def _halves(twist: ArrayLike) -> tuple[FloatArray, FloatArray]:
    array = as_float(twist, "twist")
    if array.shape[-1:] != (6,):
        raise InputError(f"twist must hold rotation vector and translation part, six numbers; got shape {array.shape}")
    return array[..., :3], array[..., 3:]


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., np.newaxis])[..., 0])
