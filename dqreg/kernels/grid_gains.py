"""Gains of points under many poses, looked up at the nearest nodes of a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled


@compiled
def mean_gains(
    first: int,
    last: int,
    rotations: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    shape: IntArray,
    gains: NDArray[np.float32],
    means: FloatArray,
) -> None:
    """Write the mean gain of all points under poses first to last; the last gain is that outside of the grid.

    Rotations and shifts lead to cells, half a cell further, so that cutting off rounds. O(1) a point and pose.
    """
    a, b, c = float(shape[0]), float(shape[1]), float(shape[2])
    rows, columns, outside = shape[1], shape[2], len(gains) - 1
    for k in range(first, last):
        r, t, total = rotations[k], shifts[k], 0.0
        for i in range(len(points)):
            p, q, s = points[i, 0], points[i, 1], points[i, 2]
            x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + t[0]
            y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + t[1]
            z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + t[2]
            node = outside
            if x >= 0.0 and y >= 0.0 and z >= 0.0 and x < a and y < b and z < c:
                node = (np.int64(x) * rows + np.int64(y)) * columns + np.int64(z)
            total += gains[node]
        means[k] = total / len(points)
