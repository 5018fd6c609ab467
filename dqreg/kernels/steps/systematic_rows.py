"""Systematic sampling: rows at equal steps of a running sum of their rates."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def systematic_rows(rates: FloatArray, lengths: IntArray, left_out: BoolArray, rows: IntArray) -> int:
    """Write the rows at which the sum of the rates passes a whole number and a half, and return how many. O(n).

    Runs of so many rows have one rate each, (m,); rows that are left out, (n,) or none at all, are of no run.
    """
    total, passed, row, count = 0.0, 0.0, 0, 0
    for j in range(len(lengths)):
        for _ in range(lengths[j]):
            while row < len(left_out) and left_out[row]:
                row += 1
            total += rates[j]
            now = np.floor(total + 0.5)
            if now > passed:
                rows[count] = row
                count += 1
            passed = now
            row += 1
    return count
