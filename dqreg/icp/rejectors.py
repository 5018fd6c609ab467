"""Weights of pairs: each is a small callable from `Pairs` to (n,) factors; factors multiply, zero rejects."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.surface import Surface
from dqreg.icp.correspondences import Pairs
from dqreg.solvers.robust import Kernel

Weight = Callable[[Pairs], FloatArray]


@dataclasses.dataclass(frozen=True)
class WithinDistance:
    """Rejects pairs farther apart than the limit, a length in the target's unit."""

    limit: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 within the limit, else 0."""
        return np.where(pairs.distances <= self.limit, 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class NormalAngle:
    """Rejects pairs whose normals differ by more than the limit; pairs without a normal on either side pass.

    Where the sign of either normal is unknown, the angle between the lines counts, 0 to 90 degrees.
    """

    limit_rad: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 within the limit or where there is nothing to compare, else 0."""
        rows = np.flatnonzero(pairs.scan.directed)
        factors = np.ones(len(pairs.distances))
        cosines = pairs.normal_cosines[rows] if pairs.same_sign else np.abs(pairs.normal_cosines[rows])
        known = pairs.closest.normals[rows].any(axis=1)
        factors[rows] = np.where((cosines >= np.cos(self.limit_rad)) | ~known, 1.0, 0.0)
        return factors


@dataclasses.dataclass(frozen=True)
class Robust:
    """Weighs pairs by a robust kernel of their distance."""

    kernel: Kernel

    def __call__(self, pairs: Pairs) -> FloatArray:
        """The kernel's weights."""
        return self.kernel.weight(pairs.distances)


@dataclasses.dataclass(frozen=True)
class Trimmed:
    """Keeps the given share of the pairs, the closest ones (Chetverikov et al. 2002)."""

    share: float

    def __call__(self, pairs: Pairs) -> FloatArray:
        """1 for the closest pairs, else 0."""
        keep = int(np.ceil(self.share * len(pairs.distances)))
        weights = np.zeros(len(pairs.distances))
        weights[np.argsort(pairs.distances, kind="stable")[:keep]] = 1.0
        return weights


def product(weights: Sequence[Weight], pairs: Pairs) -> FloatArray:
    """Product of all factors for each pair."""
    total = np.ones(len(pairs.distances))
    for weight in weights:
        total *= weight(pairs)
    return total


# Widths from a free edge within which noise alone decides whether the closest place is on it.
STRIP = 3.0


@dataclasses.dataclass(frozen=True)
class Inland:
    """Rejects pairs whose closest place lies on a free edge of a mesh, or nearer to one than the margin.

    A scan goes on where an open mesh ends, and what lies beyond its edge is all on one side: it would pull. The strip
    goes by places on the target alone, never by distances from it, so that leaving it out favours no side.
    """

    borders: MeshBoundary
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
