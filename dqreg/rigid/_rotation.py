"""The rotation operator of a unit quaternion, its coordinate-frame twin, sequences of both, and interpolation.

Equation numbers: Jia, *Quaternions* (2020), sections 3 and 4, and appendix C for what lies between two rotations.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid._algebra import canonical, conjugate, multiply
from dqreg.rigid._operands import PARALLEL_SIN, as_directions, as_triples, as_unit_quaternions
from dqreg.rigid._powers import from_axis_angle, polar, power


def rotate(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Rotate vectors: L_q(v) = q v q* (eq. 5, theorem 1).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    v : array_like, (..., 3)
        Vectors; leading axes broadcast against those of q.

    Returns
    -------
    ndarray, (..., 3)
        v rotated by theta about u, for ``q = cos(theta / 2) + u sin(theta / 2)``.

    Raises
    ------
    InputError
        If q is not of norm 1 to 1e-5, or v does not hold three numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    The notes' example 2, a third of a turn about (1, 1, 1), takes x to y:

    >>> rotate([0.5, 0.5, 0.5, 0.5], [1, 0, 0]).tolist()
    [0.0, 1.0, 0.0]
    """
    array, vectors = as_unit_quaternions(q, "q"), as_triples(v, "v")
    scalar, axial = array[..., :1], array[..., 1:]
    along = np.sum(axial * vectors, axis=-1, keepdims=True)
    square = np.sum(axial * axial, axis=-1, keepdims=True)
    turned = (scalar**2 - square) * vectors + 2.0 * along * axial + 2.0 * scalar * np.cross(axial, vectors)
    return np.asarray(turned)


def rotate_frame(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Rotate the coordinate frame, not the vectors: L_q*(v) = q* v q (theorem 2).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    v : array_like, (..., 3)
        Vectors; leading axes broadcast against those of q.

    Returns
    -------
    ndarray, (..., 3)
        Coordinates of the resting v in the frame rotated by q: v rotated by -theta about u.

    Raises
    ------
    InputError
        If q is not of norm 1 to 1e-5, or v does not hold three numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> rotate_frame([0.5, 0.5, 0.5, 0.5], [1, 0, 0]).tolist()
    [0.0, 0.0, 1.0]
    """
    return rotate(conjugate(q), v)


def compose(*rotations: ArrayLike) -> FloatArray:
    """Join rotations of vectors, in the order in which they act (section 4: L_q after L_p is L_qp).

    Parameters
    ----------
    *rotations : array_like, (..., 4)
        Unit quaternions, the one that acts first given first.

    Returns
    -------
    ndarray, (..., 4)
        The last times ... times the first.

    Raises
    ------
    InputError
        If none is given, or one is not of norm 1 to 1e-5.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> compose([0, 1, 0, 0], [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, -1.0]
    """
    return functools.reduce(lambda p, q: multiply(q, p), _sequence(rotations))


def compose_frames(*rotations: ArrayLike) -> FloatArray:
    """Join rotations of the frame, each about axes of the frame rotated so far (section 4, example 3, eq. 9).

    L_p* followed by L_q* is L_(pq)*: the product runs the other way than in `compose`.

    Parameters
    ----------
    *rotations : array_like, (..., 4)
        Unit quaternions, the one that acts first given first.

    Returns
    -------
    ndarray, (..., 4)
        The first times ... times the last.

    Raises
    ------
    InputError
        If none is given, or one is not of norm 1 to 1e-5.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> compose_frames([0, 1, 0, 0], [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return functools.reduce(multiply, _sequence(rotations))


def _sequence(rotations: tuple[ArrayLike, ...]) -> list[FloatArray]:
    if not rotations:
        raise InputError("a sequence of rotations needs at least one; got none")
    return [as_unit_quaternions(q, f"rotations[{i}]") for i, q in enumerate(rotations)]


def slerp(r1: ArrayLike, r2: ArrayLike, fraction: ArrayLike, *, shorter_turn: bool = True) -> FloatArray:
    """Interpolate about one fixed axis at constant speed, by the shorter rotation: r1 (r1* r2)^tau (eq. 34).

    Parameters
    ----------
    r1, r2 : array_like, (..., 4)
        Unit quaternions, scalar first.
    fraction : array_like, (...)
        tau: 0 at r1, 1 at r2; broadcasts against the leading axes of both.
    shorter_turn : bool
        r2 and -r2 are the same rotation at the ends of different arcs. With True the shorter one is taken, whatever
        the signs, and at exactly half a turn that about the axis whose first non-zero component is positive:
        the rule of `DualQuaternion` too. With False r2 is taken as it is, as the notes do; the rotation is by
        more than half a turn where r1 . r2 < 0.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions.

    Raises
    ------
    InputError
        If r1 or r2 is not of norm 1 to 1e-5, or a fraction no real number.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> slerp([1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5, 1]).round(6).tolist()
    [[1.0, 0.0, 0.0, 0.0], [0.707107, 0.0, 0.0, 0.707107], [0.0, 0.0, 0.0, 1.0]]
    """
    first, last = as_unit_quaternions(r1, "r1"), as_unit_quaternions(r2, "r2")
    step = multiply(conjugate(first), last)
    if shorter_turn:
        step = canonical(step)
    return multiply(first, power(step, fraction))


def interpolate_axis_angle(r1: ArrayLike, r2: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Move the angle evenly and the axis evenly along its great arc (eqs. 29-33).

    Parameters
    ----------
    r1, r2 : array_like, (..., 4)
        Unit quaternions, scalar first; their angles, in [0, 2 pi], and axes are taken from them as they are.
        An identity takes over the axis of the other.
    fraction : array_like, (...)
        tau: 0 at r1, 1 at r2; broadcasts against the leading axes of both.

    Returns
    -------
    ndarray, (..., 4)
        Unit quaternions.

    Raises
    ------
    InputError
        If r1 or r2 is not of norm 1 to 1e-5, or a fraction no real number.
    ValueError
        If leading axes do not broadcast.

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


def interpolate_axis(u1: ArrayLike, u2: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Move a unit vector evenly along the shorter great arc to another (eqs. 30-32).

    Equation 32 divides by sin(phi), and equation 30, ``u1 x u2`` over its length, is 0 / 0 for equal vectors. The
    rotation about n that they come from, ``cos(tau phi) u1 + sin(tau phi) (n x u1)``, needs neither; opposite vectors
    meet in the plane through the vertical, on the side of
    ``(z x u1) x u1``.

    Parameters
    ----------
    u1, u2 : array_like, (..., 3)
        Axes; only their directions count.
    fraction : array_like, (...)
        tau: 0 at u1, 1 at u2.

    Returns
    -------
    ndarray, (..., 3)
        Unit vectors.

    Raises
    ------
    InputError
        If an axis is zero, not finite, or not of three numbers; if a fraction is no real number.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> interpolate_axis([1, 0, 0], [0, 1, 0], 0.5).round(6).tolist()
    [0.707107, 0.707107, 0.0]
    """
    u1, u2 = np.broadcast_arrays(as_directions(u1, "u1"), as_directions(u2, "u2"))
    normal = np.cross(u1, u2)
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    # Eq. 31 by atan2: the arc cosine loses half of the digits near 0 and pi.
    phi_rad = np.arctan2(sine, np.sum(u1 * u2, axis=-1, keepdims=True))
    # Where |u1 x u2| is rounding, its direction is not that of the plane of the two axes.
    parallel = sine < PARALLEL_SIN
    on_z = np.hypot(u1[..., :1], u1[..., 1:2]) == 0.0
    vertical = np.concatenate([-u1[..., 1:2], u1[..., :1], np.zeros_like(sine)], axis=-1)
    normal = np.where(parallel, np.where(on_z, [1.0, 0.0, 0.0], vertical), normal)
    across = np.cross(normal, u1)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    swept_rad = as_float(fraction, "fraction")[..., np.newaxis] * phi_rad
    return np.asarray(np.cos(swept_rad) * u1 + np.sin(swept_rad) * across)
