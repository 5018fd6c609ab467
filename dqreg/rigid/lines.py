"""Lines in space, by direction n and moment m = p x n (Pluecker), six numbers: the dual vector n + eps m.

Equation numbers: Walker, Shao and Volz (1991). Leading axes broadcast. `dqreg.rigid.pose.move_lines` and
`DualQuaternion.move_lines` move them. All functions raise `InputError` where an array has the wrong last axis, or a
direction is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.rigid._operands import PARALLEL_SIN, as_directions, as_lines, as_triples
from dqreg.rigid.dual_quaternion import DualQuaternion
from dqreg.rigid.screw import DualNumber

__all__ = ["common_perpendicular", "dual_angle", "joining", "nearest_point", "screw_between", "through"]


def through(point: ArrayLike, direction: ArrayLike) -> FloatArray:
    """Line through a point along a direction: n + eps (p x n) (eqs. 9 and 60).

    Parameters
    ----------
    point : array_like, (..., 3)
        Any point p on the line.
    direction : array_like, (..., 3)
        Direction; made a unit vector n.

    Returns
    -------
    ndarray, (..., 6)
        Direction n and moment p x n.

    Raises
    ------
    InputError
        If a direction is zero or not finite, or one of the two not of three numbers.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> through([1, 0, 0], [0, 0, 2]).tolist()
    [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]
    """
    p, n = np.broadcast_arrays(as_triples(point, "point"), as_directions(direction, "direction"))
    return np.concatenate([n, np.cross(p, n)], axis=-1)


def joining(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Line from one point to another.

    Parameters
    ----------
    first, second : array_like, (..., 3)
        Two different points.

    Returns
    -------
    ndarray, (..., 6)
        Direction from the first to the second, and moment.

    Raises
    ------
    InputError
        If both points are the same, not finite, or not of three numbers.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> joining([1, 0, 0], [1, 0, 5]).tolist()
    [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]
    """
    a, b = as_triples(first, "first"), as_triples(second, "second")
    return through(a, b - a)


def nearest_point(lines: ArrayLike, to: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Point of a line nearest a given one; of the origin it is n x m (eq. 75, mended).

    Parameters
    ----------
    lines : array_like, (..., 6)
        Lines of unit direction.
    to : array_like, (..., 3)
        Where to be near; the origin if not given.

    Returns
    -------
    ndarray, (..., 3)
        Points on the lines.

    Raises
    ------
    InputError
        If a line is not of six numbers, or its direction zero; if a point is not of three.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> nearest_point(through([1, 0, 7], [0, 0, 1])).tolist()
    [1.0, 0.0, 0.0]
    """
    n, m = _halves(lines, "lines")
    there = as_triples(to, "to")
    return np.asarray(np.cross(n, m) + np.sum(n * there, axis=-1, keepdims=True) * n)


def dual_angle(a: ArrayLike, b: ArrayLike) -> DualNumber:
    """Dual angle theta + eps d of two lines: their angle and their distance (eqs. 10 and 52).

    The dual cosine is the scalar product of the dual vectors, ``cos(theta) - eps d sin(theta)`` (eq. 57).

    Parameters
    ----------
    a, b : array_like, (..., 6)
        Lines of unit direction.

    Returns
    -------
    DualNumber
        theta in [0, pi] and d, (...) each. d is signed: positive where the rotation from a to b about the common
        perpendicular that leads from a to b is right-handed; of parallel lines it is their distance.

    Raises
    ------
    InputError
        If a line is not of six numbers, or its direction zero.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    Lines along x and, two above it, along y:

    >>> angle = dual_angle(through([0, 0, 0], [1, 0, 0]), through([0, 0, 2], [0, 1, 0]))
    >>> round(angle.real, 12), round(angle.dual, 12)
    (1.570796326795, 2.0)
    """
    return _meeting(a, b)[2]


def common_perpendicular(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Line that meets two lines at right angles; along a x b.

    Parameters
    ----------
    a, b : array_like, (..., 6)
        Lines of unit direction. Of parallel ones: the perpendicular nearest the origin, from a to b; of equal or
        opposite ones any line across.

    Returns
    -------
    ndarray, (..., 6)
        Direction and moment.

    Raises
    ------
    InputError
        If a line is not of six numbers, or its direction zero.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> line = common_perpendicular(through([0, 0, 0], [1, 0, 0]), through([5, 0, 2], [0, 1, 0]))
    >>> line[:3].tolist(), nearest_point(line).tolist()
    ([0.0, 0.0, 1.0], [5.0, 0.0, 0.0])
    """
    axis, foot, _ = _meeting(a, b)
    return through(foot, axis)


def screw_between(a: ArrayLike, b: ArrayLike) -> DualQuaternion:
    """Shortest motion that puts line a onto line b: the screw of their dual angle about their common perpendicular.

    Parameters
    ----------
    a, b : array_like, (..., 6)
        Lines of unit direction.

    Returns
    -------
    DualQuaternion
        Rotation by theta and translation by d. For parallel lines a translation, for opposite ones a half-turn.

    Raises
    ------
    InputError
        If a line is not of six numbers, or its direction zero.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> a, b = through([1, 2, 3], [1, 1, 0]), through([0, 5, 2], [0, 1, 1])
    >>> bool(np.allclose(screw_between(a, b).move_lines(a), b))
    True
    """
    axis, foot, angle = _meeting(a, b)
    return DualQuaternion.from_screw(axis, angle.real, angle.dual, foot)


def _meeting(a: ArrayLike, b: ArrayLike) -> tuple[FloatArray, FloatArray, DualNumber]:
    """Direction of the common perpendicular, its foot on a, and the dual angle."""
    (n1, m1), (n2, m2) = _halves(a, "a"), _halves(b, "b")
    n1, m1, n2, m2 = np.broadcast_arrays(n1, m1, n2, m2)
    cross = np.cross(n1, n2)
    sine = np.linalg.norm(cross, axis=-1, keepdims=True)
    parallel = sine < PARALLEL_SIN
    p1, p2 = np.cross(n1, m1), np.cross(n2, m2)
    apart = p2 - p1
    gap = np.linalg.norm(apart, axis=-1, keepdims=True)
    # Across equal or opposite lines: any direction, the one farthest from theirs among x, y, z.
    across = np.cross(n1, np.eye(3)[np.argmin(np.abs(n1), axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    level = np.where(gap > 0.0, apart / np.where(gap > 0.0, gap, 1.0), across)
    axis = np.where(parallel, level, cross / np.where(parallel, 1.0, sine))
    # Where the plane through b along the perpendicular cuts a.
    wall = np.cross(n2, axis)
    along = np.sum(apart * wall, axis=-1, keepdims=True) / np.where(parallel, 1.0, np.sum(n1 * wall, -1, keepdims=True))
    foot = p1 + np.where(parallel, 0.0, along) * n1
    theta = np.arctan2(sine, np.sum(n1 * n2, axis=-1, keepdims=True))[..., 0]
    distance = np.sum(apart * axis, axis=-1)
    single = theta.ndim == 0
    return axis, foot, DualNumber(float(theta), float(distance)) if single else DualNumber(theta, distance)


def _halves(lines: ArrayLike, name: str) -> tuple[FloatArray, FloatArray]:
    array = as_lines(lines, name)
    as_directions(array[..., :3], name)  # refused where zero
    return array[..., :3], array[..., 3:]
