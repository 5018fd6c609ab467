"""The other way round: how much of the target lies on the scan. It tells a part in a scene from a part on its table.

A scan that is a scene, or that overlaps a cloud only in part, has most of its points elsewhere: whatever pose puts a
large face of it on a large face of the target looks good from its side alone.
"""

from __future__ import annotations

import itertools

import numpy as np

from dqreg.arrays import FloatArray, bounds
from dqreg.start.screening import Lattice

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
