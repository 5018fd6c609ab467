"""Normal equations of many rows of six numbers: rows are added a few dozen at once, each in a lane of its own."""

from __future__ import annotations

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import inside_kernels

# Unknowns; products of their numbers with each other and with the right-hand side.
UNKNOWNS, PRODUCTS = 6, 27
# Rows that are added at once.
LANES = 64
# Six numbers, then the right-hand side, the weight,
RIGHT, WEIGHT = 6, 7
# and the factor of further sums.
FACTOR, COLUMNS = 8, 9


@inside_kernels
def add_rows(rows: FloatArray, sums: FloatArray) -> None:
    """Add the weighted products of rows, one a lane, (COLUMNS, LANES), to sums, (m, PRODUCTS, LANES).

    The second sums are weighed by a number of each row as well, the third by its square.
    """
    place = 0
    for k in range(UNKNOWNS + 1):
        for j in range(min(k + 1, UNKNOWNS)):
            for lane in range(LANES):
                sums[0, place, lane] += rows[WEIGHT, lane] * rows[k, lane] * rows[j, lane]
            if len(sums) > 1:
                for lane in range(LANES):
                    product = rows[WEIGHT, lane] * rows[FACTOR, lane] * rows[k, lane] * rows[j, lane]
                    sums[1, place, lane] += product
                    sums[2, place, lane] += rows[FACTOR, lane] * product
            place += 1


@inside_kernels
def place_sums(sums: FloatArray, A: FloatArray, g: FloatArray, row: int, column: int) -> None:
    """Write the lower half of six rows and columns of a matrix, and as many rows of a right-hand side, from sums.

    Shapes: sums (PRODUCTS, LANES); rows and columns from those that are given on.
    """
    place = 0
    for k in range(UNKNOWNS + 1):
        for j in range(min(k + 1, UNKNOWNS)):
            total = 0.0
            for lane in range(LANES):
                total += sums[place, lane]
            if k < UNKNOWNS:
                A[row + k, column + j] = total
            else:
                g[row + j] = total
            place += 1
