"""The nodes of the joint cost, with all that its matches ask of them made once."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Closest, CloudSurface, Scan, Surface

if TYPE_CHECKING:
    from dqreg.kernels.trees.point_tree import PointTree

# Residuals of a fitted plane beyond which it goes across an edge: in typical ones of its scan, and in spacings, which
# allows for what a round surface bends by between neighbours.
FIT_RESIDUAL_NOISE_RATIO, FIT_RESIDUAL_SPACINGS = 2.0, 0.1
# Neighbours of a point that is looked at, and how far they reach, at least, in what they do along one row.
ROW_NEIGHBOURS, MIN_ROW_REACH = 12, 0.9
# The nearest of them, and their largest width in lengths, of bends and noise.
CLOSEST_NEIGHBOURS, MAX_ROW_WIDTH_SHARE = 4, 0.2


@dataclasses.dataclass(frozen=True)
class Planed:
    """Points of a scan in Morton order, with their planes and their tree, as kernels take them."""

    points: FloatArray  # (n, 3)
    normals: FloatArray  # (n, 3): Zero where there is none
    variances: FloatArray  # (n,): Of the normals, rad^2
    roughness: FloatArray  # (n,): Residual of the plane around each point; infinite where there is none
    barred: BoolArray  # (n,): On the boundary, or without a normal: no target of a match
    tree: PointTree


@dataclasses.dataclass(frozen=True)
class Body:
    """A node of the joint cost: a scan that moves, or the part."""

    scan: Scan | None  # Its points; None for the part, which has planes only
    surface: Surface  # What the points of others are compared with
    origin: FloatArray  # (3,): Origin of the centred frame in its own

    @property
    def noise_floor(self) -> float:
        """Scale of distances that cannot be real."""
        return 1e-7 * self.surface.diagonal if self.scan is None else 1e-3 * self.scan.spacing

    @property
    def rough(self) -> float:
        """Residual of a fitted plane beyond which it goes across an edge."""
        assert self.scan is not None
        return max(FIT_RESIDUAL_NOISE_RATIO * self.scan.noise, FIT_RESIDUAL_SPACINGS * self.scan.spacing)

    @cached_property
    def planed(self) -> Planed:
        """Its points as targets and as sources."""
        from dqreg.kernels.threads import as_plain
        from dqreg.kernels.trees.point_tree import PointTree

        scan, surface = self.scan, self.surface
        assert scan is not None
        assert isinstance(surface, CloudSurface)
        points, normals = as_plain(scan.points), as_plain(surface.normals)
        rim = surface.on_rim(Closest(points, normals, np.zeros(len(points)), surface.order))
        rough = np.nan_to_num(scan.residuals, nan=np.inf)
        barred = np.asarray(rim | ~normals.any(axis=1))
        return Planed(points, normals, as_plain(surface.fitted[:, 3]), rough, barred, PointTree.of(points))

    @cached_property
    def spread(self) -> FloatArray:
        """Variance of the normal of each point of the scan, (n,); one that was given counts as exact."""
        assert self.scan is not None
        return self.scan._variances

    @cached_property
    def single(self) -> BoolArray:
        """Points whose neighbours are one row, (n,).

        Their normal is that of the bend of the row, as where rays hit a wall once on its way round, not of a face.
        """
        points, alone = self.planed.points, np.zeros(len(self.planed.points), dtype=bool)
        near, distances = self.planed.tree.nearest(points, ROW_NEIGHBOURS + 1)
        if distances.shape[1] <= ROW_NEIGHBOURS:
            return alone
        far = np.flatnonzero(
            distances[:, ROW_NEIGHBOURS] > MIN_ROW_REACH * 0.25 * ROW_NEIGHBOURS * (distances[:, 1] + distances[:, 2])
        )
        # Without a width: a strip of a face has rows that neighbours tell apart, or points anywhere.
        nearest = points[near[far, : CLOSEST_NEIGHBOURS + 1]]
        extents = np.linalg.svd(nearest - nearest.mean(axis=1, keepdims=True), compute_uv=False)
        alone[far] = extents[:, 1] < MAX_ROW_WIDTH_SHARE * extents[:, 0]
        return alone

    def rows(self, count: int) -> IntArray:
        """Rows of so many points of the scan at most, evenly taken."""
        assert self.scan is not None
        return np.arange(len(self.scan)) if count >= len(self.scan) else self.scan.even_rows(count)
