"""Cells of a grid that hold points, by a table of their numbers along the axes: no point is sorted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.order.morton import BITS, BUCKETS, DIGIT, REST, SPREAD, Codes, sorted_rows

Slots = NDArray[np.int32]

U = np.uint64
# A factor that scatters neighbouring keys over a table, of which the upper bits are taken.
KEY_FACTOR = np.uint64(0x9E3779B97F4A7C15)
# Slots of the first table; it is doubled as soon as half of them are taken.
FIRST_SLOTS = 1 << 15
# Bits of a number along one axis, three of which make a key.
ONE_AXIS = (1 << BITS) - 1
# Numbers of a cell while its points are summed up: these, their offsets from the first of them, products of two, and
# the first one, in whole lines of the cache.
CELL_SUMS, AT_FIRST = 16, 10


@compiled
def cells_of_points(
    points: FloatArray, move: FloatArray, low: FloatArray, per_edge: float
) -> tuple[Codes, FloatArray, FloatArray, FloatArray]:
    """Morton codes, points, means and scatters of the cells from the corner ``low`` on that hold points. O(n).

    In the order of their codes, which are those of `morton_cells`. Points are moved where they are read: scaled by the
    first number, then shifted by the others. Shapes: points (n, 3), move (4,); returns (m,), (m,), (m, 3) and (m, 6):
    xx, yy, zz, xy, xz, yz about the mean.
    """
    cells = np.zeros(len(points), np.int32)
    keys = numbered(points, move, low, per_edge, cells)
    codes, sums = codes_of(keys), np.zeros((len(keys), CELL_SUMS))
    add_points(points, move, cells, sums)
    order, codes = sorted_rows(codes)
    count = len(codes)
    counts, means, scatters = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 6))
    for i in range(count):
        c = U(order[i])
        # Of offsets from the first point of the cell: far from the origin their products have digits left.
        held = sums[c, 0]
        x, y, z = sums[c, 1] / held, sums[c, 2] / held, sums[c, 3] / held
        counts[i] = held
        means[i, 0], means[i, 1], means[i, 2] = sums[c, AT_FIRST] + x, sums[c, 11] + y, sums[c, 12] + z
        scatters[i, 0], scatters[i, 1] = sums[c, 4] - held * (x * x), sums[c, 5] - held * (y * y)
        scatters[i, 2], scatters[i, 3] = sums[c, 6] - held * (z * z), sums[c, 7] - held * (x * y)
        scatters[i, 4], scatters[i, 5] = sums[c, 8] - held * (x * z), sums[c, 9] - held * (y * z)
    return codes, counts, means, scatters


@inside_kernels
def numbered(points: FloatArray, move: FloatArray, low: FloatArray, per_edge: float, cells: Slots) -> Codes:
    """Write the cell of each point, counted in the order in which they come, and return their keys."""
    table, keys = np.full(FIRST_SLOTS, -1, np.int32), np.zeros(FIRST_SLOTS // 2, np.uint64)
    # Of the type that they have later: for plain zeros what they are given to would be compiled once more.
    at = count = int(np.int64(0))
    while True:
        # Arrays that are replaced in a loop over points would be counted for each of these.
        at, count = number_on(points, move, low, per_edge, at, count, table, keys, cells)
        if at == len(points):
            return keys[:count].copy()
        table, more = np.full(2 * len(table), -1, np.int32), np.zeros(len(table), np.uint64)
        for c in range(count):
            more[c] = keys[c]
            table[free_slot(keys[c], table)] = c
        keys = more


@inside_kernels
def number_on(
    points: FloatArray,
    move: FloatArray,
    low: FloatArray,
    per_edge: float,
    at: int,
    count: int,
    table: Slots,
    keys: Codes,
    cells: Slots,
) -> tuple[int, int]:
    """Write the cells of points from one on as long as there is room for keys; the next point, and cells by then."""
    shift, mask, x, y, z = shift_of(table), U(len(table) - 1), low[0], low[1], low[2]
    scale, u, v, w = move[0], move[1], move[2], move[3]
    for i in range(at, len(points)):
        a, b, c = (
            U(np.int64((scale * points[i, 0] + u - x) * per_edge)),
            U(np.int64((scale * points[i, 1] + v - y) * per_edge)),
            U(np.int64((scale * points[i, 2] + w - z) * per_edge)),
        )
        key = (a << U(2 * BITS)) | (b << U(BITS)) | c
        slot = (key * KEY_FACTOR) >> shift
        cell = np.int64(table[slot])
        while cell >= 0 and keys[U(cell)] != key:
            slot = (slot + U(1)) & mask
            cell = np.int64(table[slot])
        if cell < 0:
            if count == len(keys):
                return i, count
            cell = np.int64(count)
            table[slot], keys[U(cell)] = cell, key
            count += 1
        cells[i] = cell
    return len(points), count


@inside_kernels
def shift_of(table: Slots) -> np.uint64:
    """Bits of a product above which those of a slot stand."""
    shift, slots = 64, len(table)
    while slots > 1:
        shift, slots = shift - 1, slots // 2
    return U(shift)


@inside_kernels
def free_slot(key: np.uint64, table: Slots) -> np.uint64:
    """Slot for a key that is not in the table."""
    slot, mask = (key * KEY_FACTOR) >> shift_of(table), U(len(table) - 1)
    while table[slot] >= 0:
        slot = (slot + U(1)) & mask
    return slot


@inside_kernels
def codes_of(keys: Codes) -> Codes:
    """Morton codes of keys."""
    codes = np.zeros(len(keys), np.uint64)
    for i in range(len(keys)):
        for k in range(3):
            number = np.int64(keys[i] >> U(BITS * (2 - k))) & ONE_AXIS
            spread = SPREAD[number & (BUCKETS - 1)] | (SPREAD[(number >> DIGIT) & REST] << U(3 * DIGIT))
            codes[i] = (codes[i] << U(1)) | spread
    return codes


@inside_kernels
def add_points(points: FloatArray, move: FloatArray, cells: Slots, sums: FloatArray) -> None:
    """Add points to the sums of their cells, (m, 16)."""
    scale, u, v, w = move[0], move[1], move[2], move[3]
    for i in range(len(points)):
        c, x, y, z = U(cells[i]), scale * points[i, 0] + u, scale * points[i, 1] + v, scale * points[i, 2] + w
        if sums[c, 0] == 0.0:
            sums[c, AT_FIRST], sums[c, 11], sums[c, 12] = x, y, z
        x, y, z = x - sums[c, AT_FIRST], y - sums[c, 11], z - sums[c, 12]
        sums[c, 0] += 1.0
        sums[c, 1], sums[c, 2], sums[c, 3] = sums[c, 1] + x, sums[c, 2] + y, sums[c, 3] + z
        sums[c, 4], sums[c, 5], sums[c, 6] = sums[c, 4] + x * x, sums[c, 5] + y * y, sums[c, 6] + z * z
        sums[c, 7], sums[c, 8], sums[c, 9] = sums[c, 7] + x * y, sums[c, 8] + x * z, sums[c, 9] + y * z
