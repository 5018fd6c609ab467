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
    most: int,
    points: FloatArray,
    links: IntArray,
    table: IntArray,
    voxels: IntArray,
    counts: IntArray,
) -> None:
    """Append those of some points that the map takes, one after the other. O(1) each.

    The table, of a length that is a power of two and with room to spare, holds voxels by their cells, -1 where there is
    none; ``voxels`` are three numbers of the cell, the row of the first point and how many there are. ``links`` lead
    from each point to another one of its voxel, -1 at the end, and to the voxel. ``counts`` are the points and the
    voxels so far.
    """
    last = np.uint64(len(table) - 1)
    for i in range(len(given)):
        x, y, z = given[i, 0], given[i, 1], given[i, 2]
        a, b, c = np.int64(np.floor(x / size)), np.int64(np.floor(y / size)), np.int64(np.floor(z / size))
        code = np.uint64(a) * A + np.uint64(b) * B + np.uint64(c) * C
        place = (code ^ (code >> HALF)) & last
        voxel = table[place]
        while voxel >= 0 and (voxels[voxel, 0] != a or voxels[voxel, 1] != b or voxels[voxel, 2] != c):
            place = (place + np.uint64(1)) & last
            voxel = table[place]
        row = counts[0]
        if voxel < 0:
            voxel = counts[1]
            counts[1] += 1
            table[place], voxels[voxel, 0], voxels[voxel, 1], voxels[voxel, 2] = voxel, a, b, c
            voxels[voxel, 3], voxels[voxel, 4], links[row, 0] = row, 0, -1
        else:
            taken, other = voxels[voxel, 4] < most, voxels[voxel, 3]
            while taken and other >= 0:
                dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
                taken = np.sqrt(dx * dx + dy * dy + dz * dz) >= apart
                other = links[other, 0]
            if not taken:
                continue
            first = voxels[voxel, 3]
            links[row, 0], links[first, 0] = links[first, 0], row
        counts[0] += 1
        voxels[voxel, 4] += 1
        links[row, 1] = voxel
        points[row, 0], points[row, 1], points[row, 2] = x, y, z
