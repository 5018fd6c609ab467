"""Normal equations of many rows of six numbers: rows are added a few dozen at once, each in a lane of its own."""

from __future__ import annotations

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import inside_kernels

# Unknowns; products of their numbers with each other and with the right-hand side; rows that are added at once.
SIX, PRODUCTS, LANES = 6, 27, 64
# Six numbers, right-hand side, weight, and what further sums are weighed by.
RIGHT, WEIGHT, BY, COLUMNS = 6, 7, 8, 9


@inside_kernels
def add_rows(rows: FloatArray, sums: FloatArray) -> None:
    """Add the weighted products of rows, one a lane, (COLUMNS, LANES), to sums, (m, PRODUCTS, LANES).

    The second sums are weighed by a number of each row as well, the third by its square.
    """
    place = 0
    for k in range(SIX + 1):
        for j in range(min(k + 1, SIX)):
            for lane in range(LANES):
                sums[0, place, lane] += rows[WEIGHT, lane] * rows[k, lane] * rows[j, lane]
            if len(sums) > 1:
                for lane in range(LANES):
                    product = rows[WEIGHT, lane] * rows[BY, lane] * rows[k, lane] * rows[j, lane]
                    sums[1, place, lane] += product
                    sums[2, place, lane] += rows[BY, lane] * product
            place += 1


@inside_kernels
def place_sums(sums: FloatArray, A: FloatArray, g: FloatArray, row: int, column: int) -> None:
    """Write the lower half of six rows and columns of a matrix, and as many rows of a right-hand side, from sums.

    Shapes: sums (PRODUCTS, LANES); rows and columns from those that are given on.
    """
    place = 0
    for k in range(SIX + 1):
        for j in range(min(k + 1, SIX)):
            total = 0.0
            for lane in range(LANES):
                total += sums[place, lane]
            if k < SIX:
                A[row + k, column + j] = total
            else:
                g[row + j] = total
            place += 1
