"""Cells of a plane that hold points, and the gaps that these enclose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled

# Of a gap: its label, its cells, those of them that the other side holds, first and last row and column.
COLUMNS = 7


@compiled
def hold_cells(flat: FloatArray, low: FloatArray, cell: float, cells: BoolArray) -> None:
    """Mark the cells, (h, w), from a corner, (2,), that hold points of a plane, (n, 2). O(n)."""
    height, width = cells.shape
    for i in range(len(flat)):
        row, column = np.floor((flat[i, 0] - low[0]) / cell), np.floor((flat[i, 1] - low[1]) / cell)
        if row >= 0.0 and row < height and column >= 0.0 and column < width:
            cells[int(row), int(column)] = True


@compiled
def enclosed_gaps(
    own: BoolArray, theirs: BoolArray, least: int, labels: NDArray[np.int32], stack: IntArray, found: IntArray
) -> int:
    """Label what is free of one side, (h, w), from 1 on, and write the gaps of so many cells at least that it encloses.

    Cells beside each other are of one gap; that of the first cell is outside. Returns how many were written. O(h w).
    Shapes: theirs, which is the other side, and labels, all zero, (h, w); stack (h w,); found (h w / least, 7).
    """
    height, width = own.shape
    known = label = 0
    for first in range(height * width):
        r, c = first // width, first % width
        if own[r, c] or labels[r, c] > 0:
            continue
        label += 1
        labels[r, c], stack[0], waiting = label, first, 1
        size = filled = 0
        top, bottom, left, right = height, -1, width, -1
        while waiting > 0:
            waiting -= 1
            r, c = stack[waiting] // width, stack[waiting] % width
            size, filled = size + 1, filled + theirs[r, c]
            top, bottom, left, right = min(top, r), max(bottom, r), min(left, c), max(right, c)
            for k in range(4):
                # Down, up, right and left.
                x, y = r + (k == 0) - (k == 1), c + (k == 2) - (k == 3)
                if x < 0 or x >= height or y < 0 or y >= width or own[x, y] or labels[x, y] > 0:
                    continue
                labels[x, y], stack[waiting] = label, x * width + y
                waiting += 1
        if label > 1 and size >= least:
            found[known, 0], found[known, 1], found[known, 2] = label, size, filled
            found[known, 3], found[known, 4], found[known, 5], found[known, 6] = top, bottom, left, right
            known += 1
    return known
