"""Exponential and logarithm of SE(3): six numbers (rotation vector, translation part) to a 4x4 pose and back.

A twist is a left increment, ``T = exp(twist) @ T0``. Its first three numbers are the rotation vector w (axis
times angle), its last three the velocity part v of the screw motion; the translation of ``exp(twist)`` is
``left_jacobian(w) @ v``, which is v itself only where w is zero or along v.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.rigid.operands import as_poses, as_triples
from dqreg.rigid.quaternion_algebra import cross_matrix
from dqreg.rigid.quaternion_matrices import from_matrix
from dqreg.rigid.quaternion_powers import log as quaternion_log

# Below this angle the Taylor series, cut after four terms, is exact to rounding and the closed form is not.
_SERIES_RAD = 0.1


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

    Raises
    ------
    InputError
        If the last axis does not hold six numbers.

    Examples
    --------
    >>> exp([0, 0, np.pi / 2, 1, 2, 3]).round(6)[:3, 3].tolist()
    [-0.63662, 1.909859, 3.0]
    """
    w, v = _halves(twist)
    angle_rad, skew, square = _cross_powers(w)
    T = np.zeros((*w.shape[:-1], 4, 4))
    T[..., :3, :3] = np.eye(3) + np.sinc(angle_rad / np.pi) * skew + _versine_ratio(angle_rad) * square
    T[..., :3, 3] = _times(left_jacobian(w), v)
    T[..., 3, 3] = 1.0
    return T


def log(T: ArrayLike) -> FloatArray:
    """Twist of a pose: the inverse of `exp`, with a turn of at most pi.

    Parameters
    ----------
    T : array_like, (..., 4, 4)
        Rigid poses.

    Returns
    -------
    ndarray, (..., 6)
        Rotation vector in radians, then translation part. Of the two twists of a half-turn: the one whose
        rotation vector has a positive first non-zero component.

    Raises
    ------
    InputError
        If a pose is not 4x4 or its rotation block is not a rotation.

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

    Raises
    ------
    InputError
        If a pose is not 4x4.

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


def left_jacobian(w: ArrayLike) -> FloatArray:
    """Matrix J of ``exp(w + dw) = exp(J dw) exp(w)`` to first order, for rotation vectors.

    Shapes: w (..., 3), returns (..., 3, 3).
    """
    angle_rad, skew, square = _cross_powers(as_triples(w, "w"))
    a2 = angle_rad**2
    series = 1 / 6 - a2 / 120 * (1 - a2 / 42 * (1 - a2 / 72))
    large = np.where(angle_rad < _SERIES_RAD, 1.0, angle_rad)
    closed = (large - np.sin(large)) / large**3
    return np.asarray(
        np.eye(3) + _versine_ratio(angle_rad) * skew + np.where(angle_rad < _SERIES_RAD, series, closed) * square
    )


def left_jacobian_inverse(w: ArrayLike) -> FloatArray:
    """Inverse of `left_jacobian`.

    Shapes: w (..., 3), returns (..., 3, 3).
    """
    angle_rad, skew, square = _cross_powers(as_triples(w, "w"))
    a2 = angle_rad**2
    series = 1 / 12 + a2 / 720 * (1 + a2 / 42 * (1 + a2 / 40))
    large = np.where(angle_rad < _SERIES_RAD, 1.0, angle_rad)
    closed = (1.0 - large / 2 / np.tan(large / 2)) / large**2
    ratio = np.where(angle_rad < _SERIES_RAD, series, closed)
    return np.asarray(np.eye(3) - skew / 2 + ratio * square)


def _halves(twist: ArrayLike) -> tuple[FloatArray, FloatArray]:
    array = np.asarray(twist, dtype=np.float64)
    if array.shape[-1:] != (6,):
        raise InputError(f"twist must hold rotation vector and translation part, six numbers; got shape {array.shape}")
    return array[..., :3], array[..., 3:]


def _cross_powers(w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    skew = cross_matrix(w)
    return np.linalg.norm(w, axis=-1)[..., np.newaxis, np.newaxis], skew, skew @ skew


def _versine_ratio(angle_rad: FloatArray) -> FloatArray:
    # (1 - cos(a)) / a^2 as sinc^2(a / 2) / 2: no cancellation near zero.
    return np.asarray(np.sinc(angle_rad / (2.0 * np.pi)) ** 2 / 2.0)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., np.newaxis])[..., 0])
