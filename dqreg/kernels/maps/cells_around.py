"""Cells of a map around one that hold points."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import IntArray
from dqreg.kernels.compiling.compiled import inside_kernels
from dqreg.kernels.maps.voxel_blocks import Voxels, block_at
from dqreg.kernels.maps.voxel_points import CELLS

# Cells around one at most: so many reach into two blocks along an axis, of eight cells a side each, and no more.
WIDEST = 4
# Rows of what is found at most; and its columns: the number of a cell, and the steps to it along the axes.
ROOM, COLUMNS = (2 * WIDEST + 1) ** 3, 4


@inside_kernels
def cells_around(
    a: int, b: int, c: int, reach: int, table: Voxels, keys: IntArray, cells: Voxels, found: IntArray
) -> int:
    """Write the cells that hold points, so many around one at most, block by block and voxel by voxel; how many.

    Shapes: found (ROOM, COLUMNS).
    """
    count = int(np.int64(0))
    for i in range((a - reach) >> 3, ((a + reach) >> 3) + 1):
        for j in range((b - reach) >> 3, ((b + reach) >> 3) + 1):
            for m in range((c - reach) >> 3, ((c + reach) >> 3) + 1):
                block = block_at(i, j, m, table, keys)
                if block >= 0:
                    count = _in_block(a - 8 * i, b - 8 * j, c - 8 * m, reach, block, cells, found, count)
    return count


@inside_kernels
def _in_block(a: int, b: int, c: int, reach: int, block: int, cells: Voxels, found: IntArray, count: int) -> int:
    """The same in one block, by the place of the cell from its corner."""
    for i in range(max(a - reach, 0) >> 1, (min(a + reach, 7) >> 1) + 1):
        within_x = (0x0F if 2 * i >= a - reach else 0) | (0xF0 if 2 * i < a + reach else 0)
        for j in range(max(b - reach, 0) >> 1, (min(b + reach, 7) >> 1) + 1):
            within_xy = within_x & ((0x33 if 2 * j >= b - reach else 0) | (0xCC if 2 * j < b + reach else 0))
            for m in range(max(c - reach, 0) >> 1, (min(c + reach, 7) >> 1) + 1):
                held = int(cells[block, (i << 4) | (j << 2) | m])
                bits = held & within_xy & ((0x55 if 2 * m >= c - reach else 0) | (0xAA if 2 * m < c + reach else 0))
                if bits == 0:
                    continue
                first = ((held >> CELLS) - 1) * CELLS
                for s in range(CELLS):
                    if (bits >> s) & 1:
                        found[count, 0], found[count, 1] = first + s, 2 * i + (s >> 2) - a
                        found[count, 2], found[count, 3] = 2 * j + ((s >> 1) & 1) - b, 2 * m + (s & 1) - c
                        count += 1
    return count
