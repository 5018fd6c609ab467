"""Planes through neighbouring points."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled

# Elements of a symmetric 3 x 3 matrix: xx, yy, zz, xy, xz, yz.
ELEMENTS = 6
# Rounds of rotations: convergence is quadratic, and six reach the last bit of any matrix.
ROUNDS = 12
# A second extent below this share of the largest, squared, is a line.
LINE = 1e-6


@compiled
def fit_plane_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    normals: FloatArray,
    residuals: FloatArray,
    levers: FloatArray,
) -> None:
    """Write normal, residual and lever of the planes through the k neighbours of rows first to last, (m, k).

    O(k) a row. On a line the normal is NaN and the lever zero.
    """
    count, a, v = neighbours.shape[1], np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        mx = my = mz = 0.0
        for j in range(count):
            t = neighbours[i, j]
            mx, my, mz = mx + points[t, 0], my + points[t, 1], mz + points[t, 2]
        mx, my, mz = mx / count, my / count, mz / count
        for e in range(ELEMENTS):
            a[e] = 0.0
        for j in range(count):
            t = neighbours[i, j]
            x, y, z = points[t, 0] - mx, points[t, 1] - my, points[t, 2] - mz
            a[0], a[1], a[2] = a[0] + x * x, a[1] + y * y, a[2] + z * z
            a[3], a[4], a[5] = a[3] + x * y, a[4] + x * z, a[5] + y * z
        diagonalise(a, v)
        least = 0
        for k in range(1, 3):
            if a[k] < a[least]:
                least = k
        one, two = a[(least + 1) % 3], a[(least + 2) % 3]
        small, large = min(one, two), max(one, two)
        residuals[i] = np.sqrt(max(a[least], 0.0) / (count - 3))
        if small <= LINE * large:
            normals[i, 0] = normals[i, 1] = normals[i, 2] = np.nan
            levers[i] = 0.0
        else:
            for k in range(3):
                normals[i, k] = v[k, least]
            levers[i] = 1.0 / (count / small + count / large)


@compiled
def diagonalise(a: FloatArray, v: FloatArray) -> None:
    """Turn a symmetric matrix (xx, yy, zz, xy, xz, yz) into its eigenvalues, in xx, yy, zz, and v into their axes.

    Cyclic rotations by Jacobi: small eigenvalues keep their digits. Shapes: a (6,), v (3, 3), one axis a column.
    """
    for p in range(3):
        for q in range(3):
            v[p, q] = 1.0 if p == q else 0.0
    for _ in range(ROUNDS):
        if a[3] == 0.0 and a[4] == 0.0 and a[5] == 0.0:
            return
        for e in range(3, ELEMENTS):
            # Elements 3, 4, 5 stand for the axes (0, 1), (0, 2), (1, 2); f and g are those that share one with them.
            p, q = (0, 1) if e == 3 else ((0, 2) if e == 4 else (1, 2))
            f, g = (4, 5) if e == 3 else ((3, 5) if e == 4 else (3, 4))
            off = a[e]
            # What does not change the sum of the diagonal is zero.
            if abs(a[p]) + abs(off) == abs(a[p]) and abs(a[q]) + abs(off) == abs(a[q]):
                a[e] = 0.0
                continue
            h = 0.5 * (a[q] - a[p])
            t = off / (h + np.sqrt(h * h + off * off)) if h >= 0.0 else off / (h - np.sqrt(h * h + off * off))
            c = 1.0 / np.sqrt(1.0 + t * t)
            s = t * c
            a[p], a[q], a[e] = a[p] - t * off, a[q] + t * off, 0.0
            a[f], a[g] = c * a[f] - s * a[g], s * a[f] + c * a[g]
            for k in range(3):
                v[k, p], v[k, q] = c * v[k, p] - s * v[k, q], s * v[k, p] + c * v[k, q]
