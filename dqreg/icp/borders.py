"""Pairs that end at the border of an open target: beyond it there is no surface to compare with."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import BoolArray, FloatArray
from dqreg.geometry.borders import Borders
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.surface import Surface
from dqreg.icp.pairs import Pairs

# Widths from a free edge within which noise alone decides whether the closest place is on it.
STRIP = 3.0


@dataclasses.dataclass(frozen=True)
class Inland:
    """Rejects pairs whose closest place lies on a free edge of a mesh, or nearer to one than the margin.

    A scan goes on where an open mesh ends, and what lies beyond its edge is all on one side: it would pull. The strip
    goes by places on the target alone, never by distances from it, so that leaving it out favours no side.
    """

    borders: Borders
    margin: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """0 at a border, else 1."""
        return np.where(self.borders.near(pairs.closest.points, self.margin), 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class OffRim:
    """Rejects pairs whose match is a rim point of a cloud."""

    surface: CloudSurface

    def __call__(self, pairs: Pairs) -> FloatArray:
        """0 on the rim, else 1."""
        return np.where(self.surface.on_rim(pairs.closest), 0.0, 1.0)


def inland(surface: Surface, width: float) -> tuple[Inland | OffRim, ...]:
    """The gate for a target that ends somewhere."""
    if isinstance(surface, CloudSurface):
        return (OffRim(surface),)
    borders = surface.borders if isinstance(surface, MeshSurface) else None
    return () if borders is None else (Inland(borders, STRIP * width),)


def beyond_border(pairs: Pairs, surface: Surface, width: float, reach: float) -> BoolArray:
    """Which pairs were left out because they end at a border of the target, (n,)."""
    out = np.zeros(len(pairs.distances), dtype=bool)
    for gate in inland(surface, width):
        out |= (gate(pairs) == 0.0) & (pairs.distances <= reach)
    return out
