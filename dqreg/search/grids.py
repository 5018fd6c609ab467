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

import numpy as np
import numpy.typing as npt

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.surface import Closest, Hint
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses

# Single precision: a hundredth of a cell is all that is needed.
Single = npt.NDArray[np.float32]
Rows = npt.NDArray[np.int32]
# Nodes of a grid, and room around the target in sizes.
GRID_NODES, MARGIN_DIAGONALS = 300_000, 0.05
# What the nodes of a grid with cells so many times halved hold is asked of a tree, and handed down.
NODE_HALVINGS = 2
# Places looked up in one go: some milliseconds; slabs of nodes that are.
PLACES_AT_ONCE, CHUNK_SLABS = 131_072, 8


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
        from dqreg.kernels.search.many_poses import mean_gains
        from dqreg.kernels.threads import as_plain, over_chunks

        means = np.zeros(len(poses))
        if len(points):
            looked_up = *self._in_cells(poses), as_plain(points), self.shape, gains, means
            over_chunks(mean_gains, len(poses), *looked_up, chunk=max(PLACES_AT_ONCE // len(points), 1))
        return means

    def _in_cells(self, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Rotations and shifts that lead to cells, half a cell further, so that cutting off rounds."""
        from dqreg.kernels.threads import as_plain

        return as_plain(poses.R / self.cell), as_plain((poses.t - self.low) / self.cell + 0.5)

    def _flat(self, moved: Single) -> IntArray:
        """Row of the node, of points in cells, (3, ...)."""
        inside = (moved >= 0.0).all(axis=0)
        node = np.where(inside, moved, np.float32(0.0)).astype(np.int32)
        for k in range(3):
            inside &= node[k] < self.shape[k]
        flat = (node[0] * np.int32(self.shape[1]) + node[1]) * np.int32(self.shape[2]) + node[2]
        return np.where(inside, flat, np.int32(self.count))


class DistanceGrid(Grid):
    """Distances to points on a regular grid, looked up at the nearest node: good to a fraction of a cell."""

    def __init__(
        self, points: FloatArray, low: FloatArray, high: FloatArray, size: float, *, exact: bool = False
    ) -> None:
        room = MARGIN_DIAGONALS * size
        cell = float(np.prod(high - low + 2.0 * room) / GRID_NODES) ** (1.0 / 3.0)
        super().__init__(low - room, high + room, cell)
        from dqreg.kernels.threads import as_plain

        cells = as_plain((points - self.low) / self.cell)
        self.held, squares = self._nearest(cells) if exact else self._held(cells)
        self.distances = self.cell * np.sqrt(squares, dtype=np.float32)

    def _nearest(self, cells: FloatArray) -> tuple[Rows, Single]:
        """Row of the point nearest to each node, and the square of its distance in cells, (nodes,)."""
        from dqreg.kernels.search.nearest_at_nodes import SIDE, nearest_at_nodes
        from dqreg.kernels.threads import over_chunks

        held, squares = np.zeros(self.count, dtype=np.int32), np.zeros(self.count, dtype=np.float32)
        blocks = int(np.prod(-(-self.shape // SIDE)))
        over_chunks(nearest_at_nodes, blocks, cells, self.shape, held, squares, chunk=1)
        return held, squares

    def _held(self, cells: FloatArray) -> tuple[Rows, Single]:
        """Row of a point about nearest to each node, and the square of its distance in cells, (nodes,).

        That of a grid with cells so many times halved, handed down.
        """
        from dqreg.kernels.search.coarse_to_fine_nearest import nearest_at_corners, nearest_from_coarser
        from dqreg.kernels.threads import over_chunks

        shapes = [self.shape]
        for _ in range(NODE_HALVINGS):
            shapes.append(shapes[-1] // 2 + 1)
        nodes = np.stack(np.unravel_index(np.arange(np.prod(shapes[-1])), shapes[-1]), axis=1)
        rows, away = NeighbourTree(cells).nearest(np.asarray(nodes * 2.0**NODE_HALVINGS, dtype=np.float64), 1)
        held, squares = rows[:, 0].astype(np.int32), (away[:, 0] ** 2).astype(np.float32)
        for level in range(NODE_HALVINGS - 1, -1, -1):
            known, shape, scaled = held, shapes[level], cells / 2.0**level
            held, squares = np.full(np.prod(shape), -1, dtype=np.int32), np.full(np.prod(shape), np.inf, np.float32)
            nearest_at_corners(scaled, shape, held, squares)
            grids = scaled, shape, shapes[level + 1], known
            over_chunks(nearest_from_coarser, int(shape[0]), *grids, held, squares, chunk=CHUNK_SLABS)
        return held, squares

    def are_within(self, poses: Poses, points: FloatArray, limit: float) -> BoolArray:
        """Under which poses, (n,), no point is farther off than the limit, by the distance of its nearest node."""
        from dqreg.kernels.search.many_poses import poses_within
        from dqreg.kernels.threads import as_plain, over_chunks

        found = np.zeros(len(poses), dtype=bool)
        asked = *self._in_cells(poses), as_plain(points), self.shape, self.distances, float(limit), found
        over_chunks(poses_within, len(poses), *asked, chunk=max(PLACES_AT_ONCE // len(points), 1))
        return found

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

    @staticmethod
    def of(points: FloatArray, low: FloatArray, high: FloatArray, size: float) -> Edges:
        """Edge points of a target in a box."""
        # Edges are few, and which is the nearest decides.
        return Edges(points, NeighbourTree(points), DistanceGrid(points, low, high, size, exact=True))

    def closest(self, points: FloatArray, *, on_grid: bool) -> tuple[FloatArray, FloatArray]:
        """The closest point at an edge, (n, 3), and its distance, (n,); or that of the nearest node.

        On the grid the distance is infinite outside of it.
        """
        if not on_grid:
            rows, distances = self.tree.nearest(points, 1)
            return np.take(self.points, rows[:, 0], axis=0), distances[:, 0]
        from dqreg.kernels.search.pose_steps import grid_places
        from dqreg.kernels.threads import as_plain, over_chunks

        places, found, grid = np.zeros((len(points), 3)), np.zeros(len(points)), self.grid
        asked = as_plain(points), as_plain(grid.low), grid.cell, grid.shape, grid.held, as_plain(self.points)
        over_chunks(grid_places, len(points), *asked, places, found)
        return places, found


# At nodes closer to the surface than this, in sizes, planes are exact; at the others those of a dense sample do.
EXACT_DIAGONALS = 0.025


class PlaneGrid(DistanceGrid):
    """Distances and tangent planes on a regular grid."""

    def __init__(self, surface: Surface, even: OrientedPoints, low: FloatArray, high: FloatArray) -> None:
        from dqreg.kernels.search.coarse_to_fine_nearest import planes_at_nodes
        from dqreg.kernels.threads import as_plain, over_chunks

        super().__init__(even.points, low, high, surface.diagonal)
        self.diagonal, self.centre, self.oriented = surface.diagonal, surface.centre, surface.oriented
        near = np.flatnonzero(self.distances < EXACT_DIAGONALS * surface.diagonal)
        nodes = np.stack(np.unravel_index(near, self.shape), axis=1)
        asked = surface.closest(self.low + self.cell * nodes)
        # They hold places of their own, after those of the sample.
        self.held[near], self.distances[near] = len(even) + np.arange(len(near)), asked.distances
        known = [np.concatenate(columns) for columns in ((even.points, asked.points), (even.directions, asked.normals))]
        # What lies outside is on no plane: the last row.
        self._planes = np.zeros((self.count + 1, 6), dtype=np.float32)
        over_chunks(planes_at_nodes, self.count, self.held, *map(as_plain, known), self._planes)

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Foot on the tangent plane, its normal, and the distance; infinite outside the grid, (n, 3) each."""
        from dqreg.kernels.search.pose_steps import grid_planes
        from dqreg.kernels.threads import as_plain, over_chunks

        feet, normals = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        distances, nodes = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
        grid = as_plain(self.low), self.cell, self.shape, self._planes
        over_chunks(grid_planes, len(points), as_plain(points), *grid, feet, normals, distances, nodes)
        return Closest(feet, normals, distances, nodes)


# Cell in sizes, and cells at most.
CELL_DIAGONALS, MAX_CELLS = 0.02, 30_000_000
# Cells beside the scan on each side; so many times the cells at most, those included.
PADDING_CELLS, MAX_PADDED_RATIO = 2.0, 4.0
# Gain by the number of axes along which a cell is beside one that holds a point.
GAINS = np.array([1.0, 0.7, 0.4, 0.3], dtype=np.float32)


class OccupancyGrid(Grid):
    """Which cells of space hold points of a scan, their neighbours a little as well."""

    def __init__(self, points: FloatArray, size: float) -> None:
        low, high = bounds(points)
        cell = max(CELL_DIAGONALS * size, float(np.prod(np.maximum(high - low, size)) / MAX_CELLS) ** (1.0 / 3.0))
        # Of a long thin scan most cells are those beside it: they would take tens of gigabytes.
        while float(np.prod((high - low) / cell + 2.0 * PADDING_CELLS + 1.0)) > MAX_PADDED_RATIO * MAX_CELLS:
            cell *= 2.0
        super().__init__(low - PADDING_CELLS * cell, high + PADDING_CELLS * cell, cell)
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
