"""The first point of each voxel, one of each, and the mean of those that lie in it."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.maps.voxel_blocks import FACTOR_A, FACTOR_B, FACTOR_C, HALF, Voxels

# Places of the table for each point, at least; numbers of a voxel: a line of the cache.
SPARSE, VOXEL = 2, 8
# A cell and a row.
CELL_AND_ROW = 4


def first_of_voxels(points: FloatArray, size: float) -> IntArray:
    """Rows of the first point of each voxel, ascending. O(n)."""
    from dqreg.kernels.threads import as_plain

    table, count = _empty_table(len(points)), np.zeros(1, dtype=np.int64)
    found = np.zeros(len(points), dtype=np.int64)
    first_rows(as_plain(points), float(size), table, found, count)
    return found[: count[0]]


def one_of_voxels(points: FloatArray, size: float) -> IntArray:
    """Row of one point of each voxel, in the order of their first ones: whichever, as good as at random. O(n)."""
    from dqreg.kernels.threads import as_plain

    table, count = _empty_table(len(points)), np.zeros(1, dtype=np.int64)
    found = np.zeros((len(points), CELL_AND_ROW), dtype=np.int64)
    any_rows(as_plain(points), float(size), table, found, count)
    return found[: count[0], 3]


@dataclasses.dataclass(frozen=True, eq=False)
class VoxelSums:
    """Sums of the points of each voxel, in the order of the first ones, and of their times."""

    size: float  # Of a voxel
    table: Voxels
    sums: FloatArray  # (m, 8)

    @staticmethod
    def of(points: FloatArray, times: FloatArray | None, size: float, near: float) -> VoxelSums:
        """Of those alone that were seen within a time, ``near``, of the mean of the ones before. O(n)."""
        from dqreg.kernels.threads import as_plain

        table, count = _empty_table(len(points)), np.zeros(1, dtype=np.int64)
        sums, when = np.zeros((len(points), VOXEL)), np.zeros(0) if times is None else as_plain(times)
        add_to_voxels(as_plain(points), when, float(size), float(near), table, sums, count)
        return VoxelSums(float(size), table, sums[: count[0]])

    def means(self) -> tuple[FloatArray, FloatArray]:
        """Means of the points of each voxel, (m, 3), and of their times, (m,), 0 without."""
        means, back = np.zeros((len(self.sums), 3)), np.zeros(len(self.sums))
        write_means(self.sums, means, back)
        return means, back

    def means_at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same of the voxels that some of the points lie in, (k, 3), once each, in the order of these. O(k)."""
        from dqreg.kernels.threads import as_plain

        found = np.zeros((len(places), VOXEL))
        count = sums_at(as_plain(places), self.size, self.table, self.sums, np.zeros(len(self.sums), np.bool_), found)
        return VoxelSums(self.size, self.table, found[:count]).means()


def _empty_table(count: int) -> Voxels:
    places = 1
    while places < SPARSE * count:
        places *= 2
    return np.full(places, -1, dtype=np.int32)


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
    timed, per = len(times) > 0, 1.0 / size
    # What a sensor sees next lies mostly where it saw the last point.
    u = v = w = np.nan
    voxel = int(np.int64(0))
    for i in range(len(points)):
        a, b, c = np.floor(points[i, 0] * per), np.floor(points[i, 1] * per), np.floor(points[i, 2] * per)
        if a != u or b != v or c != w:
            u, v, w = a, b, c
            place = _place_of(a, b, c, table, sums)
            voxel = int(table[place])
            if voxel < 0:
                voxel = count[0]
                count[0] += 1
                table[place], sums[voxel, 5], sums[voxel, 6], sums[voxel, 7] = voxel, a, b, c
        # Of the first one NaN, which is not more.
        if timed and abs(times[i] - sums[voxel, 4] / sums[voxel, 3]) > near:
            continue
        sums[voxel, 0] += points[i, 0]
        sums[voxel, 1] += points[i, 1]
        sums[voxel, 2] += points[i, 2]
        sums[voxel, 3] += 1.0
        if timed:
            sums[voxel, 4] += times[i]


@inside_kernels
def _place_of(a: float, b: float, c: float, table: Voxels, sums: FloatArray) -> np.uint64:
    """Where a table holds a voxel, by its cell, or has room for it."""
    last = np.uint64(len(table) - 1)
    code = np.uint64(np.int64(a)) * FACTOR_A + np.uint64(np.int64(b)) * FACTOR_B + np.uint64(np.int64(c)) * FACTOR_C
    place = (code ^ (code >> HALF)) & last
    voxel = int(table[place])
    while voxel >= 0 and (sums[voxel, 5] != a or sums[voxel, 6] != b or sums[voxel, 7] != c):
        place = (place + np.uint64(1)) & last
        voxel = int(table[place])
    return place


@compiled
def sums_at(
    places: FloatArray, size: float, table: Voxels, sums: FloatArray, taken: BoolArray, found: FloatArray
) -> int:
    """Write the sums of the voxels that places lie in, each the first time, and which are taken; how many."""
    count, per = 0, 1.0 / size
    for i in range(len(places)):
        a, b, c = np.floor(places[i, 0] * per), np.floor(places[i, 1] * per), np.floor(places[i, 2] * per)
        voxel = int(table[_place_of(a, b, c, table, sums)])
        if voxel < 0 or taken[voxel]:
            continue
        taken[voxel] = True
        for k in range(VOXEL):
            found[count, k] = sums[voxel, k]
        count += 1
    return count


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
        code = np.uint64(np.int64(a)) * FACTOR_A + np.uint64(np.int64(b)) * FACTOR_B + np.uint64(np.int64(c)) * FACTOR_C
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


@compiled
def any_rows(points: FloatArray, size: float, table: Voxels, found: IntArray, count: IntArray) -> None:
    """Write the cell of each voxel, and the row of its points whose number, mixed, is the least; the table as before.

    The first one that a sensor saw of a voxel would be at the same side of each.
    """
    last, per = np.uint64(len(table) - 1), 1.0 / size
    u = v = w = np.int64(0)
    # None yet.
    voxel = int(np.int64(-1))
    for i in range(len(points)):
        a, b, c = (
            np.int64(np.floor(points[i, 0] * per)),
            np.int64(np.floor(points[i, 1] * per)),
            np.int64(np.floor(points[i, 2] * per)),
        )
        if voxel < 0 or a != u or b != v or c != w:
            u, v, w = a, b, c
            code = np.uint64(a) * FACTOR_A + np.uint64(b) * FACTOR_B + np.uint64(c) * FACTOR_C
            place = (code ^ (code >> HALF)) & last
            voxel = int(table[place])
            while voxel >= 0 and (found[voxel, 0] != a or found[voxel, 1] != b or found[voxel, 2] != c):
                place = (place + np.uint64(1)) & last
                voxel = int(table[place])
            if voxel < 0:
                voxel = count[0]
                count[0] += 1
                table[place], found[voxel, 0], found[voxel, 1], found[voxel, 2], found[voxel, 3] = voxel, a, b, c, i
        if np.uint64(i) * FACTOR_A < np.uint64(found[voxel, 3]) * FACTOR_A:
            found[voxel, 3] = i
