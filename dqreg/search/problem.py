"""One search for a start: what is given, what follows from it, and the tools that its stages share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.icp import Plan, width_floor
from dqreg.search.axes import moments
from dqreg.search.features import Features, even_places, scan_features
from dqreg.search.grids import Occupancy, distinct
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Poses
from dqreg.search.refine import Sample, refine
from dqreg.search.scoring import Judgement, both_ways, weigh_up

# A scan so many times larger than the target is a scene with the part in it.
SCENE = 1.3
# A point at a rim counts half a point on a face.
RIM_GAIN = 0.5
# Poses that are kept in any case where those that are too far behind are dropped.
KEPT_ANYWAY = 3
# Smallest width of the distances of two clouds, in sizes.
LAST_WIDTH = 1e-3
# Points of the part alone, with strays around it or not, spread less than this share of its diagonal, in any frame.
MUCH_ELSE = 0.5
# Places of the target that judge the other way round.
BOTH_WAYS = 4_000


@dataclasses.dataclass(frozen=True)
class Places:
    """Points with normals of either sign, zero where unknown, (n, 3) each, in Morton order."""

    points: FloatArray
    normals: FloatArray

    def taken(self, rows: IntArray) -> Places:
        """Some of them."""
        return Places(self.points[rows], self.normals[rows])


@dataclasses.dataclass(frozen=True)
class Task:
    """A scan to be put on a target."""

    scan: Scan  # Source
    surface: Surface  # Target
    target: PointCloud | Mesh  # The same target
    plan: Plan  # Parts of the loop and its largest distance
    make_table: Callable[[], PairTable]  # Gives the target's pairs; asked once, when they are first needed
    rng: np.random.Generator  # Draws the samples

    @cached_property
    def table(self) -> PairTable:
        """The target's pairs."""
        return self.make_table()

    @cached_property
    def places(self) -> Features:
        """Faces and rims of the scan."""
        return scan_features(self.scan, self.size)

    @cached_property
    def edge_tree(self) -> NeighbourTree | None:
        """Of the target's rims, where there are any."""
        return NeighbourTree(self.table.edges) if len(self.table.edges) else None

    @property
    def size(self) -> float:
        """Unit of lengths: the target's diagonal, or that of a scan that is smaller than a cloud."""
        if isinstance(self.target, Mesh):
            return self.surface.diagonal
        return min(self.surface.diagonal, self.scan.diagonal)

    @cached_property
    def occupancy(self) -> Occupancy | None:
        """For the other way round, where much of the scan need not lie on the target."""
        if isinstance(self.target, Mesh) and self.scan.diagonal <= SCENE * self.surface.diagonal:
            return None
        return Occupancy(self.scan.points, self.size)

    @cached_property
    def faces(self) -> Places:
        """Places on the faces of the scan."""
        rows = np.flatnonzero(~self.places.is_rim)
        return Places(self.places.points[rows], self.places.directions[rows])

    @property
    def spread(self) -> float:
        """Root mean square distance of the scan's points from their middle."""
        return float(np.sqrt(np.trace(moments(self.scan)[1])))

    @cached_property
    def other_way(self) -> tuple[Places, Surface] | None:
        """Places of the target, and the scan as what they may lie on; None for the scan of one part on its mesh."""
        if isinstance(self.target, Mesh) and self.spread <= MUCH_ELSE * self.surface.diagonal:
            return None
        scan = PointCloud(self.scan.points)
        return Places(*even_places(self.target, self.surface, BOTH_WAYS)), CloudSurface(scan)

    @property
    def last_width(self) -> float:
        """Smallest width at the end, in sizes."""
        return 0.0 if isinstance(self.target, Mesh) else LAST_WIDTH

    @property
    def limit(self) -> float:
        """Distance beyond which a point tells nothing more."""
        return 0.25 * self.plan.max_distance

    def order(self, poses: Poses, count: int, reach: float) -> IntArray:
        """Rows by falling gain on the grids, for so many scan points and this reach in sizes."""
        sample, table = Sample.of(self.places, count, self.rng), self.table
        gains = table.grid.scores(poses.R, poses.t, sample.points, reach * self.size)
        if table.edge_grid is not None and len(sample.rims):
            gains = gains + RIM_GAIN * table.edge_grid.scores(poses.R, poses.t, sample.rims, reach * self.size)
        if self.occupancy is not None:
            there = Sample.of(table.features, count, self.rng)
            gains = gains + self.occupancy.scores(poses.R, poses.t, there.points)
        return np.argsort(-gains, kind="stable")

    def refined(
        self,
        poses: Poses,
        sample: Sample,
        widths: tuple[float, float, int],
        surface: Surface | None = None,
        rims: bool = True,
    ) -> Poses:
        """All poses after a step at each width: first, last, in sizes, and their number."""
        first, last, steps = widths
        falling = np.geomspace(first, last, steps) * self.size
        tree = self.edge_tree if rims else None
        on = self.surface if surface is None else surface
        return Poses(*refine(poses.R, poses.t, sample, on, tree, falling, self.table.edges))

    def everywhere(self, count: int) -> Sample:
        """Points of the whole scan, and rare ones: where the width is small, no normal need speak for a point."""
        some = Sample.of(self.places, count // 2, self.rng)
        points = np.concatenate([self.scan.thinned(count // 2).points, some.points, some.rims])
        return Sample(points, np.zeros_like(points), points[:0], points[:0])

    def judgement(self, poses: Poses, count: int, floor: float) -> Judgement:
        """Likelihood of so many points under each pose, for a smallest width in sizes.

        Where much of the scan need not lie on the target, as many places of the target are judged the other way round:
        a face of the part on the table explains more of a scene than the part in its place does, but less of the part.
        """
        least = max(width_floor(self.scan, self.surface), floor * self.size)
        width = max(2.0 * self.scan.noise, self.scan.spacing, least)
        if self.other_way is None:
            points = self.scan.points[sample_rows(len(self.scan), count)]
            return weigh_up(poses.R, poses.t, points, self.surface, self.limit, least)
        places, surface = self.other_way
        here, there = (side.taken(sample_rows(len(side.points), count)) for side in (self.faces, places))
        back = poses.inverse
        judgements = (
            weigh_up(poses.R, poses.t, here.points, self.surface, self.limit, width, here.normals),
            weigh_up(back.R, back.t, there.points, surface, self.limit, width, there.normals),
        )
        return both_ways(*judgements)

    def ranked(self, poses: Poses, count: int, floor: float, margin: float, least: int = 0) -> Poses:
        """By falling likelihood; without those that are too far behind, but so many in any case."""
        if not len(poses):
            return poses
        means = self.judgement(poses, count, floor).means
        order = np.argsort(-means, kind="stable")
        near = means[order] >= means[order[0]] - margin
        near[:least] = True
        return poses[order[near]]

    def distinct(self, poses: Poses, apart: tuple[float, float], most: int) -> Poses:
        """The first ones that stand apart, in radians and sizes."""
        middle = self.scan.points.mean(axis=0)
        return poses[distinct(poses.R, poses.t, middle, apart[0], apart[1] * self.size, most)]


def nearly_same(poses: Poses, T: FloatArray) -> Poses:
    """Each pose followed by each of some motions of the target, (k, 4, 4)."""
    return Poses(
        np.concatenate([M[:3, :3] @ poses.R for M in T]),
        np.concatenate([poses.t @ M[:3, :3].T + M[:3, 3] for M in T]),
    )
