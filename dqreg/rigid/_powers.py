"""Polar form, real power, exponential and logarithm of quaternions: Jia, *Quaternions* (2020), appendix A, eqs. 18-21.

The notes' ``arccos(q0 / |q|)`` loses half of the digits near 0 and pi. The same angle is taken here from the
lengths of both parts by atan2, and ``sin(x) / x`` is formed without dividing by a vanishing length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid._operands import as_directions, as_quaternions, as_unit_quaternions


def polar(q: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Norm, axis and angle with ``q = |q| (cos(angle) + axis sin(angle))`` (eq. 18).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions other than zero, scalar first.

    Returns
    -------
    length : ndarray, (...)
        |q|.
    axis : ndarray, (..., 3)
        Unit vector along the vector part; x where the vector part is zero and every axis would do.
    angle_rad : ndarray, (...)
        In [0, pi]; a unit quaternion rotates by twice this angle.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is zero.

    Examples
    --------
    >>> length, axis, angle_rad = polar([0, 0, 2, 0])
    >>> float(length), axis.tolist(), float(angle_rad)
    (2.0, [0.0, 1.0, 0.0], 1.5707963267948966)
    """
    array = as_quaternions(q, "q")
    length = np.linalg.norm(array, axis=-1)
    if np.any(length == 0.0):
        raise InputError("q must not be zero: a zero quaternion has neither axis nor angle")
    # Divided by its largest component first: the squares of a vector of 1e-160 would vanish.
    largest = np.max(np.abs(array[..., 1:]), axis=-1, keepdims=True)
    some_axis = largest == 0.0
    vector = np.where(some_axis, [1.0, 0.0, 0.0], array[..., 1:] / np.where(some_axis, 1.0, largest))
    stretch = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.asarray(length), vector / stretch, np.arctan2((largest * stretch)[..., 0], array[..., 0])


def from_axis_angle(axis: ArrayLike, angle_rad: ArrayLike) -> FloatArray:
    """Quaternion of a rotation about an axis: cos(theta / 2) + u sin(theta / 2) (eq. 6; Walker eqs. 3 and 11).

    Parameters
    ----------
    axis : array_like, (..., 3)
        Axes; only their direction counts.
    angle_rad : array_like, (...)
        Right-handed angles.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions, scalar first.

    Raises
    ------
    InputError
        If an axis is zero, not finite, or not of three numbers; if an angle is no real number.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> from_axis_angle([1, 1, 1], 2 * np.pi / 3).round(12).tolist()
    [0.5, 0.5, 0.5, 0.5]
    """
    half = as_float(angle_rad, "angle_rad")[..., np.newaxis] / 2.0
    vector = as_directions(axis, "axis") * np.sin(half)
    scalar = np.broadcast_to(np.cos(half), (*vector.shape[:-1], 1))
    return np.concatenate([scalar, vector], axis=-1)


def to_axis_angle(q: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Axis and angle of a unit quaternion, by eq. 6 read backwards.

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.

    Returns
    -------
    axis : ndarray, (..., 3)
        Unit vectors; x where there is no rotation and every axis would do.
    angle_rad : ndarray, (...)
        In [0, 2 pi]; at most pi for a quaternion in canonical sign.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is not of norm 1 to 1e-5.

    Examples
    --------
    >>> axis, angle_rad = to_axis_angle([0, 0, 1, 0])
    >>> axis.tolist(), float(angle_rad)
    ([0.0, 1.0, 0.0], 3.141592653589793)
    """
    _, axis, half_rad = polar(as_unit_quaternions(q, "q"))
    return axis, np.asarray(2.0 * half_rad)


def power(q: ArrayLike, exponent: ArrayLike) -> FloatArray:
    """Real power of a quaternion (eq. 19).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions other than zero, scalar first.
    exponent : array_like, (...)
        Real exponents.

    Returns
    -------
    ndarray, (..., 4)
        ``|q|^rho (cos(rho theta) + u sin(rho theta))``. The power of a negative real number, whose axis is
        open, is taken about x.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is zero; if an exponent is no real number.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> power([0, 0, 0, 4], 2).round(12).tolist()
    [-16.0, 0.0, 0.0, 0.0]
    """
    length, axis, angle_rad = polar(q)
    rho = as_float(exponent, "exponent")
    phase = rho * angle_rad
    scale = length**rho
    return _join(scale * np.cos(phase), (scale * np.sin(phase))[..., np.newaxis] * axis)


def exp(q: ArrayLike) -> FloatArray:
    """Exponential of a quaternion (eq. 20).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    ndarray, (..., 4)
        ``e^q0 (cos |q| + u sin |q|)``. Of ``(0, w / 2)``: the rotation by the rotation vector w.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis.

    Examples
    --------
    >>> exp([0, np.pi / 2, 0, 0]).round(12).tolist()
    [0.0, 1.0, 0.0, 0.0]
    """
    array = as_quaternions(q, "q")
    vector = array[..., 1:]
    angle_rad = np.linalg.norm(vector, axis=-1)
    scale = np.exp(array[..., 0])
    # np.sinc(x) is sin(pi x) / (pi x), and 1 at zero.
    return _join(scale * np.cos(angle_rad), (scale * np.sinc(angle_rad / np.pi))[..., np.newaxis] * vector)


def log(q: ArrayLike) -> FloatArray:
    """Logarithm of a quaternion (eq. 21).

    Parameters
    ----------
    q : array_like, (..., 4)
        Quaternions other than zero, scalar first.

    Returns
    -------
    ndarray, (..., 4)
        ``ln |q| + u theta`` with theta in [0, pi], so that ``exp(log(q))`` is q, sign and all. Of a unit
        quaternion: half the rotation vector. The logarithm of a negative real number, whose axis is open,
        lies along x.

    Raises
    ------
    InputError
        If q does not hold four numbers in the last axis, or is zero.

    Examples
    --------
    >>> log([0, 1, 0, 0]).tolist()
    [0.0, 1.5707963267948966, 0.0, 0.0]
    """
    length, axis, angle_rad = polar(q)
    return _join(np.log(length), angle_rad[..., np.newaxis] * axis)


def _join(scalar: FloatArray, vector: FloatArray) -> FloatArray:
    return np.concatenate([np.asarray(scalar)[..., np.newaxis], vector], axis=-1)
