"""Eigenvalues and axes of small symmetric matrices, by Jacobi's rotations."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled

# Rounds over all pairs of axes: convergence is quadratic, and ten are more than any matrix of this size needs.
ROUNDS = 20


@compiled
def symmetric_axes(a: FloatArray, v: FloatArray, n: int) -> None:
    """Turn the first n rows and columns of a matrix into its eigenvalues, on the diagonal, and v into their axes.

    Unsorted, one axis a column; small eigenvalues of a graded matrix keep their digits. O(n^3).
    """
    for p in range(n):
        for q in range(n):
            v[p, q] = 1.0 if p == q else 0.0
    for _ in range(ROUNDS):
        still = True
        for p in range(n - 1):
            for q in range(p + 1, n):
                off = a[p, q]
                # What changes neither of the two is zero.
                if abs(a[p, p]) + abs(off) == abs(a[p, p]) and abs(a[q, q]) + abs(off) == abs(a[q, q]):
                    a[p, q] = a[q, p] = 0.0
                    continue
                still = False
                h = 0.5 * (a[q, q] - a[p, p])
                root = np.sqrt(h * h + off * off)
                t = off / (h + root) if h >= 0.0 else off / (h - root)
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                a[p, p], a[q, q] = a[p, p] - t * off, a[q, q] + t * off
                a[p, q] = a[q, p] = 0.0
                for k in range(n):
                    if k not in (p, q):
                        one, two = a[k, p], a[k, q]
                        a[k, p] = a[p, k] = c * one - s * two
                        a[k, q] = a[q, k] = s * one + c * two
                    one, two = v[k, p], v[k, q]
                    v[k, p], v[k, q] = c * one - s * two, s * one + c * two
        if still:
            return
