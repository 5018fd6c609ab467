"""From sums over correspondences to the quadratic form of a pose, and to the pose of least cost."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.steps.newton_steps import newton_steps

# Numbers of a pose: (vec R, t, 1), R row by row.
NUMBERS = 13
# Sums over correspondences of p and q with the matrix E of their cost, ``(R p + t - q)^T E (R p + t - q)``: ten
# products of (p, 1) with itself times six elements of E (xx, yy, zz, xy, xz, yz),
PRODUCTS, ELEMENTS = 10, 6
# E q times (p, 1), and ``q^T E q``.
MIXED = 12
SUMS = PRODUCTS * ELEMENTS + MIXED + 1
# Rows and columns of those elements,
ROW_OF, COLUMN_OF = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
# and the first of the rows of (p, 1) in a triangle of products.
FIRST_OF = (0, 3, 5, 6)
# A constant here, and not asked of NumPy by compiled code, which would import SciPy whenever it is loaded.
TINY = float(np.finfo(np.float64).tiny)


@inside_kernels
def add_pair(
    point: tuple[float, float, float],
    elements: tuple[float, float, float, float, float, float],
    sides: tuple[float, float, float],
    total: FloatArray,
) -> int:
    """Add a correspondence, given the elements of E and E q, to the sums; returns the place of ``q^T E q``."""
    p, q, r = point
    xx, yy, zz, xy, xz, yz = elements
    at = 0
    for product in (p * p, p * q, p * r, p, q * q, q * r, q, r * r, r, 1.0):
        total[at] += product * xx
        total[at + 1] += product * yy
        total[at + 2] += product * zz
        total[at + 3] += product * xy
        total[at + 4] += product * xz
        total[at + 5] += product * yz
        at += 6
    for side in sides:
        total[at] += side * p
        total[at + 1] += side * q
        total[at + 2] += side * r
        total[at + 3] += side
        at += 4
    return at


@inside_kernels
def place_of(row: int, k: int) -> int:
    """Where number k of ``R p + t`` by one row, factors of (p, 1), stands among the numbers of a pose."""
    return 3 * row + k if k < 3 else 9 + row


@compiled
def form_of_sums(sums: FloatArray, origins: FloatArray, matrix: FloatArray) -> None:
    """Write the form that the sums of all chunks make, (13, 13), about the origins that they were taken from.

    Sums of more columns hold the weights, the points and the feet as well: then the form, and the origins, (2, 3), are
    moved to the weighted means. Shapes: sums (chunks, 73 or more).
    """
    total = np.zeros(sums.shape[1])
    for chunk in range(len(sums)):
        for k in range(len(total)):
            total[k] += sums[chunk, k]
    for e in range(ELEMENTS):
        i, j = ROW_OF[e], COLUMN_OF[e]
        for k in range(4):
            for m in range(k, 4):
                value = total[ELEMENTS * (FIRST_OF[k] + m) + e]
                a, b, c, d = place_of(i, k), place_of(j, m), place_of(i, m), place_of(j, k)
                matrix[a, b] = matrix[b, a] = matrix[c, d] = matrix[d, c] = value
    for i in range(3):
        for k in range(4):
            at = place_of(i, k)
            matrix[at, 12] = matrix[12, at] = -total[ELEMENTS * PRODUCTS + 4 * i + k]
    matrix[12, 12] = total[SUMS - 1]
    if len(total) > SUMS and total[SUMS] > 0.0:
        move_origins(matrix, total[SUMS + 1 : SUMS + 7] / total[SUMS], origins)


@inside_kernels
def move_origins(matrix: FloatArray, steps: FloatArray, origins: FloatArray) -> None:
    """Bring a form, (13, 13), about other origins, which are so far from the old ones, (6,)."""
    # The old translation is ``t' - R steps_source + steps_target``, linear in the numbers of the pose.
    for side in range(2):
        for i in range(NUMBERS):
            for k in range(3):
                here = matrix[i, 9 + k] if side == 0 else matrix[9 + k, i]
                for j in range(4):
                    at, step = (3 * k + j, -steps[j]) if j < 3 else (12, steps[3 + k])
                    if side == 0:
                        matrix[i, at] += here * step
                    else:
                        matrix[at, i] += here * step
    for j in range(3):
        origins[0, j] += steps[j]
        origins[1, j] += steps[3 + j]


@compiled
def least_cost_pose(
    matrix: FloatArray,
    origins: FloatArray,
    start: FloatArray,
    steps: int,
    nothing: float,
    noise: float,
    longest: float,
    flat: float,
    found: FloatArray,
) -> float:
    """Write the pose, (4, 4), to which Newton's steps lead from a start; returns its cost. See `newton_steps`."""
    y, before = np.zeros(NUMBERS), np.zeros(3)
    y[12] = 1.0
    for i in range(3):
        shift = start[i, 3] - origins[1, i]
        for j in range(3):
            y[3 * i + j] = start[i, j]
            shift += start[i, j] * origins[0, j]
        y[9 + i] = before[i] = shift
    size = 0.0
    for k in range(9):
        size += matrix[k, k] / 3.0
    size = max(matrix[12, 12], size, TINY)
    cost = newton_steps(matrix, y, size, steps, nothing, noise, longest, flat)
    for i in range(3):
        # Only the change is added: numbers about the origins of the form have lost the last digits of the pose.
        change = y[9 + i] - before[i]
        for j in range(3):
            change -= (y[3 * i + j] - start[i, j]) * origins[0, j]
            found[i, j] = y[3 * i + j]
        found[i, 3] = start[i, 3] + change
        found[3, i] = 0.0
    found[3, 3] = 1.0
    return cost
