"""Eigenvalues and axes of many symmetric 3 x 3 matrices at once: one in each column, so that processors do several."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import inside_kernels

# Matrices that are turned together: what is read and written for them stays near, and calls for fewer cost as much.
LANES = 256
# Rows of what they are given by and turned into: elements xx, yy, zz, xy, xz, yz, and three axes after each other.
ROWS, AXES = 15, 6
# Rounds of rotations: convergence is quadratic, and six reach the last bit of any matrix.
ROUNDS = 12


@inside_kernels
def diagonalise_lanes(count: int, lanes: FloatArray) -> None:
    """Turn the first matrices, (15, LANES), into their eigenvalues, in xx, yy, zz, and axes: the bits of `diagonalise`.

    Rotations that would add nothing are those by no angle, so that all matrices go the same way.
    """
    for k in range(ROWS - AXES):
        for i in range(count):
            lanes[AXES + k, i] = 1.0 if k % 4 == 0 else 0.0
    for _ in range(ROUNDS):
        if not _any_adds(count, lanes[0], lanes[1], lanes[2], lanes[3], lanes[4], lanes[5]):
            # What another round would come to.
            lanes[3:AXES, :count] = 0.0
            break
        xy, xz, yz = lanes[3], lanes[4], lanes[5]
        x = lanes[AXES], lanes[AXES + 1], lanes[AXES + 2]
        y = lanes[AXES + 3], lanes[AXES + 4], lanes[AXES + 5]
        z = lanes[AXES + 6], lanes[AXES + 7], lanes[AXES + 8]
        _rotate(count, lanes[0], lanes[1], xy, xz, yz, *x, *y)
        _rotate(count, lanes[0], lanes[2], xz, xy, yz, *x, *z)
        _rotate(count, lanes[1], lanes[2], yz, xy, xz, *y, *z)


@inside_kernels
def _any_adds(
    count: int, xx: FloatArray, yy: FloatArray, zz: FloatArray, xy: FloatArray, xz: FloatArray, yz: FloatArray
) -> bool:
    """Whether an element off the diagonal of any matrix changes the sum of either of its two on it."""
    adds = False
    for i in range(count):
        p, q, o, a, b, c = abs(xx[i]), abs(yy[i]), abs(zz[i]), abs(xy[i]), abs(xz[i]), abs(yz[i])
        adds |= (p + a != p) | (q + a != q) | (p + b != p) | (o + b != o) | (q + c != q) | (o + c != o)
    return adds


@inside_kernels
def _rotate(
    count: int,
    p: FloatArray,
    q: FloatArray,
    pq: FloatArray,
    op: FloatArray,
    oq: FloatArray,
    p0: FloatArray,
    p1: FloatArray,
    p2: FloatArray,
    q0: FloatArray,
    q1: FloatArray,
    q2: FloatArray,
) -> None:
    """Rotate two axes so that the element off the diagonal between them is zero; o is the third axis."""
    for i in range(count):
        off = pq[i]
        adds = (abs(p[i]) + abs(off) != abs(p[i])) | (abs(q[i]) + abs(off) != abs(q[i]))
        h = 0.5 * (q[i] - p[i])
        r = np.sqrt(h * h + off * off)
        t = off / (h + (r if h >= 0.0 else -r))
        # So small beside the rest that their squares are none.
        t = 1.0 if r == 0.0 else t
        c = 1.0 / np.sqrt(1.0 + t * t)
        s = t * c
        t, c, s = t if adds else 0.0, c if adds else 1.0, s if adds else 0.0
        p[i], q[i], pq[i] = p[i] - t * off, q[i] + t * off, 0.0
        op[i], oq[i] = c * op[i] - s * oq[i], s * op[i] + c * oq[i]
        p0[i], q0[i] = c * p0[i] - s * q0[i], s * p0[i] + c * q0[i]
        p1[i], q1[i] = c * p1[i] - s * q1[i], s * p1[i] + c * q1[i]
        p2[i], q2[i] = c * p2[i] - s * q2[i], s * p2[i] + c * q2[i]
