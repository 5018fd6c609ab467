"""How the points of a cloud spread about their middle, but for those that lie farthest from it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.kd_order import MANY_KEYS, part_keys


@compiled
def scatter_of_most(points: FloatArray, share: float) -> FloatArray:
    """Covariance, (3, 3), of the share of points, (n, 3), that is nearest to the medians of their coordinates. O(n)."""
    n, middle = len(points), np.zeros(3)
    values, away = np.zeros(n), np.zeros(n)
    for k in range(3):
        for i in range(n):
            values[i] = points[i, k]
        middle[k] = median_of(values, n)
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


@inside_kernels
def median_of(values: FloatArray, count: int) -> float:
    """Median of the first so many values, which are put in another order; NaN of none."""
    if count == 0:
        return float(np.nan)
    order, sample = np.zeros(count, np.int64), np.zeros(MANY_KEYS[1])
    # Of the type that it has elsewhere: for a plain zero what it is given to would be compiled once more.
    first, half = int(np.int64(0)), count // 2
    part_keys(values, order, first, count - 1, half, sample)
    high = values[half]
    if count % 2 == 1:
        return float(high)
    low = values[0]
    for i in range(1, half):
        low = max(low, values[i])
    return float(0.5 * (low + high))


@inside_kernels
def quantile_of(values: FloatArray, share: float) -> float:
    """Quantile of values, one at least, between the two nearest; they are put in another order."""
    n, place = len(values), share * (len(values) - 1)
    order, sample = np.zeros(n, np.int64), np.zeros(MANY_KEYS[1])
    first, below = int(np.int64(0)), int(place)
    part_keys(values, order, first, n - 1, below, sample)
    low, part = values[below], place - below
    if below + 1 == n:
        return float(low)
    high = values[below + 1]
    for i in range(below + 2, n):
        high = min(high, values[i])
    # From the nearer of the two.
    return float(low + (high - low) * part if part < 0.5 else high - (high - low) * (1.0 - part))
