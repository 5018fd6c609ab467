"""Moments of the points of each cell of a grid, and a table that finds cells by their codes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled

Codes = NDArray[np.uint64]

# Numbers of a cell: its points, their mean, and the scatter xx, yy, zz, xy, xz, yz about that.
MOMENTS = 10
# A factor that scatters neighbouring codes over a table, and the bits of the product that are taken from.
FACTOR, UPPER = 0x9E3779B97F4A7C15, 32


@compiled
def cell_moments(points: FloatArray, keys: Codes, order: IntArray) -> tuple[IntArray, FloatArray]:
    """Places in an order by codes at which cells begin, and the moments of each cell. O(n).

    The keys are the codes in that order. Shapes: points (n, 3), keys (n,), order (n,); returns (m,), (m, 10).
    """
    n, count = len(order), 0
    for i in range(n):
        count += i == 0 or keys[i] != keys[i - 1]
    starts, sums, cell = np.zeros(count, np.int64), np.zeros((count, MOMENTS)), -1
    for i in range(n):
        row = order[i]
        if i == 0 or keys[i] != keys[i - 1]:
            cell, first = cell + 1, row
            starts[cell] = i
        x, y, z = (
            points[row, 0] - points[first, 0],
            points[row, 1] - points[first, 1],
            points[row, 2] - points[first, 2],
        )
        sums[cell, 0] += 1.0
        sums[cell, 1], sums[cell, 2], sums[cell, 3] = sums[cell, 1] + x, sums[cell, 2] + y, sums[cell, 3] + z
        sums[cell, 4], sums[cell, 5], sums[cell, 6] = (
            sums[cell, 4] + x * x,
            sums[cell, 5] + y * y,
            sums[cell, 6] + z * z,
        )
        sums[cell, 7], sums[cell, 8], sums[cell, 9] = (
            sums[cell, 7] + x * y,
            sums[cell, 8] + x * z,
            sums[cell, 9] + y * z,
        )
    # Of offsets from the first point of the cell: far from the origin their products have digits left.
    for cell in range(count):
        held, first = sums[cell, 0], order[starts[cell]]
        x, y, z = sums[cell, 1] / held, sums[cell, 2] / held, sums[cell, 3] / held
        sums[cell, 1], sums[cell, 2], sums[cell, 3] = points[first, 0] + x, points[first, 1] + y, points[first, 2] + z
        sums[cell, 4], sums[cell, 5], sums[cell, 6] = (
            sums[cell, 4] - held * (x * x),
            sums[cell, 5] - held * (y * y),
            sums[cell, 6] - held * (z * z),
        )
        sums[cell, 7], sums[cell, 8], sums[cell, 9] = (
            sums[cell, 7] - held * (x * y),
            sums[cell, 8] - held * (x * z),
            sums[cell, 9] - held * (y * z),
        )
    return starts, sums


@compiled
def joined_moments(starts: IntArray, counts: FloatArray, means: FloatArray, scatters: FloatArray) -> FloatArray:
    """Moments of cells joined, those from each start to the next one's: as `cell_moments` has them. O(m).

    Shapes: starts (b + 1,), counts (m,), means (m, 3), scatters (m, 6); returns (b, 10).
    """
    sums = np.zeros((len(starts) - 1, MOMENTS))
    for block in range(len(sums)):
        first, last = starts[block], starts[block + 1]
        total = mx = my = mz = 0.0
        for i in range(first, last):
            w = counts[i]
            total, mx, my, mz = total + w, mx + w * means[i, 0], my + w * means[i, 1], mz + w * means[i, 2]
        mx, my, mz = mx / total, my / total, mz / total
        sums[block, 0], sums[block, 1], sums[block, 2], sums[block, 3] = total, mx, my, mz
        for i in range(first, last):
            w, x, y, z = counts[i], means[i, 0] - mx, means[i, 1] - my, means[i, 2] - mz
            sums[block, 4] += scatters[i, 0] + w * x * x
            sums[block, 5] += scatters[i, 1] + w * y * y
            sums[block, 6] += scatters[i, 2] + w * z * z
            sums[block, 7] += scatters[i, 3] + w * x * y
            sums[block, 8] += scatters[i, 4] + w * x * z
            sums[block, 9] += scatters[i, 5] + w * y * z
    return sums


@compiled
def table_of(codes: Codes) -> IntArray:
    """Table of codes that all differ: their rows, and -1 where a slot is free, as half of them are at least. O(n)."""
    slots = 2
    while slots < 2 * len(codes):
        slots *= 2
    table = np.full(slots, -1, np.int64)
    for row in range(len(codes)):
        table[slot_of(codes[row], codes, table)] = row
    return table


@compiled
def slot_of(code: np.uint64, codes: Codes, table: IntArray) -> np.int64:
    """Slot of a code in a table of rows of codes, or the free one that it belongs in. O(1)."""
    mask = len(table) - 1
    slot = np.int64((code * np.uint64(FACTOR)) >> np.uint64(UPPER)) & mask
    while table[slot] >= 0 and codes[table[slot]] != code:
        slot = (slot + 1) & mask
    return np.int64(slot)
