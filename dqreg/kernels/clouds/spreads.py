"""How the points of a cloud spread about their middle, but for those that lie farthest from it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.selection import median_of, quantile_of


@compiled
def scatter_of_most(points: FloatArray, share: float) -> FloatArray:
    """Covariance, (3, 3), of the share of points, (n, 3), that is nearest to the medians of their coordinates. O(n)."""
    n, middle = len(points), np.zeros(3)
    values, away = np.zeros(n), np.zeros(n)
    for k in range(3):
        for i in range(n):
            values[i] = points[i, k]
        middle[k] = median_of(values)
    for i in range(n):
        x, y, z = points[i, 0] - middle[0], points[i, 1] - middle[1], points[i, 2] - middle[2]
        away[i] = values[i] = x * x + y * y + z * z
    most = quantile_of(values, share)
    count, mx, my, mz = 0, 0.0, 0.0, 0.0
    for i in range(n):
        if away[i] <= most:
            count += 1
            mx, my, mz = (
                mx + (points[i, 0] - middle[0]),
                my + (points[i, 1] - middle[1]),
                mz + (points[i, 2] - middle[2]),
            )
    mx, my, mz = middle[0] + mx / count, middle[1] + my / count, middle[2] + mz / count
    xx = yy = zz = xy = xz = yz = 0.0
    for i in range(n):
        if away[i] <= most:
            x, y, z = points[i, 0] - mx, points[i, 1] - my, points[i, 2] - mz
            xx, yy, zz, xy, xz, yz = xx + x * x, yy + y * y, zz + z * z, xy + x * y, xz + x * z, yz + y * z
    scatter = np.zeros((3, 3))
    scatter[0, 0], scatter[1, 1], scatter[2, 2] = xx / count, yy / count, zz / count
    scatter[0, 1], scatter[0, 2], scatter[1, 2] = xy / count, xz / count, yz / count
    scatter[1, 0], scatter[2, 0], scatter[2, 1] = xy / count, xz / count, yz / count
    return scatter
