"""How points spread about their mean, and how far all of them travel between two poses."""

from __future__ import annotations

import math

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def spread_of(points: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Write the mean, (3,), of points, (n, 3), and their covariance, (3, 3). O(n)."""
    x, y, z, count = 0.0, 0.0, 0.0, len(points)
    for i in range(count):
        x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
    mean[0], mean[1], mean[2] = x / count, y / count, z / count
    x, y, z = mean[0], mean[1], mean[2]
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        u, v, w = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        xx, xy, xz = xx + u * u, xy + u * v, xz + u * w
        yy, yz, zz = yy + v * v, yz + v * w, zz + w * w
    covariance[0, 0], covariance[1, 1], covariance[2, 2] = xx / count, yy / count, zz / count
    covariance[0, 1] = covariance[1, 0] = xy / count
    covariance[0, 2] = covariance[2, 0] = xz / count
    covariance[1, 2] = covariance[2, 1] = yz / count


@compiled
def rms_motion(T_a: FloatArray, T_b: FloatArray, mean: FloatArray, covariance: FloatArray) -> float:
    """Root mean square way of points of a spread from one pose, (4, 4), to another: ``tr(A C A^T) + |A m + t|^2``."""
    around, along = 0.0, 0.0
    for i in range(3):
        shift = T_b[i, 3] - T_a[i, 3]
        for j in range(3):
            a, across = T_b[i, j] - T_a[i, j], 0.0
            shift += a * mean[j]
            for k in range(3):
                across += (T_b[i, k] - T_a[i, k]) * covariance[k, j]
            around += across * a
        along += shift * shift
    return math.sqrt(max(around, 0.0) + along)
