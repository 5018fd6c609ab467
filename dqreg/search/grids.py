"""Screening: how well tens of thousands of poses explain a few scan points, by looking distances up in a grid.

The surface as a grid knows it: the tangent plane at the place closest to the nearest node, looked up, not searched.

While a pose is still a hundredth of the size off, that is as good as the closest place itself, for a hundredth of the
time.

The other way round: how much of the target lies on the scan. It tells a part in a scene from a part on its table.

A scan that is a scene, or that overlaps a cloud only in part, has most of its points elsewhere: whatever pose puts a
large face of it on a large face of the target looks good from its side alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.surface import Closest, Hint

# Single precision: a hundredth of a cell is all that is needed.
Single = npt.NDArray[np.float32]
# Nodes of a grid, and room around the target in sizes.
NODES, MARGIN = 300_000, 0.05
# Poses looked at in one step: bounds the memory, and what is looked up stays in the cache.
CHUNK = 1_024


class Lattice:
    """Regular nodes in a box; what is known at each is looked up at the nearest one."""

    def __init__(self, low: FloatArray, high: FloatArray, cell: float) -> None:
        self.low, self.cell = low, cell
        self.shape = np.ceil((high - low) / cell).astype(np.int64) + 1

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape))

    def nodes(self, points: FloatArray) -> IntArray:
        """Nearest node of each place, (n,); the number of all nodes stands for "outside"."""
        return self._flat(((points - self.low) / self.cell + 0.5).astype(np.float32).T)

    def mean_gains(self, R: FloatArray, t: FloatArray, points: FloatArray, gains: Single) -> FloatArray:
        """Mean gain of the points under each pose, (n,).

        Shapes: R (n, 3, 3), gains (count + 1,).
        """
        if not len(points):
            return np.zeros(len(R))
        parts = [self._chunk(R[i : i + CHUNK], t[i : i + CHUNK], points, gains) for i in range(0, len(R), CHUNK)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _chunk(self, R: FloatArray, t: FloatArray, points: FloatArray, gains: Single) -> FloatArray:
        # Rows of all rotations against all points in one product; single precision is finer than a cell.
        scaled = (R.transpose(1, 0, 2).reshape(-1, 3) / self.cell).astype(np.float32)
        moved = (scaled @ points.T.astype(np.float32)).reshape(3, len(R), -1)
        moved += ((t - self.low) / self.cell + 0.5).astype(np.float32).T[:, :, None]
        mean: FloatArray = gains[self._flat(moved)].mean(axis=1, dtype=np.float64)
        return mean

    def _flat(self, moved: Single) -> IntArray:
        """Row of the node, of places in cells, (3, ...)."""
        inside = (moved >= 0.0).all(axis=0)
        node = np.where(inside, moved, np.float32(0.0)).astype(np.int32)
        for k in range(3):
            inside &= node[k] < self.shape[k]
        flat = (node[0] * np.int32(self.shape[1]) + node[1]) * np.int32(self.shape[2]) + node[2]
        return np.where(inside, flat, np.int32(self.count))


class DistanceGrid(Lattice):
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

    def scores(self, R: FloatArray, t: FloatArray, points: FloatArray, reach: float) -> FloatArray:
        """Mean of ``1 - (d / reach)^2`` over the points, 0 beyond the reach, for each pose.

        Shapes: R (n, 3, 3).
        """
        gains = np.append(np.maximum(1.0 - (self.distances / np.float32(reach)) ** 2, 0.0), np.float32(0.0))
        return self.mean_gains(R, t, points, gains)


def distinct(R: FloatArray, t: FloatArray, middle: FloatArray, angle_rad: float, offset: float, most: int) -> IntArray:
    """Rows of the first poses that differ from all kept before them.

    Shapes: R (n, 3, 3).
    """
    places = R @ middle + t
    alive = np.ones(len(R), dtype=bool)
    kept: list[int] = []
    while alive.any() and len(kept) < most:
        k = int(alive.argmax())
        kept.append(k)
        # |R_a - R_b| in the Frobenius norm is 2 sqrt(2) sin(angle / 2).
        chord = np.linalg.norm((R - R[k]).reshape(len(R), 9), axis=1)
        same = (chord < 2.0 * np.sqrt(2.0) * np.sin(0.5 * angle_rad)) & (
            np.linalg.norm(places - places[k], axis=1) < offset
        )
        alive &= ~same
        alive[k] = False
    return np.array(kept, dtype=np.int64)


# Nodes closer to the surface than this, in sizes, ask it; of the others a dense sample knows enough.
ASKED = 0.025


class PlaneGrid(DistanceGrid):
    """Distances and tangent planes on a regular grid."""

    def __init__(
        self, surface: Surface, places: FloatArray, normals: FloatArray, low: FloatArray, high: FloatArray
    ) -> None:
        self.diagonal, self.centre, self.oriented = surface.diagonal, surface.centre, surface.oriented
        tree = NeighbourTree(places)
        planes = np.zeros((0, 6), dtype=np.float32)

        def distances(nodes: FloatArray) -> FloatArray:
            nonlocal planes
            rows, found = tree.nearest(nodes, 1)
            # What lies outside is on no plane: the last row.
            planes = np.zeros((len(nodes) + 1, 6), dtype=np.float32)
            planes[:-1, :3], planes[:-1, 3:] = places[rows[:, 0]], normals[rows[:, 0]]
            distances = found[:, 0]
            near = np.flatnonzero(distances < ASKED * surface.diagonal)
            asked = surface.closest(nodes[near])
            planes[near, :3], planes[near, 3:], distances[near] = asked.points, asked.normals, asked.distances
            return distances

        super().__init__(distances, low, high, surface.diagonal)
        self._planes = planes

    def closest(self, points: FloatArray, hint: Hint | None = None) -> Closest:
        """Foot on the tangent plane, its normal, and the distance; infinite outside the grid, (n, 3) each."""
        nodes = self.nodes(points)
        planes = self._planes[nodes].astype(np.float64)
        gap, normals = points - planes[:, :3], planes[:, 3:]
        height = np.einsum("ij,ij->i", gap, normals)
        # The place is the node's: as far as the node may be aside, so far the place may be.
        aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", gap, gap) - height**2, 0.0)) - self.cell
        distances = np.hypot(height, np.maximum(aside, 0.0))
        distances[nodes == len(self.distances)] = np.inf
        return Closest(points - height[:, None] * normals, normals, distances, nodes)


# Cell in sizes, and cells at most.
CELL, CELLS = 0.02, 30_000_000
# Gain by the number of axes along which a cell is beside one that holds a point.
GAINS = np.array([1.0, 0.7, 0.4, 0.3], dtype=np.float32)


class Occupancy(Lattice):
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

    def scores(self, R: FloatArray, t: FloatArray, points: FloatArray) -> FloatArray:
        """Mean gain of target points, moved onto the scan by the inverse of each pose.

        Shapes: R (n, 3, 3).
        """
        back = R.transpose(0, 2, 1)
        return self.mean_gains(back, -np.einsum("nij,nj->ni", back, t), points, self.gains)
