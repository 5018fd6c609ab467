"""Between two rotations: axis and angle at constant rates, and slerp.

Equation numbers: Jia, *Quaternions* (2020), appendix C.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.rigid.operands import as_unit_quaternions
from dqreg.rigid.quaternion_algebra import conjugate, multiply
from dqreg.rigid.quaternion_powers import polar, power
from dqreg.rigid.quaternion_rotation import from_axis_angle

# Where |u1 x u2| is rounding, its direction says nothing about the plane of the two axes.
_PARALLEL = 1e-14


def slerp(r1: ArrayLike, r2: ArrayLike, fraction: ArrayLike, *, shorter_turn: bool = False) -> FloatArray:
    """Interpolate along the great arc, about one fixed axis at constant speed: r1 (r1* r2)^tau (eq. 34).

    Parameters
    ----------
    r1, r2 : array_like, (..., 4)
        Unit quaternions, scalar first.
    fraction : array_like, (...)
        tau: 0 at r1, 1 at r2; broadcasts against the leading axes of both.
    shorter_turn : bool
        r2 and -r2 are the same rotation at the two ends of different arcs. The notes' formula takes r2 as it
        is, and turns by more than half a turn where r1 . r2 < 0; with True it then goes to -r2.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions.

    Raises
    ------
    InputError
        If a last axis does not hold four numbers, or a norm is not 1.

    Examples
    --------
    >>> slerp([1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5, 1]).round(6).tolist()
    [[1.0, 0.0, 0.0, 0.0], [0.707107, 0.0, 0.0, 0.707107], [0.0, 0.0, 0.0, 1.0]]
    """
    first, last = as_unit_quaternions(r1, "r1"), as_unit_quaternions(r2, "r2")
    step = multiply(conjugate(first), last)
    if shorter_turn:
        step = np.where(step[..., :1] < 0.0, -step, step)
    return multiply(first, power(step, fraction))


def interpolate_axis_angle(r1: ArrayLike, r2: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Move the angle evenly and the axis evenly along its great arc (eqs. 29-33).

    Parameters
    ----------
    r1, r2 : array_like, (..., 4)
        Unit quaternions, scalar first; their angles, in [0, 2 pi], and axes are taken from them as they are.
        One that does not turn takes over the axis of the other.
    fraction : array_like, (...)
        tau: 0 at r1, 1 at r2; broadcasts against the leading axes of both.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions.

    Raises
    ------
    InputError
        If a last axis does not hold four numbers, or a norm is not 1.

    Examples
    --------
    From a half-turn about x to a half-turn about y, by half-turns:

    >>> interpolate_axis_angle([0, 1, 0, 0], [0, 0, 1, 0], 0.5).round(6).tolist()
    [0.0, 0.707107, 0.707107, 0.0]
    """
    first, last = np.broadcast_arrays(as_unit_quaternions(r1, "r1"), as_unit_quaternions(r2, "r2"))
    tau = as_float(fraction, "fraction")
    _, u1, half1_rad = polar(first)
    _, u2, half2_rad = polar(last)
    open1, open2 = (np.all(r[..., 1:] == 0.0, axis=-1, keepdims=True) for r in (first, last))
    u1, u2 = np.where(open1, u2, u1), np.where(open2, u1, u2)
    angle_rad = 2.0 * ((1.0 - tau) * half1_rad + tau * half2_rad)  # eq. 29
    return from_axis_angle(interpolate_axis(u1, u2, tau), angle_rad)


def interpolate_axis(u1: FloatArray, u2: FloatArray, fraction: ArrayLike) -> FloatArray:
    """Move a unit vector evenly along the shorter great arc to another (eqs. 30-32).

    Equation 32 divides by sin(phi). Its equal ``cos(tau phi) u1 + sin(tau phi) (n x u1)``, the rotation about n that it
    comes from, does not, and holds for opposite vectors as well.

    Shapes: u1, u2 (..., 3), returns (..., 3).
    """
    normal = np.cross(u1, u2)
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    # Eq. 31 by atan2: the arc cosine loses half of the digits near 0 and pi.
    phi_rad = np.arctan2(sine, np.sum(u1 * u2, axis=-1, keepdims=True))
    parallel = sine < _PARALLEL
    on_z = np.hypot(u1[..., :1], u1[..., 1:2]) == 0.0
    vertical = np.concatenate([-u1[..., 1:2], u1[..., :1], np.zeros_like(sine)], axis=-1)
    normal = np.where(parallel, np.where(on_z, [1.0, 0.0, 0.0], vertical), normal)
    across = np.cross(normal, u1)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    swept_rad = as_float(fraction, "fraction")[..., np.newaxis] * phi_rad
    return np.asarray(np.cos(swept_rad) * u1 + np.sin(swept_rad) * across)
