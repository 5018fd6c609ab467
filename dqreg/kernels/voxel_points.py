"""Which points a map takes: so many a voxel at most, and so far apart within it at least, as KISS-ICP's map does."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled

# What cells of a voxel are multiplied with: large odd numbers, so that neighbours lie far apart in the table.
A, B, C = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9)
HALF = np.uint64(32)


@compiled
def admit_points(
    given: FloatArray,
    size: float,
    apart: float,
    points: FloatArray,
    table: IntArray,
    cells: IntArray,
    members: IntArray,
    filled: IntArray,
    counts: IntArray,
) -> None:
    """Append those of some points that the map takes, one after the other. O(1) each.

    The table, of a length that is a power of two and with room to spare, holds voxels by their cells, (v, 3), -1 where
    there is none; members, (v, most), are rows of points, so many as ``filled`` says. ``counts`` are the points and the
    voxels so far.
    """
    last = np.uint64(len(table) - 1)
    for i in range(len(given)):
        x, y, z = given[i, 0], given[i, 1], given[i, 2]
        a, b, c = np.int64(np.floor(x / size)), np.int64(np.floor(y / size)), np.int64(np.floor(z / size))
        code = np.uint64(a) * A + np.uint64(b) * B + np.uint64(c) * C
        place = (code ^ (code >> HALF)) & last
        voxel = table[place]
        while voxel >= 0 and (cells[voxel, 0] != a or cells[voxel, 1] != b or cells[voxel, 2] != c):
            place = (place + np.uint64(1)) & last
            voxel = table[place]
        if voxel < 0:
            voxel = counts[1]
            counts[1] += 1
            table[place], filled[voxel] = voxel, 0
            cells[voxel, 0], cells[voxel, 1], cells[voxel, 2] = a, b, c
        taken = filled[voxel] < members.shape[1]
        for k in range(filled[voxel]):
            row = members[voxel, k]
            dx, dy, dz = points[row, 0] - x, points[row, 1] - y, points[row, 2] - z
            taken = taken and np.sqrt(dx * dx + dy * dy + dz * dz) >= apart
        if taken:
            row = counts[0]
            counts[0] += 1
            members[voxel, filled[voxel]] = row
            filled[voxel] += 1
            points[row, 0], points[row, 1], points[row, 2] = x, y, z
