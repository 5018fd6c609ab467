"""Blocks of eight cells, found by their codes, and the cells of twice the edge that they make."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.grid_cells import FACTOR, Slots, U
from dqreg.kernels.morton import Codes

# Slots a block: nearly all that are looked for and not there meet a free slot at once.
SLOTS_PER_BLOCK = 8
# Every third bit of a Morton code, from the lowest on: the number of a cell along one axis.
ALONG_Z = np.uint64(0x1249249249249249)
ALONG_Y, ALONG_X = ALONG_Z << np.uint64(1), ALONG_Z << np.uint64(2)
OTHERS = ~(ALONG_X | ALONG_Y | ALONG_Z)
# Blocks of two cells a side, and those around one; cells of these.
BLOCKS, CELLS = 27, 8
# Numbers of a cell: its points, their mean, and the scatter xx, yy, zz, xy, xz, yz about that.
MOMENTS = 10


@compiled
def cell_blocks(
    codes: Codes, counts: FloatArray, scatters: FloatArray, most: float
) -> tuple[IntArray, Codes, Slots, FloatArray, FloatArray]:
    """Where blocks begin among cells in Morton order, their codes and a table of these; weights and scatters. O(m).

    A table holds rows of the codes, and their number where a slot is free: one code more is none. Points of a cell
    count as so many at most. Shapes: codes (m,), scatters (m, 6); returns (b + 1,), (b + 1,), a power of two, (m,)
    and (m, 6).
    """
    m, count = len(codes), 0
    starts, blocks = np.zeros(m + 1, np.int64), np.zeros(m + 1, np.uint64)
    weights, weighted = np.zeros(m), np.zeros((m, 6))
    for i in range(m):
        block = codes[i] >> U(3)
        if i == 0 or block != blocks[count - 1]:
            starts[count], blocks[count] = i, block
            count += 1
        weights[i] = min(counts[i], most)
        share = weights[i] / counts[i]
        for k in range(6):
            weighted[i, k] = scatters[i, k] * share
    starts[count], blocks[count] = m, ~U(0)
    slots, shift = 2, U(63)
    while slots < SLOTS_PER_BLOCK * count:
        slots, shift = 2 * slots, shift - U(1)
    table, mask = np.full(slots, count, np.int32), U(slots - 1)
    for row in range(count):
        slot = (blocks[row] * FACTOR) >> shift
        while table[slot] != count:
            slot = (slot + U(1)) & mask
        table[slot] = row
    return starts[: count + 1].copy(), blocks[: count + 1].copy(), table, weights, weighted


@compiled
def joined_cells(
    starts: IntArray, counts: FloatArray, means: FloatArray, scatters: FloatArray, fits: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Points, means and scatters of blocks, and which of them hold cells without a plane, those of NaN. O(m).

    Shapes: starts (b + 1,), counts (m,), means (m, 3), scatters (m, 6), fits (m, 7); returns (b,), (b, 3), (b, 6), and
    (b,).
    """
    count = len(starts) - 1
    totals, middles, spreads, asked = (
        np.zeros(count),
        np.zeros((count, 3)),
        np.zeros((count, 6)),
        np.zeros(count, np.bool_),
    )
    for block in range(count):
        first, last = starts[block], starts[block + 1]
        total = mx = my = mz = 0.0
        for i in range(first, last):
            w = counts[i]
            total, mx, my, mz = total + w, mx + w * means[i, 0], my + w * means[i, 1], mz + w * means[i, 2]
            asked[block] |= np.isnan(fits[i, 0])
        mx, my, mz = mx / total, my / total, mz / total
        totals[block], middles[block, 0], middles[block, 1], middles[block, 2] = total, mx, my, mz
        for i in range(first, last):
            w, x, y, z = counts[i], means[i, 0] - mx, means[i, 1] - my, means[i, 2] - mz
            spreads[block, 0] += scatters[i, 0] + w * x * x
            spreads[block, 1] += scatters[i, 1] + w * y * y
            spreads[block, 2] += scatters[i, 2] + w * z * z
            spreads[block, 3] += scatters[i, 3] + w * x * y
            spreads[block, 4] += scatters[i, 4] + w * x * z
            spreads[block, 5] += scatters[i, 5] + w * y * z
    return totals, middles, spreads, asked


@compiled
def hand_down(starts: IntArray, wide: FloatArray, on_rim: BoolArray, fits: FloatArray, rims: BoolArray) -> None:
    """Write the planes of blocks to those of their cells that have none, without a height, see `cell_planes`. O(m)."""
    for block in range(len(wide)):
        for i in range(starts[block], starts[block + 1]):
            if np.isnan(fits[i, 0]):
                for k in range(5):
                    fits[i, k] = wide[block, k]
                fits[i, 6], rims[i] = 0.0, on_rim[block]


@inside_kernels
def cells_around(block: int, starts: IntArray, blocks: Codes, table: Slots, rows: IntArray, near: IntArray) -> int:
    """Write the cells of a block and of those around it; how many they are. There is room for rows of 27 and one."""
    none, shift, mask = len(blocks) - 1, U(64), U(len(table) - 1)
    bits = len(table)
    while bits > 1:
        bits, shift = bits // 2, shift - U(1)
    code, found, count = blocks[block], 0, 0
    rest = code & OTHERS
    for x in range(-1, 2):
        beside_x = rest | moved_along(code, ALONG_X, x)
        for y in range(-1, 2):
            beside_xy = beside_x | moved_along(code, ALONG_Y, y)
            for z in range(-1, 2):
                beside = beside_xy | moved_along(code, ALONG_Z, z)
                slot = (beside * FACTOR) >> shift
                # Both are looked at in any case: which blocks are there is as good as random.
                while (table[slot] != none) & (blocks[table[slot]] != beside):
                    slot = (slot + U(1)) & mask
                rows[found] = table[slot]
                found += 1 if table[slot] != none else 0
    for k in range(found):
        for cell in range(starts[rows[k]], starts[rows[k] + 1]):
            near[count] = cell
            count += 1
    return count


@inside_kernels
def moved_along(code: np.uint64, mask: np.uint64, step: int) -> np.uint64:
    """Number of a cell along an axis or of one next to it; beyond the ends it starts from the other one."""
    one, part = mask & (~mask + np.uint64(1)), code & mask
    if step > 0:
        return ((part | ~mask) + one) & mask
    return (part - one) & mask if step < 0 else part
