"""Eigenvectors of the largest eigenvalues of the 4x4 forms of `solvers.closed_form`, many at once.

Jacobi's method on `LANES` forms side by side, so that one instruction works on several. A step turns the pairs (0, 1)
and (2, 3) and renames the axes, so that three steps meet all six pairs. What is small enough is not turned: a form that
is done stays as it is while its neighbours go on, so its bits do not depend on them.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Forms side by side: their numbers stay in the nearest cache.
LANES = 64
# Entries off the diagonal, in units of the largest entry of H, that are not turned away: far below its rounding.
NOTHING = 1e-19
# Steps at most, three times the sweeps; twelve to eighteen are what forms need.
MOST_STEPS = 60
# Rows of the lanes that hold entries 00, 11, 22, 33.
DIAGONAL = (0, 4, 7, 9)


@inside_kernels
def turn(p: float, q: float, pq: float) -> tuple[float, float, float]:
    """Cosine, sine and tangent of the smaller angle that makes the entry pq of a symmetric matrix zero."""
    double, apart = 2.0 * pq, q - p
    t = double / (abs(apart) + math.sqrt(apart * apart + double * double))
    t = t if abs(pq) > NOTHING else 0.0
    t = t if apart >= 0.0 else -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    return c, t * c, t


@inside_kernels
def write_forms(H: FloatArray, first: int, count: int, A: FloatArray) -> None:
    """Entries 00, 01, 02, 03, 11, 12, 13, 22, 23, 33 of each form in units of the largest entry of H, and that unit."""
    for k in range(count):
        i, unit = first + k, 0.0
        for row in range(3):
            for column in range(3):
                unit = max(unit, abs(H[row, column, i]))
        unit = unit if unit > 0.0 else 1.0
        xx, xy, xz = H[0, 0, i] / unit, H[0, 1, i] / unit, H[0, 2, i] / unit
        yx, yy, yz = H[1, 0, i] / unit, H[1, 1, i] / unit, H[1, 2, i] / unit
        zx, zy, zz = H[2, 0, i] / unit, H[2, 1, i] / unit, H[2, 2, i] / unit
        A[0, k], A[1, k], A[2, k], A[3, k] = xx + yy + zz, zy - yz, xz - zx, yx - xy
        A[4, k], A[5, k], A[6, k] = xx - yy - zz, xy + yx, xz + zx
        A[7, k], A[8, k], A[9, k] = yy - xx - zz, yz + zy, zz - xx - yy
        A[10, k] = unit


@inside_kernels
def is_done(A: FloatArray, count: int) -> bool:
    """Whether no lane has an entry left to turn."""
    for j in (1, 2, 3, 5, 6, 8):
        for k in range(count):
            if abs(A[j, k]) > NOTHING:
                return False
    return True


@inside_kernels
def read_largest(A: FloatArray, V: FloatArray, first: int, count: int, values: FloatArray, vectors: FloatArray) -> None:
    """Write the three largest entries of each diagonal, falling, and the unit column of V that the first belongs to."""
    for k in range(count):
        best, i, unit, square = 0, first + k, A[10, k], 0.0
        for j in range(1, 4):
            if A[DIAGONAL[j], k] > A[DIAGONAL[best], k]:
                best = j
        x, y, z = (A[DIAGONAL[(best + 1) % 4], k], A[DIAGONAL[(best + 2) % 4], k], A[DIAGONAL[(best + 3) % 4], k])
        values[0, i] = unit * A[DIAGONAL[best], k]
        values[1, i] = unit * max(x, y, z)
        values[2, i] = unit * max(min(x, y), min(max(x, y), z))
        for j in range(best, 16, 4):
            square += V[j, k] * V[j, k]
        for j in range(4):
            vectors[j, i] = V[4 * j + best, k] / math.sqrt(square)


@compiled
def largest_eigenvectors(first: int, last: int, H: FloatArray, values: FloatArray, vectors: FloatArray) -> None:
    """Write the three largest eigenvalues (3, b), falling, and the unit vectors (4, b) of the first.

    The form of a matrix H is that of `closed_form.quaternion_form`. Shapes: H (3, 3, b), finite.
    """
    # Arrays of a size that is known here, and steps on them here: only so does the compiler see that no rows overlap.
    A, V = np.zeros((11, LANES)), np.zeros((16, LANES))
    for start in range(first, last, LANES):
        count = min(LANES, last - start)
        write_forms(H, start, count, A)
        V[:] = 0.0
        for j in range(0, 16, 5):
            V[j] = 1.0
        for turned in range(1, MOST_STEPS + 1):
            for k in range(LANES):
                c, s, t = turn(A[0, k], A[4, k], A[1, k])
                d, e, u = turn(A[7, k], A[9, k], A[8, k])
                a02, a12 = c * A[2, k] - s * A[5, k], s * A[2, k] + c * A[5, k]
                a03, a13 = c * A[3, k] - s * A[6, k], s * A[3, k] + c * A[6, k]
                a02, a03 = d * a02 - e * a03, e * a02 + d * a03
                a12, a13 = d * a12 - e * a13, e * a12 + d * a13
                a00, a11 = A[0, k] - t * A[1, k], A[4, k] + t * A[1, k]
                a22, a33 = A[7, k] - u * A[8, k], A[9, k] + u * A[8, k]
                # The axes 1, 2, 3 are 2, 3, 1 from here on; what was too small to be turned is as good as zero.
                A[0, k], A[1, k], A[2, k], A[3, k] = a00, a03, 0.0, a02
                A[4, k], A[5, k], A[6, k] = a33, a13, 0.0
                A[7, k], A[8, k], A[9, k] = a11, a12, a22
                for j in range(0, 16, 4):
                    v0, v1, v2, v3 = V[j, k], V[j + 1, k], V[j + 2, k], V[j + 3, k]
                    V[j, k], V[j + 2, k] = c * v0 - s * v1, s * v0 + c * v1
                    V[j + 3, k], V[j + 1, k] = d * v2 - e * v3, e * v2 + d * v3
            # Only then have the axes their own names again, by which equals are chosen.
            if turned % 3 == 0 and is_done(A, count):
                break
        read_largest(A, V, start, count, values, vectors)
