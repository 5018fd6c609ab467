"""The first point of each voxel."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.voxel_blocks import HALF, A, B, C

# Places of the table for each point, at least.
SPARSE = 2


def first_of_voxels(points: FloatArray, size: float) -> IntArray:
    """Rows of the first point of each voxel, ascending. O(n)."""
    from dqreg.kernels.threads import as_plain

    places = 1
    while places < SPARSE * len(points):
        places *= 2
    table, found, count = np.full(places, -1), np.zeros(len(points), dtype=np.int64), np.zeros(1, dtype=np.int64)
    first_rows(as_plain(points), float(size), table, found, count)
    return found[: count[0]]


@compiled
def first_rows(points: FloatArray, size: float, table: IntArray, found: IntArray, count: IntArray) -> None:
    """Write the rows whose voxel no row before has; the table, of a power of two of places, holds them, -1 at first."""
    last = np.uint64(len(table) - 1)
    for i in range(len(points)):
        a, b, c = np.floor(points[i, 0] / size), np.floor(points[i, 1] / size), np.floor(points[i, 2] / size)
        code = np.uint64(np.int64(a)) * A + np.uint64(np.int64(b)) * B + np.uint64(np.int64(c)) * C
        place = (code ^ (code >> HALF)) & last
        row = table[place]
        while row >= 0 and (
            np.floor(points[row, 0] / size) != a
            or np.floor(points[row, 1] / size) != b
            or np.floor(points[row, 2] / size) != c
        ):
            place = (place + np.uint64(1)) & last
            row = table[place]
        if row < 0:
            table[place], found[count[0]] = i, i
            count[0] += 1
