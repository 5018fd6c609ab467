"""Exponential and logarithm of SE(3): six numbers (rotation vector, translation part) to a 4x4 pose and back.

A twist is a left increment, ``T = exp(twist) @ T0``. Its first three numbers are the rotation vector w (axis
times angle), its last three the velocity part v of the screw motion; the translation of ``exp(twist)`` is
``left_jacobian(w) @ v``, which is v itself only where w is zero or along v.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid import single_pose
from dqreg.rigid._algebra import cross_matrix
from dqreg.rigid._matrices import of_rotations
from dqreg.rigid._operands import as_poses, as_rotations
from dqreg.rigid._powers import log as quaternion_log
from dqreg.rigid.rotations import from_rotation_vector
from dqreg.rigid.rotations import left_jacobian as rotation_jacobian
from dqreg.rigid.rotations import left_jacobian_inverse as rotation_jacobian_inverse

# Rows of a twist, or rows and columns of its covariance, with the translation first.
TRANSLATION_FIRST = np.r_[3:6, 0:3]
# Below this angle the series of the corner's ratios are exact to rounding, and the closed forms are not.
_SERIES_RAD = 2.0
_RATIO_SERIES = (
    [(-1.0) ** (n + 1) / math.factorial(2 * n + 1) for n in range(1, 15)],
    [(-1.0) ** n / math.factorial(2 * n) for n in range(2, 16)],
    [(-1.0) ** n * (n - 1) / math.factorial(2 * n + 1) for n in range(2, 16)],
)


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
        If the twist does not hold six numbers in the last axis.

    Examples
    --------
    >>> exp([0, 0, np.pi / 2, 1, 2, 3]).round(6)[:3, 3].tolist()
    [-0.63662, 1.909859, 3.0]
    """
    w, v = _halves(twist)
    if w.ndim == 1:
        return single_pose.exp(np.concatenate([w, v]))
    T = np.zeros((*w.shape[:-1], 4, 4))
    T[..., :3, :3] = from_rotation_vector(w)
    T[..., :3, 3] = _times(rotation_jacobian(w), v)
    T[..., 3, 3] = 1.0
    return T


def scaling_by(rotations: float, translations: float = 1.0) -> FloatArray:
    """What a twist is multiplied with, (6,): by a lever its rotations are displacements there.

    >>> scaling_by(0.5).tolist()
    [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]
    """
    return np.array([rotations] * 3 + [translations] * 3)


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

    Raises
    ------
    InputError
        If T is not (..., 4, 4) or (..., 3, 4), or its rotation departs from orthonormal by more than 0.01 or is a
        mirror image.

    Examples
    --------
    >>> log(exp([0.1, 0.2, 0.3, 4, 5, 6])).round(12).tolist()
    [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
    """
    poses = as_poses(T, "T")
    R = as_rotations(poses[..., :3, :3], "R")
    if R.ndim == 2:
        return single_pose.log(R, poses[:3, 3])
    w = 2.0 * quaternion_log(of_rotations(R))[..., 1:]
    return np.concatenate([w, _times(rotation_jacobian_inverse(w), poses[..., :3, 3])], axis=-1)


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
        If T is not (..., 4, 4) or (..., 3, 4). That it is rigid is not checked.

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


def left_jacobian(twist: ArrayLike) -> FloatArray:
    """Matrix J of ``exp(x + dx) = exp(J dx) exp(x)`` to first order: how a change of the six numbers moves the pose.

    The right one, of ``exp(x + dx) = exp(x) exp(J dx)``, is that of ``-x``.

    Parameters
    ----------
    twist : array_like, (..., 6)
        Rotation vector, then translation part.

    Returns
    -------
    ndarray, (..., 6, 6)
        ``[[J3, 0], [Q, J3]]`` with the left Jacobian J3 of the rotation.

    Raises
    ------
    InputError
        If the twist does not hold six numbers in the last axis.

    Examples
    --------
    >>> bool(np.allclose(left_jacobian([0, 0, 0, 4, 5, 6])[3:, :3], cross_matrix([2, 2.5, 3])))
    True
    """
    w, v = _halves(twist)
    W, V = cross_matrix(w), cross_matrix(v)
    c1, c2, c3 = _coupling_ratios(np.linalg.norm(w, axis=-1)[..., np.newaxis, np.newaxis])
    WV, VW = W @ V, V @ W
    WVW, WWV, VWW = W @ VW, W @ WV, VW @ W
    Q = V / 2 + c1 * (WV + VW + WVW) + c2 * (WWV + VWW - 3.0 * WVW) + c3 * (WVW @ W + W @ WVW)
    return _blocks(rotation_jacobian(w), Q)


def left_jacobian_inverse(twist: ArrayLike) -> FloatArray:
    """Inverse of `left_jacobian`: how the six numbers change with a small increment on the left.

    Parameters
    ----------
    twist : array_like, (..., 6)
        Rotation vector, shorter than 2 pi, then translation part.

    Returns
    -------
    ndarray, (..., 6, 6)
        J^-1 of ``log(exp(d) exp(x)) = x + J^-1 d`` to first order.

    Raises
    ------
    InputError
        If the twist does not hold six numbers in the last axis.

    Examples
    --------
    >>> x = [0.1, 0.2, 0.3, 4, 5, 6]
    >>> bool(np.allclose(left_jacobian_inverse(x) @ left_jacobian(x), np.eye(6)))
    True
    """
    back = rotation_jacobian_inverse(_halves(twist)[0])
    return _blocks(back, -back @ left_jacobian(twist)[..., 3:, :3] @ back)


def _blocks(diagonal: FloatArray, corner: FloatArray) -> FloatArray:
    matrix = np.zeros((*diagonal.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = diagonal
    matrix[..., 3:, :3] = corner
    return matrix


def _coupling_ratios(a: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ratios of a long corner: each loses up to five powers of the angle, so a series serves as far as it reaches."""
    small = a < _SERIES_RAD
    square, far = np.where(small, a * a, 0.0), np.where(small, 1.0, a)
    sine, cosine = np.sin(far), np.cos(far)
    closed = (
        (far - sine) / far**3,
        (far * far + 2.0 * cosine - 2.0) / (2.0 * far**4),
        (2.0 * far - 3.0 * sine + far * cosine) / (2.0 * far**5),
    )
    series = (np.polynomial.polynomial.polyval(square, row) for row in _RATIO_SERIES)
    first, second, third = (np.where(small, near, away) for near, away in zip(series, closed, strict=True))
    return first, second, third


def _halves(twist: ArrayLike) -> tuple[FloatArray, FloatArray]:
    array = as_float(twist, "twist")
    if array.shape[-1:] != (6,):
        raise InputError(f"twist must hold rotation vector and translation part, six numbers; got shape {array.shape}")
    return array[..., :3], array[..., 3:]


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., np.newaxis])[..., 0])
