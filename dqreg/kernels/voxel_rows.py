"""The first point of each voxel, and the mean of those that lie in it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.voxel_blocks import HALF, A, B, C, Voxels

# Places of the table for each point, at least.
SPARSE = 2


def first_of_voxels(points: FloatArray, size: float) -> IntArray:
    """Rows of the first point of each voxel, ascending. O(n)."""
    from dqreg.kernels.threads import as_plain

    places = 1
    while places < SPARSE * len(points):
        places *= 2
    table = np.full(places, -1, dtype=np.int32)
    found, count = np.zeros(len(points), dtype=np.int64), np.zeros(1, dtype=np.int64)
    first_rows(as_plain(points), float(size), table, found, count)
    return found[: count[0]]


def means_of_voxels(
    points: FloatArray, times: FloatArray | None, size: float, near: float
) -> tuple[FloatArray, FloatArray]:
    """Means of the points of each voxel, (m, 3), in the order of the first ones, and of their times, (m,), 0 without.

    Of those alone that were seen within a time, ``near``, of the mean of the ones before. O(n).
    """
    from dqreg.kernels.threads import as_plain

    places = 1
    while places < SPARSE * len(points):
        places *= 2
    table, count, cells = np.full(places, -1, dtype=np.int32), np.zeros(1, dtype=np.int64), np.zeros((len(points), 3))
    sums, when = np.zeros((len(points), 5)), np.zeros(0) if times is None else as_plain(times)
    add_to_voxels(as_plain(points), when, float(size), float(near), table, cells, sums, count)
    found = sums[: count[0]]
    return found[:, :3] / found[:, 3:4], found[:, 4] / found[:, 3]


@compiled
def add_to_voxels(
    points: FloatArray,
    times: FloatArray,
    size: float,
    near: float,
    table: Voxels,
    cells: FloatArray,
    sums: FloatArray,
    count: IntArray,
) -> None:
    """Add points and their times, if there are any, to the sums of their voxels: x, y, z, number, time.

    The table, of a power of two of places, holds the voxels, -1 at first; ``cells``, (n, 3), are where they are. Points
    are added that were seen within a time of the mean of those before.
    """
    last, timed = np.uint64(len(table) - 1), len(times) > 0
    for i in range(len(points)):
        a, b, c = np.floor(points[i, 0] / size), np.floor(points[i, 1] / size), np.floor(points[i, 2] / size)
        code = np.uint64(np.int64(a)) * A + np.uint64(np.int64(b)) * B + np.uint64(np.int64(c)) * C
        place = (code ^ (code >> HALF)) & last
        voxel = int(table[place])
        while voxel >= 0 and (cells[voxel, 0] != a or cells[voxel, 1] != b or cells[voxel, 2] != c):
            place = (place + np.uint64(1)) & last
            voxel = int(table[place])
        if voxel < 0:
            voxel = count[0]
            count[0] += 1
            table[place], cells[voxel, 0], cells[voxel, 1], cells[voxel, 2] = voxel, a, b, c
        elif timed and abs(times[i] - sums[voxel, 4] / sums[voxel, 3]) > near:
            continue
        sums[voxel, 0] += points[i, 0]
        sums[voxel, 1] += points[i, 1]
        sums[voxel, 2] += points[i, 2]
        sums[voxel, 3] += 1.0
        if timed:
            sums[voxel, 4] += times[i]


@compiled
def first_rows(points: FloatArray, size: float, table: Voxels, found: IntArray, count: IntArray) -> None:
    """Write the rows whose voxel no row before has; the table, of a power of two of places, holds them, -1 at first."""
    last = np.uint64(len(table) - 1)
    for i in range(len(points)):
        a, b, c = np.floor(points[i, 0] / size), np.floor(points[i, 1] / size), np.floor(points[i, 2] / size)
        code = np.uint64(np.int64(a)) * A + np.uint64(np.int64(b)) * B + np.uint64(np.int64(c)) * C
        place = (code ^ (code >> HALF)) & last
        row = int(table[place])
        while row >= 0 and (
            np.floor(points[row, 0] / size) != a
            or np.floor(points[row, 1] / size) != b
            or np.floor(points[row, 2] / size) != c
        ):
            place = (place + np.uint64(1)) & last
            row = int(table[place])
        if row < 0:
            table[place], found[count[0]] = i, i
            count[0] += 1
