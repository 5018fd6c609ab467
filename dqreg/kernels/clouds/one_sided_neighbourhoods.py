"""Neighbourhoods whose mean is off their point, in its tangent plane: where a sampled face ends."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled

MIN_DIVISOR = 1e-300  # a length that is divided by


@compiled
def off_centre_rows(
    first: int,
    last: int,
    cloud: FloatArray,
    around: IntArray,
    at: FloatArray,
    normals: FloatArray,
    share: float,
    found: BoolArray,
    outwards: FloatArray,
) -> None:
    """Write which places, first to last, have the mean of their neighbours aside, and the unit direction away from it.

    Aside: within the plane of its normal farther off than a share of their root mean square distance. O(k) a place.
    Shapes: cloud (n, 3); around, (m, k), rows of it; the others (m, 3) and (m,).
    """
    count = around.shape[1]
    for i in range(first, last):
        mx = my = mz = square = 0.0
        for j in range(count):
            t = around[i, j]
            x, y, z = cloud[t, 0] - at[i, 0], cloud[t, 1] - at[i, 1], cloud[t, 2] - at[i, 2]
            mx, my, mz, square = mx + x, my + y, mz + z, square + (x * x + y * y + z * z)
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        mx, my, mz = mx / count, my / count, mz / count
        height = mx * nx + my * ny + mz * nz
        mx, my, mz = mx - height * nx, my - height * ny, mz - height * nz
        off = np.sqrt(mx * mx + my * my + mz * mz)
        is_known = nx != 0.0 or ny != 0.0 or nz != 0.0
        found[i] = is_known and off > share * np.sqrt(square / count)
        off = max(off, MIN_DIVISOR)
        outwards[i, 0], outwards[i, 1], outwards[i, 2] = -mx / off, -my / off, -mz / off
