"""Blocks of eight cells, found by their codes, and the cells of twice the edge that they make."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.cells.grid_cells import KEY_FACTOR, Slots, U, shift_of
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.order.morton import Codes

# Slots a block: nearly all that are looked for and not there meet a free slot at once.
SLOTS_PER_BLOCK = 8
# Every third bit of a Morton code, from the lowest on: the number of a cell along one axis.
ALONG_Z = np.uint64(0x1249249249249249)
ALONG_Y, ALONG_X = ALONG_Z << np.uint64(1), ALONG_Z << np.uint64(2)
OTHERS = ~(ALONG_X | ALONG_Y | ALONG_Z)
# Blocks of two cells a side, and those around one; cells of these.
BLOCKS_AROUND, BLOCK_CELLS = 27, 8


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
    slots = 2
    while slots < SLOTS_PER_BLOCK * count:
        slots *= 2
    table, mask = np.full(slots, count, np.int32), U(slots - 1)
    shift = shift_of(table)
    for row in range(count):
        slot = (blocks[row] * KEY_FACTOR) >> shift
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
        first, last, missing = U(starts[block]), U(starts[block + 1]), False
        total = mx = my = mz = 0.0
        for i in range(first, last):
            w = counts[i]
            total, mx, my, mz = total + w, mx + w * means[i, 0], my + w * means[i, 1], mz + w * means[i, 2]
            missing |= np.isnan(fits[i, 0])
        mx, my, mz = mx / total, my / total, mz / total
        totals[block], middles[block, 0], middles[block, 1], middles[block, 2] = total, mx, my, mz
        xx = yy = zz = xy = xz = yz = 0.0
        for i in range(first, last):
            w, x, y, z = counts[i], means[i, 0] - mx, means[i, 1] - my, means[i, 2] - mz
            xx, yy = xx + (scatters[i, 0] + w * x * x), yy + (scatters[i, 1] + w * y * y)
            zz, xy = zz + (scatters[i, 2] + w * z * z), xy + (scatters[i, 3] + w * x * y)
            xz, yz = xz + (scatters[i, 4] + w * x * z), yz + (scatters[i, 5] + w * y * z)
        spreads[block, 0], spreads[block, 1], spreads[block, 2] = xx, yy, zz
        spreads[block, 3], spreads[block, 4], spreads[block, 5] = xy, xz, yz
        asked[block] = missing
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
def cells_around(
    block: int, starts: IntArray, blocks: Codes, table: Slots, beside: Codes, rows: IntArray, near: IntArray
) -> int:
    """Write the cells of a block and of those around it; how many they are. There is room for nine codes, 28 rows."""
    none, shift, mask = len(blocks) - 1, shift_of(table), U(len(table) - 1)
    code, found, count = blocks[block], U(0), U(0)
    put_beside(code, ALONG_X, beside[:3])
    put_beside(code, ALONG_Y, beside[3:6])
    put_beside(code, ALONG_Z, beside[6:])
    rest = code & OTHERS
    for x in range(3):
        for y in range(3, 6):
            xy = rest | beside[x] | beside[y]
            for z in range(6, 9):
                wanted = xy | beside[z]
                slot = (wanted * KEY_FACTOR) >> shift
                row = np.int64(table[slot])
                # Both are looked at in any case: which blocks are there is as good as random.
                while (row != none) & (blocks[U(row)] != wanted):
                    slot = (slot + U(1)) & mask
                    row = np.int64(table[slot])
                rows[found] = row
                found += U(1) if row != none else U(0)
    for k in range(found):
        row = rows[U(k)]
        for cell in range(starts[U(row)], starts[U(row + 1)]):
            near[count] = cell
            count += U(1)
    return int(count)


@inside_kernels
def put_beside(code: np.uint64, mask: np.uint64, three: Codes) -> None:
    """Write the numbers of a cell along an axis less one, its own and one more; beyond the ends at the other one."""
    one, own = mask & (~mask + U(1)), code & mask
    three[0], three[1], three[2] = (own - one) & mask, own, ((own | ~mask) + one) & mask
