"""Plain parts: box, cylinder and plate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg._numbers import is_number
from dqreg.errors import InputError
from dqreg.synth.parts.patches import circle, fan, grid, lift, require_count, ring, walls, weld

Mesh = tuple[FloatArray, IntArray]


def box(size: Sequence[float] = (1.0, 1.0, 1.0), *, divisions: int | Sequence[int] = 1) -> Mesh:
    """Rectangular block, centred on the origin."""
    require_size(size)
    counts = three((divisions,) * 3 if np.isscalar(divisions) else divisions, "divisions")
    for i, count in enumerate(counts):
        require_count("divisions", count, 1, most=500, index=i)
    lines = [np.linspace(-0.5 * s, 0.5 * s, int(n) + 1) for s, n in zip(size, counts, strict=True)]
    return weld(
        lift(grid(lines[(axis + 1) % 3], lines[(axis + 2) % 3]), axis, lines[axis][end], outward=outward)
        for axis in range(3)
        for end, outward in ((0, -1), (-1, 1))
    )


def cylinder(*, diameter: float = 1.0, height: float = 1.0, segments: int = 48) -> Mesh:
    """Upright cylinder, centred on the origin, axis along z.

    Shapes: vertices (segments * 2, 3), faces (4 * segments - 4, 3).
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
    """Flat plate with four through-holes, one corner at the origin."""
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

    Shapes: face (n, 3, 2), holes (segments, 2).
    """
    cells = [((x[i], x[i + 1]), (y[j], y[j + 1])) for i in range(2) for j in range(2)]
    holes = [circle((sum(u) / 2, sum(v) / 2), diameters[min(k, 1)], segments) for k, (u, v) in enumerate(cells)]
    return np.concatenate([ring(u, v, hole) for (u, v), hole in zip(cells, holes, strict=True)]), holes


def require_positive(**lengths: Any) -> None:
    """Raise unless every number given is above zero and finite.

    >>> require_positive(length=1.0, width=2)
    """
    for name, value in lengths.items():
        _require_above_zero(name, value)


def require_size(size: Any) -> None:
    """Raise unless a size is three numbers above zero and finite."""
    for index, value in enumerate(three(size, "size")):
        _require_above_zero("size", value, index)


def _require_above_zero(name: str, value: Any, index: int | None = None) -> None:
    if not is_number(value) or not 0.0 < value < np.inf:
        raise InputError.of("must be a number above 0", name=name, index=index, given=value)


def three(values: Any, name: str) -> tuple[float, float, float]:
    """Check that there are three numbers."""
    # A ragged list makes NumPy raise by itself.
    array = np.asarray(values, dtype=object)
    if array.shape != (3,) or not all(map(is_number, array)):
        raise InputError.of("must be three numbers, along x, y, z", name=name, given=values)
    return array[0], array[1], array[2]
