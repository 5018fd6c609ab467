"""Translations that planes hold too little to be followed: a step leaves them as they are."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import inside_kernels

# How much stiffer than all planes together what is held is.
STIFF = 1e6
# Rounds of rotations in the three planes; two bring three axes to rounding.
ROUNDS = 6


@inside_kernels
def hold_free_shifts(A: FloatArray, at: int, limit: float) -> None:
    """Stiffen three rows of normal equations, of which the lower half is given, along axes of less information."""
    if not limit > 0.0:
        return
    a, b, c = A[at, at] - limit, A[at + 1, at + 1] - limit, A[at + 2, at + 2] - limit
    d, e, f = A[at + 1, at], A[at + 2, at], A[at + 2, at + 1]
    # By the pivots: all above the limit, as nearly always.
    if a > 0.0 and b - d * d / a > 0.0:
        g = f - d * e / a
        if c - e * e / a - g * g / (b - d * d / a) > 0.0:
            return
    M, axes = np.zeros((3, 3)), np.eye(3)
    M[0, 0], M[1, 1], M[2, 2] = a, b, c
    M[0, 1] = M[1, 0] = d
    M[0, 2] = M[2, 0] = e
    M[1, 2] = M[2, 1] = f
    _make_diagonal(M, axes)
    stiff = STIFF * (A[at, at] + A[at + 1, at + 1] + A[at + 2, at + 2])
    for k in range(3):
        if not M[k, k] > 0.0:
            for i in range(3):
                for j in range(i + 1):
                    A[at + i, at + j] += stiff * axes[i, k] * axes[j, k]


@inside_kernels
def _make_diagonal(M: FloatArray, axes: FloatArray) -> None:
    """Turn a symmetric matrix, (3, 3), into its axes, the columns of another: Jacobi's method."""
    for _ in range(ROUNDS):
        for i in range(2):
            for j in range(i + 1, 3):
                if M[i, j] == 0.0:
                    continue
                ratio = (M[j, j] - M[i, i]) / (2.0 * M[i, j])
                t = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
                x = 1.0 / math.sqrt(t * t + 1.0)
                y = t * x
                for k in range(3):
                    p, q = M[k, i], M[k, j]
                    M[k, i], M[k, j] = x * p - y * q, y * p + x * q
                for k in range(3):
                    p, q = M[i, k], M[j, k]
                    M[i, k], M[j, k] = x * p - y * q, y * p + x * q
                    p, q = axes[k, i], axes[k, j]
                    axes[k, i], axes[k, j] = x * p - y * q, y * p + x * q
