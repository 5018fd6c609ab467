"""Voxels in blocks of four a side, found by a table: what lies beside a voxel is mostly in its own block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# What cells of a block are multiplied with: large odd numbers, so that neighbours lie far apart in the table.
FACTOR_A, FACTOR_B = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F)
FACTOR_C = np.uint64(0x165667B19E3779F9)
HALF = np.uint64(32)
# Voxels along a side of a block, as a power of two, and of a whole block.
BITS, VOXELS = 2, 64

Voxels = NDArray[np.int32]


@inside_kernels
def block_at(a: int, b: int, c: int, table: Voxels, keys: IntArray) -> int:
    """Number of a block by its cell, or -1. The table, with room to spare, holds one more than the numbers, 0 none."""
    last = np.uint64(len(table) - 1)
    code = np.uint64(a) * FACTOR_A + np.uint64(b) * FACTOR_B + np.uint64(c) * FACTOR_C
    place = (code ^ (code >> HALF)) & last
    block = int(table[place]) - 1
    while block >= 0 and (keys[block, 0] != a or keys[block, 1] != b or keys[block, 2] != c):
        place = (place + np.uint64(1)) & last
        block = int(table[place]) - 1
    return block


@inside_kernels
def put_block(block: int, table: Voxels, keys: IntArray) -> None:
    """Enter a block, by its cell, into a table that does not hold it."""
    last = np.uint64(len(table) - 1)
    code = (
        np.uint64(keys[block, 0]) * FACTOR_A
        + np.uint64(keys[block, 1]) * FACTOR_B
        + np.uint64(keys[block, 2]) * FACTOR_C
    )
    place = (code ^ (code >> HALF)) & last
    while table[place] > 0:
        place = (place + np.uint64(1)) & last
    table[place] = block + 1


@inside_kernels
def place_in_block(a: int, b: int, c: int) -> int:
    """Number of a voxel within its block."""
    return ((a & 3) << 4) | ((b & 3) << 2) | (c & 3)


@compiled
def put_blocks(keys: IntArray, count: int, table: Voxels) -> None:
    """Enter blocks into an empty table. O(1) each."""
    for block in range(count):
        put_block(block, table, keys)
