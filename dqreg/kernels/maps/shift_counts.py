"""How many cells of a grid come to lie on marked ones when all are shifted, shift by shift."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, IntArray
from dqreg.kernels.compiling.compiled import compiled

Counts = NDArray[np.int32]
# Columns from one marked cell to the next one at which what is beside them no longer touches.
APART = 4


@compiled
def count_on_runs(cells: IntArray, runs: IntArray, lowest: IntArray, counts: Counts) -> None:
    """Add to zeros how many cells, (n, 2), each shift puts onto marked ones, (h, w + 1); the last column is none.

    Marked are runs within rows, (k, 3): the row, the first column and the one after the last. The lowest shift along
    either axis is given. O(n k + h w).
    """
    height, width = len(counts), counts.shape[1] - 1
    for i in range(len(cells)):
        a, b = cells[i, 0] + lowest[0], cells[i, 1] + lowest[1]
        for k in range(len(runs)):
            row = runs[k, 0] - a
            if 0 <= row < height:
                # Where a run begins and where it has ended.
                counts[row, min(max(runs[k, 1] - b, 0), width)] += 1
                counts[row, min(max(runs[k, 2] - b, 0), width)] -= 1
    for row in range(height):
        for column in range(1, width + 1):
            counts[row, column] += counts[row, column - 1]


def runs_around(marked: BoolArray) -> IntArray:
    """Runs within rows of cells that are marked or beside one that is, (k, 3): row, first column, one after the last.

    As far as to one row and one column after the last ones of the grid.
    """
    height, width = marked.shape
    runs, count = np.zeros(((height + 1) * (width // 2 + 2), 3), dtype=np.int64), np.zeros(1, dtype=np.int64)
    write_runs(marked, runs, count)
    return runs[: count[0]]


@compiled
def write_runs(marked: BoolArray, runs: IntArray, count: IntArray) -> None:
    """Write the runs, row by row, and add their number to a zero. O(h w)."""
    height, width = marked.shape
    for row in range(height + 1):
        # The last marked column so far; runs that touch are one.
        low, high, begin, last = max(row - 1, 0), min(row + 1, height - 1), 0, -APART
        for column in range(width):
            is_marked = False
            for k in range(low, high + 1):
                is_marked = is_marked or marked[k, column]
            if not is_marked:
                continue
            if column - last >= APART:
                if last >= 0:
                    runs[count[0], 0], runs[count[0], 1], runs[count[0], 2] = row, begin, last + 2
                    count[0] += 1
                begin = max(column - 1, 0)
            last = column
        if last >= 0:
            runs[count[0], 0], runs[count[0], 1], runs[count[0], 2] = row, begin, last + 2
            count[0] += 1


@compiled
def count_at_shifts(
    first: int, last: int, shifts: IntArray, cells: IntArray, marked: BoolArray, counts: Counts
) -> None:
    """Write how many cells, (n, 2), shifts first to last, (m, 2), put onto marked ones of a grid. O(n) each."""
    height, width = marked.shape
    for i in range(first, last):
        found = 0
        for k in range(len(cells)):
            a, b = cells[k, 0] + shifts[i, 0], cells[k, 1] + shifts[i, 1]
            if 0 <= a < height and 0 <= b < width and marked[a, b]:
                found += 1
        counts[i] = found
