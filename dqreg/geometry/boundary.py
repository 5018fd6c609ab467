"""Boundary of an open mesh, from its free edges, and of a cloud, from one-sided neighbourhoods."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._records import remember
from dqreg.geometry.neighbours import KEPT_NEIGHBOURS, NeighbourTree
from dqreg.geometry.normals import MIN_SPREAD_RATIO, sample_rows
from dqreg.kernels.threads import unlocked_property

# Pieces that the free edges are cut into, about, so that their middles can be looked up.
BOUNDARY_PIECES = 20_000
# Nearest pieces that are examined for each query.
LOOKED_AT = 6
# Free edges that are closer to each other than this fraction of the size, and parallel, are an unmerged seam and no
# boundary.
SEAM_DIAGONALS, PARALLEL_COS = 1e-4, 0.9
# The strip along the boundary takes at most about this fraction of the area.
STRIP_AREA_SHARE = 0.1


@dataclasses.dataclass(frozen=True)
class MeshBoundary:
    """Free edges of an open mesh, cut into short pieces."""

    # starts, ends: (k, 3): Ends of each piece
    starts: FloatArray
    ends: FloatArray
    widest: float  # Widest strip along the boundary that leaves nine tenths of the surface, a length

    @staticmethod
    def of(vertices: FloatArray, edges: IntArray, size: float, area: float) -> MeshBoundary | None:
        """Boundary of a mesh from the vertex numbers of its free edges, (k, 2), its size and its area."""
        if not len(edges):
            return None
        starts, ends = vertices[edges[:, 0]], vertices[edges[:, 1]]
        lengths = np.linalg.norm(ends - starts, axis=1)
        counts = np.maximum(np.ceil(lengths * BOUNDARY_PIECES / lengths.sum()), 1.0).astype(np.int64)
        edge = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = (ends - starts) / counts[:, None]
        low = starts[edge] + place[:, None] * step[edge]
        pieces = MeshBoundary(low, low + step[edge], 0.0)
        real = ~pieces._on_seams(edge, SEAM_DIAGONALS * size)
        if not real.any():
            return None
        length = float(np.linalg.norm(step[edge[real]], axis=1).sum())
        return MeshBoundary(low[real], low[real] + step[edge[real]], STRIP_AREA_SHARE * area / length)

    def near(self, points: FloatArray, margin: float) -> BoolArray:
        """Which points lie within a margin of the boundary."""
        allowed = min(margin, self.widest) + self._rounding
        found = np.zeros(len(points), dtype=bool)
        if not len(points):
            return found
        reach, pieces = self._tree.query(
            points, k=min(LOOKED_AT, len(self.starts)), distance_upper_bound=allowed + 0.5 * self._longest
        )
        reach, pieces = reach.reshape(len(points), -1), pieces.reshape(len(points), -1)
        rows, columns = np.nonzero(np.isfinite(reach))
        _, apart = self._feet(points[rows], pieces[rows, columns])
        found[rows[apart <= allowed]] = True
        return found

    def _feet(self, points: FloatArray, pieces: Any) -> tuple[FloatArray, FloatArray]:
        # How far along its piece the closest point of each place lies, not clipped, and the distance to the piece.
        starts, across = self.starts[pieces], self.ends[pieces] - self.starts[pieces]
        along = np.einsum("ij,ij->i", points - starts, across) / np.einsum("ij,ij->i", across, across)
        closest = starts + np.clip(along, 0.0, 1.0)[:, None] * across
        return along, np.linalg.norm(points - closest, axis=1)

    def _on_seams(self, edge: Any, tolerance: float) -> BoolArray:
        count = min(LOOKED_AT + 2, len(self.starts))
        _, others = self._tree.query(self._middles, k=count)
        others = others.reshape(len(edge), -1)
        mine = np.repeat(np.arange(len(edge)), others.shape[1])
        others = others.ravel()
        along, apart = self._feet(self._middles[mine], others)
        unit = (self.ends - self.starts) / np.linalg.norm(self.ends - self.starts, axis=1, keepdims=True)
        parallel = np.abs(np.einsum("ij,ij->i", unit[mine], unit[others])) > PARALLEL_COS
        beside = (along >= 0.0) & (along <= 1.0) & (apart <= tolerance) & parallel & (edge[mine] != edge[others])
        return np.bincount(mine[beside], minlength=len(edge)) > 0

    @cached_property
    def _middles(self) -> FloatArray:
        middles: FloatArray = 0.5 * (self.starts + self.ends)
        return middles

    @cached_property
    def _longest(self) -> float:
        return float(np.linalg.norm(self.ends - self.starts, axis=1).max())

    @cached_property
    def _rounding(self) -> float:
        return 1e-12 * float(np.abs(np.concatenate([self.starts, self.ends])).max())

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._middles)


# Mean of the neighbours that the tree remembers off the point, in the distance of the farthest: 0.42 where they fill a
# half disc, and above the limit for one point in thirteen of those that fill a disc by chance.
ONE_SIDED = 0.25
# Neighbours along a line, as on the rings of a LiDAR, show no side: ratio of the smaller to the larger variance, 0.28
# in a half disc.
LINE_VARIANCE_RATIO = 0.15
# A cloud of which more than this fraction lies in lines was swept, and ends everywhere; points of the sample. Every
# fifth of them decides where it shows less or more than these, three standard errors off: clouds came to 0.12 at most.
LINED_SHARE, LINED_SAMPLE = 0.2, 500
FIRST_STRIDE, UNCLEAR_SHARES = 5, (0.08, 0.34)
# Points whose neighbours are looked at, each amid a run along the order of space, which is wide enough to hold these:
# no tree is built for a glance.
RUN_COUNT, RUN_POINTS = 1_000, 100
# Neighbours that are on a point's own ring where rings are farther apart than the points on one.
NEIGHBOUR_COUNT = 8
# A cloud of which more than this share has its neighbours along a line lies in rings. Sweeps of 16 to 64 rings in rooms
# and on a road came to 0.2 to 0.9, cameras, range scans and simulated views of parts to 0.09 at most.
RING_SHARE = 0.15
# The same of how many more lines there are across some direction than normals along it, for less than this may be by
# chance. Halls with few rings on the floor came to 0.02 and more, flat plates before a camera to 0.004 at most.
BY_CHANCE = 0.01


class CloudBoundary:
    """Boundary points of a cloud, found on demand."""

    def __init__(self, tree: NeighbourTree, points: FloatArray) -> None:
        self._tree, self._points = tree, points
        self._rim = np.zeros(len(points), dtype=bool)
        self._known = np.zeros(len(points), dtype=bool)

    def at(self, rows: IntArray, normals: FloatArray) -> BoolArray:
        """Whether points lie on the boundary of the cloud."""
        if self.in_lines:
            return np.zeros(len(rows), dtype=bool)
        from dqreg.kernels.clouds.rims import known_rims

        found, lines = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=np.int64)
        count = known_rims(rows, self._rim, self._known, found, lines)
        if count:
            lines = lines[:count]
            unknown = rows[lines]
            # What is found depends on the cloud alone, so threads that meet here write the same.
            self._rim[unknown] = self._one_sided(unknown, normals[lines])
            self._known[unknown] = True
            known_rims(rows, self._rim, self._known, found, lines)
        return found

    def knowing(self, is_rim: BoolArray, known: BoolArray) -> CloudBoundary:
        """The same where it is known of some points whether they are of the rim, (n,)."""
        found = CloudBoundary(self._tree, self._points)
        return remember(found, _rim=is_rim, _known=known, in_lines=self.in_lines)

    def _one_sided(self, rows: IntArray, normals: FloatArray) -> BoolArray:
        from dqreg.kernels.clouds.rims import one_sided_rows
        from dqreg.kernels.threads import as_plain, over_chunks

        indices, farthest = self._tree.around(rows)
        found = np.zeros(len(rows), dtype=bool)
        if indices.shape[1] > 1:
            around = as_plain(self._points), rows, indices, farthest, as_plain(normals)
            over_chunks(one_sided_rows, len(rows), *around, ONE_SIDED, LINE_VARIANCE_RATIO, found)
        return found

    @unlocked_property
    def in_lines(self) -> bool:
        """Whether the cloud lies in lines, as of a LiDAR's rings."""
        rows = sample_rows(len(self._points), LINED_SAMPLE)
        first = self._in_lines(rows[::FIRST_STRIDE])
        return (first if not UNCLEAR_SHARES[0] < first < UNCLEAR_SHARES[1] else self._in_lines(rows)) > LINED_SHARE

    def _in_lines(self, rows: IntArray) -> float:
        """Share of some points whose neighbours lie along a line."""
        from dqreg.kernels.clouds.rims import line_rows
        from dqreg.kernels.threads import as_plain, over_chunks

        # Not remembered: a table for all points takes longer to begin than these few to find.
        indices = self._tree.nearest_to(rows, KEPT_NEIGHBOURS)[0].astype(np.int32)
        found = np.zeros(len(indices), dtype=bool)
        if indices.shape[1] > 1:
            over_chunks(line_rows, len(indices), as_plain(self._points), indices, LINE_VARIANCE_RATIO, found)
        return float(found.mean())


def lie_in_rings(points: FloatArray, order: IntArray) -> bool:
    """Whether points, (n, 3), lie in rings; an order of space, (n,), tells which are near each other.

    Neighbours along a line make no plane. Either many have such, or where a few rings graze a floor nothing else shows
    it, however many planes there are on walls: there is a direction that more lines lie across than normals along.
    Those of a grazed part that are wider than noise are planes still.
    """
    lined, axes, sums, _ = runs_of(points, order, NEIGHBOUR_COUNT)
    if not len(lined):
        return False
    # Copies of one point are no line.
    known = np.isfinite(axes[:, 0, 0])
    planes, count = known & ~lined, int(np.count_nonzero(known))
    if np.count_nonzero(known & lined) > RING_SHARE * count or not planes.any():
        return count > 0
    variance = np.median(sums[planes, 0]) / (NEIGHBOUR_COUNT - 3)
    thin = known & lined & (sums[:, 1] <= MIN_SPREAD_RATIO * NEIGHBOUR_COUNT * variance)
    lines, normals = axes[thin, 1], axes[planes, 0]
    excess = len(lines) * np.eye(3) - lines.T @ lines - normals.T @ normals
    return bool(np.linalg.eigvalsh(excess)[-1] > BY_CHANCE * count)


def runs_of(points: FloatArray, order: IntArray, count: int) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
    """Neighbourhoods of so many amid runs of points, see `lined_runs`, and the point in the middle of each, (m, 3)."""
    from dqreg.kernels.clouds.lined_runs import lined_runs
    from dqreg.kernels.threads import as_plain, over_chunks

    length = min(RUN_POINTS, len(order))
    begins = sample_rows(len(order) - length + 1, RUN_COUNT if length > count else 0)
    lined, axes, sums = np.zeros(len(begins), dtype=bool), np.zeros((len(begins), 2, 3)), np.zeros((len(begins), 2))
    given = as_plain(points), order, begins, length, count, LINE_VARIANCE_RATIO
    over_chunks(lined_runs, len(begins), *given, lined, axes, sums)
    return lined, axes, sums, np.take(points, order[begins + length // 2], axis=0)
