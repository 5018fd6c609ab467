"""The rotation operator of a unit quaternion, its coordinate-frame twin, and sequences of both.

Equation numbers: Jia, *Quaternions* (2020), sections 3 and 4.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid.operands import as_directions, as_triples, as_unit_quaternions
from dqreg.rigid.quaternion_algebra import conjugate, multiply
from dqreg.rigid.quaternion_powers import polar


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
        v turned by theta about u, for ``q = cos(theta / 2) + u sin(theta / 2)``.

    Raises
    ------
    InputError
        If a shape is wrong, or a norm is not 1.

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
        Coordinates of the resting v in the frame turned by q: v turned by -theta about u.

    Raises
    ------
    InputError
        If a shape is wrong, or a norm is not 1.

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
        If none is given, a shape is wrong, or a norm is not 1.

    Examples
    --------
    >>> compose([0, 1, 0, 0], [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, -1.0]
    """
    return functools.reduce(lambda p, q: multiply(q, p), _sequence(rotations))


def compose_frames(*rotations: ArrayLike) -> FloatArray:
    """Join rotations of the frame, each about axes of the frame turned so far (section 4, example 3, eq. 9).

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
        If none is given, a shape is wrong, or a norm is not 1.

    Examples
    --------
    >>> compose_frames([0, 1, 0, 0], [0, 0, 1, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return functools.reduce(multiply, _sequence(rotations))


def from_axis_angle(axis: ArrayLike, angle_rad: ArrayLike) -> FloatArray:
    """Write a turn about an axis: cos(theta / 2) + u sin(theta / 2) (eq. 6; Walker eqs. 3 and 11).

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
        If a shape is wrong, or an axis is zero or not finite.

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
        If the last axis does not hold four numbers, or a norm is not 1.

    Examples
    --------
    >>> axis, angle_rad = to_axis_angle([0, 0, 1, 0])
    >>> axis.tolist(), float(angle_rad)
    ([0.0, 1.0, 0.0], 3.141592653589793)
    """
    _, axis, half_rad = polar(as_unit_quaternions(q, "q"))
    return axis, np.asarray(2.0 * half_rad)


def _sequence(rotations: tuple[ArrayLike, ...]) -> list[FloatArray]:
    if not rotations:
        raise InputError("a sequence of rotations needs at least one; got none")
    return [as_unit_quaternions(q, f"rotations[{i}]") for i, q in enumerate(rotations)]
