"""Screening: how well tens of thousands of poses explain a few scan points, by looking distances up in a grid."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.geometry import Surface

# Cells along the longest side, and room around the target in sizes.
CELLS, MARGIN = 72, 0.08
# Poses looked at in one step: bounds the memory.
CHUNK = 4_096


class DistanceGrid:
    """Distances to a surface on a regular grid, looked up at the nearest node.

    Parameters
    ----------
    surface : Surface
        The target.
    low, high : ndarray, (3,)
        Its bounding box.
    """

    def __init__(self, surface: Surface, low: FloatArray, high: FloatArray) -> None:
        room = MARGIN * surface.diagonal
        self.low = low - room
        extent = high - low + 2.0 * room
        self.cell = float(extent.max()) / CELLS
        self.shape = np.ceil(extent / self.cell).astype(np.int64) + 1
        axes = [self.low[k] + self.cell * np.arange(self.shape[k]) for k in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self.distances = surface.closest(nodes).distances.astype(np.float32)

    def scores(self, R: FloatArray, t: FloatArray, points: FloatArray, reach: float) -> FloatArray:
        """Mean of ``1 - (d / reach)^2`` over the points, 0 beyond the reach, for each pose.

        Parameters
        ----------
        R : ndarray, (n, 3, 3)
            Rotations.
        t : ndarray, (n, 3)
            Translations.
        points : ndarray, (m, 3)
            Scan points.
        reach : float
            Distance at which a point counts nothing.

        Returns
        -------
        ndarray, (n,)
            Between 0 and 1; the higher the better.
        """
        parts = [self._chunk(R[i : i + CHUNK], t[i : i + CHUNK], points, reach) for i in range(0, len(R), CHUNK)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _chunk(self, R: FloatArray, t: FloatArray, points: FloatArray, reach: float) -> FloatArray:
        # Rows of all rotations against all points in one product; single precision is finer than a cell.
        scaled = (R.reshape(-1, 3) / self.cell).astype(np.float32)
        moved = (scaled @ points.T.astype(np.float32)).reshape(len(R), 3, -1)
        moved += ((t - self.low) / self.cell + 0.5).astype(np.float32)[:, :, None]
        node = moved.astype(np.int32)
        inside = ((moved >= 0.0) & (node < self.shape[None, :, None])).all(axis=1)
        flat = (node[:, 0] * self.shape[1] + node[:, 1]) * self.shape[2] + node[:, 2]
        distances = self.distances[np.where(inside, flat, 0)]
        gain = np.where(inside, np.maximum(1.0 - (distances / reach) ** 2, 0.0), 0.0)
        mean: FloatArray = gain.mean(axis=1, dtype=np.float64)
        return mean


def distinct(R: FloatArray, t: FloatArray, middle: FloatArray, angle_rad: float, offset: float, most: int) -> IntArray:
    """Rows of the first poses that differ from all kept before them.

    Parameters
    ----------
    R : ndarray, (n, 3, 3)
        Rotations, the best pose first.
    t : ndarray, (n, 3)
        Translations.
    middle : ndarray, (3,)
        Middle of the scan: where offsets are measured.
    angle_rad, offset : float
        Poses closer than both are the same.
    most : int
        Rows to keep at most.

    Returns
    -------
    ndarray of int
        Kept rows, ascending.
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
