"""The first point of each voxel, and the mean of those that lie in it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.voxel_blocks import HALF, A, B, C, Voxels

# Places of the table for each point, at least; numbers of a voxel: a line of the cache.
SPARSE, VOXEL = 2, 8


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
    table, count = np.full(places, -1, dtype=np.int32), np.zeros(1, dtype=np.int64)
    sums, when = np.zeros((len(points), VOXEL)), np.zeros(0) if times is None else as_plain(times)
    add_to_voxels(as_plain(points), when, float(size), float(near), table, sums, count)
    means, back = np.zeros((count[0], 3)), np.zeros(count[0])
    write_means(sums, means, back)
    return means, back


@compiled
def add_to_voxels(
    points: FloatArray,
    times: FloatArray,
    size: float,
    near: float,
    table: Voxels,
    sums: FloatArray,
    count: IntArray,
) -> None:
    """Add points and their times, if there are any, to the sums of their voxels: x, y, z, number, time, and the cell.

    The table, of a power of two of places, holds the voxels, -1 at first. Points are added that were seen within a time
    of the mean of those before. Shapes: sums (n, 8).
    """
    last, timed, per = np.uint64(len(table) - 1), len(times) > 0, 1.0 / size
    for i in range(len(points)):
        a, b, c = np.floor(points[i, 0] * per), np.floor(points[i, 1] * per), np.floor(points[i, 2] * per)
        code = np.uint64(np.int64(a)) * A + np.uint64(np.int64(b)) * B + np.uint64(np.int64(c)) * C
        place = (code ^ (code >> HALF)) & last
        voxel = int(table[place])
        while voxel >= 0 and (sums[voxel, 5] != a or sums[voxel, 6] != b or sums[voxel, 7] != c):
            place = (place + np.uint64(1)) & last
            voxel = int(table[place])
        if voxel < 0:
            voxel = count[0]
            count[0] += 1
            table[place], sums[voxel, 5], sums[voxel, 6], sums[voxel, 7] = voxel, a, b, c
        elif timed and abs(times[i] - sums[voxel, 4] / sums[voxel, 3]) > near:
            continue
        sums[voxel, 0] += points[i, 0]
        sums[voxel, 1] += points[i, 1]
        sums[voxel, 2] += points[i, 2]
        sums[voxel, 3] += 1.0
        if timed:
            sums[voxel, 4] += times[i]


@compiled
def write_means(sums: FloatArray, means: FloatArray, times: FloatArray) -> None:
    """Write means of points, (m, 3), and times, (m,), from such sums; NumPy takes ten times as long."""
    for voxel in range(len(means)):
        number = sums[voxel, 3]
        for k in range(3):
            means[voxel, k] = sums[voxel, k] / number
        times[voxel] = sums[voxel, 4] / number


@compiled
def measured_rows(points: FloatArray, largest: float, low: FloatArray, high: FloatArray) -> int:
    """How many points, (n, 3), are measurements: not at the origin, and no coordinate NaN or as large as the largest.

    Lowest and highest coordinates of these are lowered and raised.
    """
    # Numbers of their own: an array could be the points, for all that a compiler knows.
    count, a, b, c, d, e, f = 0, low[0], low[1], low[2], high[0], high[1], high[2]
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if abs(x) < largest and abs(y) < largest and abs(z) < largest and (x != 0.0 or y != 0.0 or z != 0.0):
            count += 1
            a, b, c = min(a, x), min(b, y), min(c, z)
            d, e, f = max(d, x), max(e, y), max(f, z)
    low[0], low[1], low[2], high[0], high[1], high[2] = a, b, c, d, e, f
    return count


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
