"""Lists of the corners of triangles at each vertex, in the order of the triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import IntArray
from dqreg.kernels.compiling.compiled import compiled

Numbers = NDArray[np.int32]
Words = NDArray[np.uint64]


@compiled
def weld(numbers: Words, table: Numbers, welded: Numbers) -> None:
    """Write the first vertex with the same number as each, (v,). Shapes: table (a power of two above v,), zeros.

    O(v). The numbers are random, and spread over the table.
    """
    last = np.int64(len(table) - 1)
    for v in range(len(numbers)):
        place = np.int64(numbers[v] & np.uint64(last))
        while True:
            # Rows of the table count from one: zero is empty.
            other = table[place] - 1
            if other < 0:
                table[place], welded[v] = v + 1, v
                break
            if numbers[other] == numbers[v]:
                welded[v] = other
                break
            place = (place + 1) & last


@compiled
def list_corners(faces: IntArray, welded: Numbers, heads: Numbers, following: Numbers) -> None:
    """Write the first corner at each vertex and how many there are, (v, 2), and the one after each, (3 f,), or -1.

    Corner k of face f is 3 f + k. Heads are -1 and 0 beforehand. O(f).
    """
    for up in range(len(faces)):
        f = len(faces) - 1 - up
        for k in range(2, -1, -1):
            v = welded[faces[f, k]]
            following[3 * f + k] = heads[v, 0]
            heads[v, 0] = 3 * f + k
            heads[v, 1] += 1
