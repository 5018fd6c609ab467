"""Parts with a period, from boxes: stairs, and a plate of pegs."""

from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh
from dqreg.synth.parts import box


def joined(sizes: list[tuple[float, float, float]], middles: list[tuple[float, float, float]]) -> Mesh:
    """Boxes of some sizes about some middles as one mesh."""
    shapes = [box(size) for size in sizes]
    vertices = np.concatenate([shape[0] + middle for shape, middle in zip(shapes, middles, strict=True)])
    firsts = np.cumsum([0, *(len(shape[0]) for shape in shapes)])
    return Mesh(vertices, np.concatenate([shape[1] + first for shape, first in zip(shapes, firsts, strict=False)]))


def pegs(rows: int, columns: int, pitch: float) -> Mesh:
    """A plate with pegs at a pitch in both directions."""
    places = [(i * pitch, j * pitch, 8.0) for i in range(rows) for j in range(columns)]
    middle = (0.5 * (rows - 1) * pitch, 0.5 * (columns - 1) * pitch, 0.0)
    return joined([(rows * pitch, columns * pitch, 6.0), *[(8.0, 6.0, 10.0)] * len(places)], [middle, *places])


def stairs(count: int, run: float, rise: float) -> Mesh:
    """Stairs of so many steps."""
    heights = [rise * (k + 1) for k in range(count)]
    return joined([(run, 70.0, h) for h in heights], [(run * k, 0.0, 0.5 * h) for k, h in enumerate(heights)])
