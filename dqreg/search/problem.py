"""One global registration: what is given, what follows from it, and the tools that its stages share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.icp import IcpSettings, smallest_kernel_scale
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.search.axes import moments
from dqreg.search.features import even_points, scan_features
from dqreg.search.grids import OccupancyGrid
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refine
from dqreg.search.scoring import OUTLIER_DISTANCE_SHARE, PoseScores, score_poses, symmetric_scores

# A scan so many times larger than the target is a scene with the part in it.
SCENE_RATIO = 1.3
# Gain of a point at an edge, where that of a point on a face is 1.
EDGE_GAIN = 0.5
# Smallest width of the distances of two clouds, in sizes.
CLOUD_WIDTH = 1e-3
# Points of the part alone, with outliers around it or not, have a root mean square distance from their centre below
# this fraction of its diagonal, in any frame.
PART_SPREAD = 0.5
# Log-likelihood that a pose loses for each point that rays of the other scan passed through: few pass a wall.
PASSED_LOG_LIKELIHOOD = 3.0
# Points of the target that score the other way round.
TARGET_POINTS = 4_000


# Share of the points of two scans that rays passed through at some poses, (k, 4, 4), which are as exact as a length.
Through = Callable[[FloatArray, float], FloatArray]


@dataclasses.dataclass(frozen=True)
class SearchProblem:
    """A scan to be registered to a target without an initial pose."""

    scan: Scan  # Source
    surface: Surface  # Target
    target: PointCloud | Mesh  # The same target
    plan: IcpSettings  # Parts of the ICP loop and its largest distance
    make_table: Callable[[], PairTable]  # Makes the target's pairs; called once, when they are first needed
    rng: np.random.Generator  # Draws the samples
    through: Through | None = None  # What rays passed through at poses, of two scans from known places
    # Poses that were compared before, the best first: others are looked for
    known: Poses = dataclasses.field(default_factory=lambda: Poses(np.zeros((0, 3, 3)), np.zeros((0, 3))))

    @cached_property
    def table(self) -> PairTable:
        """The target's pairs."""
        return self.make_table()

    @cached_property
    def points(self) -> OrientedPoints:
        """Oriented points of the scan."""
        return scan_features(self.scan, self.size)

    @property
    def size(self) -> float:
        """Unit of lengths: the target's diagonal, or that of a scan that is smaller than a cloud."""
        if isinstance(self.target, Mesh):
            return self.surface.diagonal
        return min(self.surface.diagonal, self.scan.diagonal)

    @cached_property
    def occupancy(self) -> OccupancyGrid | None:
        """For the other way round, where much of the scan need not lie on the target."""
        if isinstance(self.target, Mesh) and self.scan.diagonal <= SCENE_RATIO * self.surface.diagonal:
            return None
        return OccupancyGrid(self.scan.points, self.size)

    @cached_property
    def faces(self) -> OrientedPoints:
        """Points on the faces of the scan."""
        return self.points.faces

    @cached_property
    def other_way(self) -> tuple[OrientedPoints, Surface] | None:
        """Points of the target, and the scan as their surface; None for the scan of one part on its mesh."""
        spread = float(np.sqrt(np.trace(moments(self.scan)[1])))
        if isinstance(self.target, Mesh) and spread <= PART_SPREAD * self.surface.diagonal:
            return None
        scan = PointCloud(self.scan.points)
        return even_points(self.target, self.surface, TARGET_POINTS), CloudSurface(scan, derived=True)

    @cached_property
    def middle(self) -> FloatArray:
        """Mean of the scan's points, (3,)."""
        return np.asarray(self.scan.points.mean(axis=0))

    @property
    def last_width(self) -> float:
        """Smallest width at the end, in sizes."""
        return 0.0 if isinstance(self.target, Mesh) else CLOUD_WIDTH

    @property
    def limit(self) -> float:
        """Distance beyond which a point is an outlier."""
        return OUTLIER_DISTANCE_SHARE * self.plan.max_distance

    def order(self, poses: Poses, count: int, reach: float, least: float = 0.0, most: int | None = None) -> IntArray:
        """Rows by falling gain on the grids, for so many scan points and this reach in sizes; so many at most.

        Of the scan of one part without those that gain less than a share of the best: elsewhere outliers decide.
        """
        sample, table = self.sample(count), self.table
        gains = table.grid.scores(poses, sample.faces.points, reach * self.size)
        if table.edges is not None and sample.is_edge.any():
            gains = gains + EDGE_GAIN * table.edges.grid.scores(poses, sample.edges.points, reach * self.size)
        if self.occupancy is not None:
            there = table.points.sample(count, self.rng)
            gains = gains + self.occupancy.scores(poses, there.faces.points)
        rows = _falling(gains, len(gains) if most is None else most)
        is_part = isinstance(self.target, Mesh) and self.other_way is None
        return rows[gains[rows] >= least * gains[rows[0]]] if is_part and len(rows) else rows

    def refined(
        self,
        poses: Poses,
        sample: OrientedPoints,
        widths: tuple[float, float, int],
        surface: Surface | None = None,
    ) -> Poses:
        """All poses after a step at each width: first, last, in sizes, and their number."""
        first, last, steps = widths
        falling = Refinement(first, steps, last=last).widths(self.size)
        return refine(poses, sample, self.surface if surface is None else surface, falling, self.table.edges)

    def sample(self, count: int) -> OrientedPoints:
        """So many points of the scan on faces, and a third as many at edges."""
        return self.points.sample(count, self.rng)

    def sample_without_normals(self, count: int) -> OrientedPoints:
        """Points of the whole scan, and rare ones: where the width is small, normals need not agree."""
        rare = self.sample(count // 2)
        return OrientedPoints.on_faces(np.concatenate([self.scan.thinned(count // 2).points, rare.points]))

    def scores(self, poses: Poses, count: int, floor: float) -> PoseScores:
        """Likelihood of so many points under each pose, for a smallest width in sizes.

        Where much of the scan need not lie on the target, as many points of the target are scored the other way round:
        a face of the part on the table explains more of a scene than the correct pose, but less of the part.
        """
        if self.other_way is None:
            return self.scores_of_scan(poses, count, floor)
        least = max(smallest_kernel_scale(self.scan, self.surface), floor * self.size)
        width = max(2.0 * self.scan.noise, self.scan.spacing, least)
        even, surface = self.other_way
        here, there = (side[sample_rows(len(side), count)] for side in (self.faces, even))
        # Points of the scan lie on a part's faces to within the noise; those of the part between points of the scan.
        is_mesh = isinstance(self.target, Mesh)
        on_faces = max(2.0 * noise_on(self.scan, self.surface), least) if is_mesh else width
        return symmetric_scores(
            score_poses(poses, here.points, self.surface, self.limit, on_faces, here.directions),
            score_poses(poses.inverse, there.points, surface, self.limit, width, there.directions),
        )

    def scores_of_scan(self, poses: Poses, count: int, floor: float) -> PoseScores:
        """The same of points of the scan alone."""
        least = max(smallest_kernel_scale(self.scan, self.surface), floor * self.size)
        points = self.scan.points[sample_rows(len(self.scan), count)]
        return score_poses(poses, points, self.surface, self.limit, least)

    def ranked(self, poses: Poses, count: int, floor: float, margin: float, least: int = 0) -> Poses:
        """By falling likelihood; without those that are too far behind, but so many in any case."""
        if not len(poses):
            return poses
        means = self.scores(poses, count, floor).means - PASSED_LOG_LIKELIHOOD * self.passed(poses, floor)
        order = np.argsort(-means, kind="stable")
        near = means[order] >= means[order[0]] - margin
        near[:least] = True
        return poses[order[near]]

    def passed(self, poses: Poses, floor: float) -> FloatArray:
        """Share of the points that rays passed through at each pose, by a smallest width in sizes; 0 where unknown."""
        if self.through is None or not len(poses):
            return np.zeros(len(poses))
        return self.through(poses.matrices, floor * self.size)

    def distinct(self, poses: Poses, apart: tuple[float, float], most: int) -> Poses:
        """The first ones that differ by more than an angle in radians or a distance in sizes."""
        return poses[poses.distinct(self.middle, apart[0], apart[1] * self.size, most)]

    def unknown(self, poses: Poses, apart: tuple[float, float]) -> Poses:
        """Those that differ so much from all known ones, by an angle in radians or a distance in sizes."""
        if not len(self.known):
            return poses
        return poses[np.flatnonzero(~poses.beside(self.known, self.middle, apart[0], apart[1] * self.size))]

    def elsewhere(self, poses: Poses, apart: tuple[float, float]) -> Poses:
        """The same after the best known one, which they are compared with; none where there is no other."""
        others = self.unknown(poses, apart)
        return self.known.first(1) + others if len(others) else others


def _falling(values: FloatArray, most: int) -> IntArray:
    """Rows of the largest values, so many, the largest first; of equal ones the first first."""
    rows = np.arange(len(values))
    if len(values) > most > 0:
        # Few of tens of thousands: to sort all of them takes as long as to score half of them.
        rows = np.flatnonzero(values >= np.partition(values, -most)[-most])
    return np.asarray(rows[np.argsort(-values[rows], kind="stable")[:most]])
