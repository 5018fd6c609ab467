"""Screening: how well tens of thousands of poses explain a few scan points, by looking distances up in a grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dqreg.arrays import FloatArray, IntArray

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
