"""The order of triangles along the Morton curve, exact copies left out."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.kernels.compiled import compiled
from dqreg.kernels.copies import FIRST, first_copies
from dqreg.kernels.morton import Codes, morton_cells, sorted_rows
from dqreg.kernels.split_sort import CHUNK, split_sorted_rows
from dqreg.kernels.threads import over_chunks

# Bits of each coordinate's cell, and of a mark beside it: the two halves of most rectangles have one box.
CELL_BITS, MARK_BITS = 19, 6


def order_of_triangles(corners: FloatArray) -> tuple[IntArray, IntArray | None]:
    """Rows of different triangles by the middles of their boxes, and of each the first copy; None where none has any.

    Shapes: corners (m, 3, 3), rows (n,), first (m,). O(m).
    """
    count = len(corners)
    middles, (codes, marks) = np.zeros((count, 3)), np.zeros((2, count), dtype=np.uint64)
    over_chunks(middles_of, count, corners, middles, marks, chunk=CHUNK)
    low, high = bounds(middles)
    extent = float((high - low).max())
    over_chunks(morton_cells, count, middles, low, (2**CELL_BITS - 1) / extent if extent else 0.0, codes, chunk=CHUNK)
    codes <<= np.uint64(MARK_BITS)
    codes |= marks
    rows, keys = split_sorted_rows(codes) if count > 2 * CHUNK else sorted_rows(codes)
    # Copies are in one cell with one mark, and few other triangles are.
    alike = keys[1:] == keys[:-1]
    if not alike.any():
        return rows, None
    shared = np.zeros(count, dtype=bool)
    shared[rows[1:][alike]], shared[rows[:-1][alike]] = True, True
    some, first = np.flatnonzero(shared), np.arange(count)
    first[some] = some[first_copies(np.take(corners, some, axis=0))]
    return rows[(first == np.arange(count))[rows]], first


@compiled
def middles_of(first: int, last: int, corners: FloatArray, middles: FloatArray, marks: Codes) -> None:
    """Write twice the middles of the boxes of triangles first to last, (n, 3), and random marks of their shapes, (n,).

    Both are the same bits in whatever order the corners are.
    """
    inner = np.zeros(1)
    words = inner.view(np.uint64)
    for f in range(first, last):
        mark = np.uint64(0)
        for k in range(3):
            a, b, c = corners[f, 0, k], corners[f, 1, k], corners[f, 2, k]
            low, high = min(a, b), max(a, b)
            middles[f, k] = min(low, c) + max(high, c)
            # Minus zero is the same place as zero.
            inner[0] = max(low, min(high, c)) + 0.0
            mark = (mark ^ words[0]) * np.uint64(FIRST)
        marks[f] = mark >> np.uint64(64 - MARK_BITS)
