"""Rows drawn by weight: where a number falls among running sums, begun near by instead of in the middle."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def drawn_rows(totals: FloatArray, numbers: FloatArray, begins: IntArray, rows: IntArray) -> None:
    """Write the row of each number: the first whose running sum is above it.

    ``begins``, (m,), zeros, is room for the first such row of each of m equal steps up to the last sum. O(1) a number,
    where rows weigh about the same.
    """
    steps, last, row = len(begins), len(totals) - 1, 0
    width = totals[last] / steps
    for k in range(steps):
        # Rounding may put a number into the step below its own.
        while row < last and totals[row] <= (k - 1e-6) * width:
            row += 1
        begins[k] = row
    for i in range(len(numbers)):
        row = begins[min(int(numbers[i] / width), steps - 1)]
        while row < last and totals[row] <= numbers[i]:
            row += 1
        rows[i] = row
