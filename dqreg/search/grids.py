"""Regular grids, on which tens of thousands of poses are screened by a few points each.

- `DistanceGrid`: the distance to the target at the nearest node.
- `PlaneGrid`: the tangent plane at the point closest to the nearest node. While a pose is still a hundredth of the
  size off, that is as good as the closest point itself, for a hundredth of the time.
- `OccupancyGrid`: the other way round, how much of the target lies on the scan. A scan that is a scene, or that
  overlaps a cloud only in part, has most of its points elsewhere: by these alone, any pose that puts a large face on a
  large face of the target scores well.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.surface import Closest, Hint
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses

# Single precision: a hundredth of a cell is all that is needed.
Single = npt.NDArray[np.float32]
# Nodes of a grid, and room around the target in sizes.
NODES, MARGIN = 300_000, 0.05
# Places looked up in one go: some milliseconds.
LOOKED_UP = 131_072


class Grid:
    """Regular nodes in a box; values are looked up at the nearest one."""

    def __init__(self, low: FloatArray, high: FloatArray, cell: float) -> None:
        self.low, self.cell = low, cell
        self.shape = np.ceil((high - low) / cell).astype(np.int64) + 1

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape))

    def nodes(self, points: FloatArray) -> IntArray:
        """Nearest node of each point, (n,); the number of all nodes stands for "outside"."""
        return self._flat(((points - self.low) / self.cell + 0.5).astype(np.float32).T)

    def mean_gains(self, poses: Poses, points: FloatArray, gains: Single) -> FloatArray:
        """Mean gain of the points under each pose, (n,); gains (count + 1,)."""
        from dqreg.kernels.many_poses import mean_gains
        from dqreg.kernels.threads import as_plain, over_chunks

        means = np.zeros(len(poses))
        if len(points):
            cells = as_plain(poses.R / self.cell), as_plain((poses.t - self.low) / self.cell + 0.5)
            looked_up = *cells, as_plain(points), self.shape, gains, means
            over_chunks(mean_gains, len(poses), *looked_up, chunk=max(LOOKED_UP // len(points), 1))
        return means

    def _flat(self, moved: Single) -> IntArray:
        """Row of the node, of points in cells, (3, ...)."""
        inside = (moved >= 0.0).all(axis=0)
        node = np.where(inside, moved, np.float32(0.0)).astype(np.int32)
        for k in range(3):
            inside &= node[k] < self.shape[k]
        flat = (node[0] * np.int32(self.shape[1]) + node[1]) * np.int32(self.shape[2]) + node[2]
        return np.where(inside, flat, np.int32(self.count))


class DistanceGrid(Grid):
    """Distances on a regular grid, looked up at the nearest node."""

    def __init__(
        self, distance: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, size: float
    ) -> None:
        room = MARGIN * size
        cell = float(np.prod(high - low + 2.0 * room) / NODES) ** (1.0 / 3.0)
        super().__init__(low - room, high + room, cell)
        axes = [self.low[k] + self.cell * np.arange(self.shape[k]) for k in range(3)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self.distances = distance(places).astype(np.float32)

    def scores(self, poses: Poses, points: FloatArray, reach: float) -> FloatArray:
        """Mean of ``1 - (d / reach)^2`` over the points, 0 beyond the reach, for each pose, (n,)."""
        gains = np.append(np.maximum(1.0 - (self.distances / np.float32(reach)) ** 2, 0.0), np.float32(0.0))
        return self.mean_gains(poses, points, gains)


@dataclasses.dataclass(frozen=True)
class Edges:
    """Points at the edges of a target, to be asked for the closest one exactly or on a grid."""

    points: FloatArray  # (m, 3), m > 0
    tree: NeighbourTree
    grid: DistanceGrid
    held: npt.NDArray[np.int32]  # (nodes,): Row of the point closest to each node of the grid

    @staticmethod
    def of(points: FloatArray, low: FloatArray, high: FloatArray, size: float) -> Edges:
        """Edge points of a target in a box."""
        tree, held = NeighbourTree(points), np.zeros(0, dtype=np.int32)

        def distances(nodes: FloatArray) -> FloatArray:
            nonlocal held
            rows, found = tree.nearest(nodes, 1)
            held = rows[:, 0].astype(np.int32)
            return found[:, 0]

        grid = DistanceGrid(distances, low, high, size)
        return Edges(points, tree, grid, held)

    def closest(self, points: FloatArray, *, on_grid: bool) -> tuple[FloatArray, FloatArray]:
        """The closest point at an edge, (n, 3), and its distance, (n,); or that of the nearest node.

        On the grid the distance is infinite outside of it.
        """
        if not on_grid:
            rows, distances = self.tree.nearest(points, 1)
            return np.take(self.points, rows[:, 0], axis=0), distances[:, 0]
        from dqreg.kernels.pose_steps import grid_places
        from dqreg.kernels.threads import as_plain, over_chunks

        places, found, grid = np.zeros((len(points), 3)), np.zeros(len(points)), self.grid
        asked = as_plain(points), as_plain(grid.low), grid.cell, grid.shape, self.held, as_plain(self.points)
        over_chunks(grid_places, len(points), *asked, places, found)
        return places, found


# At nodes closer to the surface than this, in sizes, planes are exact; at the others those of a dense sample do.
EXACT_WITHIN = 0.025


class PlaneGrid(DistanceGrid):
    """Distances and tangent planes on a regular grid."""

    def __init__(self, surface: Surface, even: OrientedPoints, low: FloatArray, high: FloatArray) -> None:
        self.diagonal, self.centre, self.oriented = surface.diagonal, surface.centre, surface.oriented
        places, normals = even.points, even.directions
        tree = NeighbourTree(places)
        planes = np.zeros((0, 6), dtype=np.float32)

        def distances(nodes: FloatArray) -> FloatArray:
            nonlocal planes
            rows, found = tree.nearest(nodes, 1)
            # What lies outside is on no plane: the last row.
            planes = np.zeros((len(nodes) + 1, 6), dtype=np.float32)
            planes[:-1, :3], planes[:-1, 3:] = places[rows[:, 0]], normals[rows[:, 0]]
            distances = found[:, 0]
            near = np.flatnonzero(distances < EXACT_WITHIN * surface.diagonal)
            asked = surface.closest(nodes[near])
            planes[near, :3], planes[near, 3:], distances[near] = asked.points, asked.normals, asked.distances
            return distances

        super().__init__(distances, low, high, surface.diagonal)
        self._planes = planes

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Foot on the tangent plane, its normal, and the distance; infinite outside the grid, (n, 3) each."""
        from dqreg.kernels.pose_steps import grid_planes
        from dqreg.kernels.threads import as_plain, over_chunks

        feet, normals = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        distances, nodes = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
        grid = as_plain(self.low), self.cell, self.shape, self._planes
        over_chunks(grid_planes, len(points), as_plain(points), *grid, feet, normals, distances, nodes)
        return Closest(feet, normals, distances, nodes)


# Cell in sizes, and cells at most.
CELL, CELLS = 0.02, 30_000_000
# Gain by the number of axes along which a cell is beside one that holds a point.
GAINS = np.array([1.0, 0.7, 0.4, 0.3], dtype=np.float32)


class OccupancyGrid(Grid):
    """Which cells of space hold points of a scan, their neighbours a little as well."""

    def __init__(self, points: FloatArray, size: float) -> None:
        low, high = bounds(points)
        cell = max(CELL * size, float(np.prod(np.maximum(high - low, size)) / CELLS) ** (1.0 / 3.0))
        super().__init__(low - 2.0 * cell, high + 2.0 * cell, cell)
        self.gains = np.zeros(self.count + 1, dtype=np.float32)
        held = np.unique(self.nodes(points))
        strides = np.array([self.shape[1] * self.shape[2], self.shape[2], 1])
        steps = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
        sides = np.abs(steps).sum(axis=1)
        # The nearer ones last: they overwrite.
        for step, beside in sorted(zip(steps @ strides, sides, strict=True), key=lambda pair: -int(pair[1])):
            self.gains[held + step] = GAINS[beside]

    def scores(self, poses: Poses, points: FloatArray) -> FloatArray:
        """Mean gain of target points, moved onto the scan by the inverse of each pose, (n,)."""
        return self.mean_gains(poses.inverse, points, self.gains)
