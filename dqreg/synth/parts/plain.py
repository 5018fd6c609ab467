"""Plain parts: box, cylinder and plate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.synth.parts.checks import require_count
from dqreg.synth.parts.patches import circle, fan, grid, lift, ring, walls, weld

Mesh = tuple[FloatArray, IntArray]


def box(size: Sequence[float] = (1.0, 1.0, 1.0), *, divisions: int | Sequence[int] = 1) -> Mesh:
    """Rectangular block, centred on the origin.

    Parameters
    ----------
    size : sequence of 3 floats
        Edge lengths along x, y, z.
    divisions : int or sequence of 3 ints
        Number of cells along each axis.

    Returns
    -------
    vertices : ndarray, (v, 3)
        Float64, in the unit of ``size``.
    faces : ndarray, (f, 3)
        Int64; twelve triangles for one division.

    Raises
    ------
    InputError
        If a length or a division is not positive.

    Examples
    --------
    >>> vertices, faces = box(size=(3.0, 2.0, 1.0))
    >>> vertices.shape, faces.shape
    ((8, 3), (12, 3))
    """
    require_positive(**{f"size[{i}]": value for i, value in enumerate(three(size, "size"))})
    counts = three((divisions,) * 3 if np.isscalar(divisions) else divisions, "divisions")
    for i, count in enumerate(counts):
        require_count(f"divisions[{i}]", count, 1, most=500)
    lines = [np.linspace(-0.5 * s, 0.5 * s, int(n) + 1) for s, n in zip(size, counts, strict=True)]
    return weld(
        lift(grid(lines[(axis + 1) % 3], lines[(axis + 2) % 3]), axis, lines[axis][end], outward=outward)
        for axis in range(3)
        for end, outward in ((0, -1), (-1, 1))
    )


def cylinder(*, diameter: float = 1.0, height: float = 1.0, segments: int = 48) -> Mesh:
    """Upright cylinder, centred on the origin, axis along z.

    Parameters
    ----------
    diameter, height : float
        Dimensions.
    segments : int
        Facets around, a multiple of four that is at least 8.

    Returns
    -------
    vertices : ndarray, (segments * 2, 3)
        Float64, in the unit of the dimensions.
    faces : ndarray, (4 * segments - 4, 3)
        Int64.

    Raises
    ------
    InputError
        If a dimension is not positive or ``segments`` does not fit.

    Examples
    --------
    >>> cylinder(segments=16)[0].shape
    (32, 3)
    """
    require_positive(diameter=diameter, height=height)
    outline, half = circle((0.0, 0.0), diameter, segments), 0.5 * height
    return weld(
        [
            walls(outline, 2, (-half, half)),
            lift(fan(outline), 2, half),
            lift(fan(outline), 2, -half, outward=-1),
        ]
    )


def plate(
    size: Sequence[float] = (100.0, 60.0, 4.0),
    *,
    large_hole: float = 14.0,
    small_hole: float = 9.0,
    segments: int = 48,
) -> Mesh:
    """Flat plate with four through-holes, one corner at the origin.

    Parameters
    ----------
    size : sequence of 3 floats
        Length along x, width along y, thickness along z.
    large_hole, small_hole : float
        Diameter of the hole next to the origin, and of the three others.
    segments : int
        Facets around each hole, a multiple of four that is at least 8.

    Returns
    -------
    vertices : ndarray, (v, 3)
        Float64, in the unit of the dimensions.
    faces : ndarray, (f, 3)
        Int64.

    Raises
    ------
    InputError
        If a dimension is not positive or a hole does not fit.

    Examples
    --------
    >>> vertices, faces = plate()
    >>> vertices.max(axis=0).tolist()
    [100.0, 60.0, 4.0]
    """
    length, width, thickness = three(size, "size")
    require_positive(length=length, width=width, thickness=thickness, large_hole=large_hole, small_hole=small_hole)
    x, y, z = [0.0, 0.5 * length, length], [0.0, 0.5 * width, width], [0.0, thickness]
    face, holes = four_holes(x, y, (large_hole, small_hole), segments)
    sides = [lift(grid(y, z), 0, x[end], outward=out) for end, out in ((0, -1), (-1, 1))]
    sides += [lift(grid(z, x), 1, y[end], outward=out) for end, out in ((0, -1), (-1, 1))]
    bores = [walls(hole, 2, (0.0, thickness), outward=-1) for hole in holes]
    return weld([lift(face, 2, 0.0, outward=-1), lift(face, 2, thickness), *sides, *bores])


def four_holes(
    x: list[float], y: list[float], diameters: tuple[float, float], segments: int
) -> tuple[FloatArray, list[FloatArray]]:
    """Cut a rectangle into two by two cells with a hole in the middle of each, the first one large.

    Parameters
    ----------
    x, y : list of 3 floats
        Increasing positions of the cells' lines.
    diameters : (float, float)
        Diameter of the hole next to (x[0], y[0]), and of the three others.
    segments : int
        Facets around each hole.

    Returns
    -------
    face : ndarray, (n, 3, 2)
        Counter-clockwise triangles of the rectangle without the holes.
    holes : list of ndarray, (segments, 2)
        Outlines of the holes.

    Raises
    ------
    InputError
        If a hole does not fit into its cell.

    Examples
    --------
    >>> face, holes = four_holes([0.0, 2.0, 4.0], [0.0, 2.0, 4.0], (1.0, 0.5), 8)
    >>> len(face), len(holes)
    (48, 4)
    """
    cells = [((x[i], x[i + 1]), (y[j], y[j + 1])) for i in range(2) for j in range(2)]
    holes = [circle((sum(u) / 2, sum(v) / 2), diameters[min(k, 1)], segments) for k, (u, v) in enumerate(cells)]
    return np.concatenate([ring(u, v, hole) for (u, v), hole in zip(cells, holes, strict=True)]), holes


def require_positive(**lengths: Any) -> None:
    """Raise unless every number given is above zero and finite.

    Parameters
    ----------
    **lengths : float
        Numbers by the name that the message shall show.

    Raises
    ------
    InputError
        If one is not; the message names it.

    Examples
    --------
    >>> require_positive(length=1.0, width=2)
    """
    for name, value in lengths.items():
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not 0.0 < value < np.inf:
            raise InputError(f"{name} must be a number above 0; got {value!r}")


def three(values: Any, name: str) -> tuple[float, float, float]:
    """Check that there are three numbers.

    Parameters
    ----------
    values : sequence of 3 numbers
        What was given.
    name : str
        Its name, for the message.

    Returns
    -------
    (float, float, float)
        The numbers.

    Raises
    ------
    InputError
        If they are not three numbers.

    Examples
    --------
    >>> len(three([1, 2, 3], "size"))
    3
    """
    # A ragged list makes NumPy raise by itself.
    array = np.asarray(values, dtype=object)
    if array.shape != (3,) or not all(
        isinstance(v, (int, float, np.number)) and not isinstance(v, bool) for v in array
    ):
        raise InputError(f"{name} must be three numbers, along x, y, z; got {values!r}")
    return array[0], array[1], array[2]
