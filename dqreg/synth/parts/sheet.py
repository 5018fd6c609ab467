"""The angle: a bent piece of sheet metal with three holes."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.synth.parts.patches import circle, grid, ladder, lift, require_count, require_order, ring, walls, weld
from dqreg.synth.parts.plain import Mesh, require_positive


def angle(
    *,
    length: float = 90.0,
    height: float = 60.0,
    width: float = 70.0,
    thickness: float = 2.0,
    bend_radius: float = 4.0,
    large_hole: float = 14.0,
    small_hole: float = 8.0,
    segments: int = 32,
) -> Mesh:
    """Sheet-metal angle without symmetry: two legs, a bend, two holes in the long leg and one in the other.

    The long leg lies on z = 0, the other stands on x = 0, y runs from 0 to ``width``.
    """
    require_positive(**{n: v for n, v in locals().items() if n != "segments"})
    require_count("segments", segments, 8, multiple=4)
    foot = thickness + bend_radius
    require_order(bend=foot, length=length)
    require_order(bend=foot, height=height)
    y = [0.0, 0.5 * width, width]
    long_leg, long_holes = _leg((foot, length), y, (large_hole, small_hole), segments)
    short_leg, short_holes = _leg((foot, height), y, (small_hole, None), segments)
    short_leg, short_holes = short_leg[:, ::-1, ::-1], [hole[::-1, ::-1] for hole in short_holes]  # (y, z)
    outer, inner = (_profile(foot, r, length, height, segments // 4) for r in (foot, bend_radius))
    ends = ladder(inner, outer)
    bends = [
        wall
        for span in ((y[0], y[1]), (y[1], y[2]))
        for wall in (
            walls(outer[1:-1], 1, span, closed=False),
            walls(inner[1:-1], 1, span, closed=False, outward=-1),
        )
    ]
    return weld(
        [
            lift(long_leg, 2, 0.0, outward=-1),
            lift(long_leg, 2, thickness),
            lift(short_leg, 0, 0.0, outward=-1),
            lift(short_leg, 0, thickness),
            lift(grid(y, [0.0, thickness]), 0, length),
            lift(grid([0.0, thickness], y), 2, height),
            lift(ends, 1, y[0], outward=-1),
            lift(ends, 1, y[2]),
            *bends,
            *(walls(hole, 2, (0.0, thickness), outward=-1) for hole in long_holes),
            *(walls(hole, 0, (0.0, thickness), outward=-1) for hole in short_holes),
        ]
    )


def _leg(
    along: tuple[float, float], y: list[float], diameters: tuple[float, float | None], segments: int
) -> tuple[FloatArray, list[FloatArray]]:
    """Flat face of a leg in (along, y), one cell a hole or none, and the holes' outlines."""
    cells, holes = [], []
    for low, high, diameter in zip(y, y[1:], diameters, strict=False):
        if diameter is None:
            cells.append(grid(along, [low, high]))
            continue
        hole = circle((0.5 * (along[0] + along[1]), 0.5 * (low + high)), diameter, segments)
        cells.append(ring(along, (low, high), hole))
        holes.append(hole)
    return np.concatenate(cells), holes


def _profile(foot: float, radius: float, length: float, height: float, facets: int) -> FloatArray:
    """One side of the sheet in (z, x), from the end of the long leg over the bend to that of the other."""
    turn = np.linspace(0.0, 0.5 * np.pi, facets + 1)
    arc = foot - radius * np.column_stack([np.cos(turn), np.sin(turn)])
    # The ends are set exactly: the flat faces share these vertices.
    side = 0.0 if radius == foot else foot - radius
    arc[0], arc[-1] = (side, foot), (foot, side)
    return np.concatenate([[(side, length)], arc, [(height, side)]])
