"""Rotation matrices by axis and angle (Rodrigues), by rotation vectors, and spread evenly; the left Jacobian of SO(3).

The three forms of Rodrigues' formula agree to rounding. Each serves where it keeps the most digits: a given angle, a
stack of rotation vectors of any length, a single small step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid._algebra import cross_matrix
from dqreg.rigid._operands import as_triples

# Below this angle the Taylor series, cut after four terms, is exact to rounding and the closed form is not.
_SERIES_RAD = 0.1


def about_axis(axis: FloatArray, angle_rad: ArrayLike) -> FloatArray:
    """Rotations by angles (...) about unit vectors (..., 3)."""
    K, angle = cross_matrix(axis), np.asarray(angle_rad)[..., np.newaxis, np.newaxis]
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K))


def angle_of(R: FloatArray) -> float:
    """Angle of a rotation matrix, (3, 3), radians."""
    # By the chord: exact for small angles, where the cosine is not.
    return float(2.0 * np.arcsin(min(np.linalg.norm(R - np.eye(3)) / np.sqrt(8.0), 1.0)))


def axis_of(R: FloatArray) -> FloatArray:
    """Axis of a rotation matrix, its largest component positive, (3,)."""
    # The axis is the main eigenvector of R + R^T, for half-turns as well.
    axis = np.linalg.eigh(R + R.T)[1][:, 2]
    return np.asarray(axis * np.sign(axis[np.abs(axis).argmax()]))


def from_rotation_vector(w: FloatArray) -> FloatArray:
    """Rotations by rotation vectors (..., 3)."""
    angle_rad, skew, square = _cross_powers(w)
    return np.asarray(np.eye(3) + np.sinc(angle_rad / np.pi) * skew + _versine_ratio(angle_rad) * square)


def evenly_spread(count: int) -> FloatArray:
    """Unit quaternions (count, 4) spread evenly over all rotations: the super-Fibonacci spiral (Alexa 2022)."""
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2.0 * np.pi * s / np.sqrt(2.0), 2.0 * np.pi * s / 1.533751168755204288118041
    return np.column_stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)])


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
    """Inverse of `left_jacobian`. Shapes: w (..., 3), returns (..., 3, 3)."""
    angle_rad, skew, square = _cross_powers(as_triples(w, "w"))
    a2 = angle_rad**2
    series = 1 / 12 + a2 / 720 * (1 + a2 / 42 * (1 + a2 / 40))
    large = np.where(angle_rad < _SERIES_RAD, 1.0, angle_rad)
    closed = (1.0 - large / 2 / np.tan(large / 2)) / large**2
    ratio = np.where(angle_rad < _SERIES_RAD, series, closed)
    return np.asarray(np.eye(3) - skew / 2 + ratio * square)


def _cross_powers(w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    skew = cross_matrix(w)
    return np.linalg.norm(w, axis=-1)[..., np.newaxis, np.newaxis], skew, skew @ skew


def _versine_ratio(angle_rad: FloatArray) -> FloatArray:
    # (1 - cos(a)) / a^2 as sinc^2(a / 2) / 2: no cancellation near zero.
    return np.asarray(np.sinc(angle_rad / (2.0 * np.pi)) ** 2 / 2.0)
