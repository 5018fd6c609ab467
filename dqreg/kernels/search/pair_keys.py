"""Keys of pairs of oriented points: distance and angles in bins; all pairs in the order of their keys."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@inside_kernels
def bin_of(cosine: float, cosines: FloatArray) -> int:
    """Number of the falling cosines, bounds of bins of angles, that a cosine is no greater than."""
    found = 0
    for k in range(len(cosines)):
        found += cosine <= cosines[k]
    return found


@inside_kernels
def key_of(
    points: FloatArray,
    directions: FloatArray,
    a: int,
    b: int,
    bin_length: float,
    limits: FloatArray,
    cosines: FloatArray,
) -> int:
    """Key of a pair of rows, of length and angles without signs; -1 where it is not usable.

    Limits are the shortest and the longest length and the greatest cosine, of which one direction has to stay below.
    With seven cosines a key is a bin of lengths times 512.
    """
    x, y, z = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    length = np.sqrt(x * x + y * y + z * z)
    if not limits[0] < length < limits[1]:
        return -1
    p, q, s = directions[a, 0], directions[a, 1], directions[a, 2]
    u, v, w = directions[b, 0], directions[b, 1], directions[b, 2]
    one, other = abs(p * x + q * y + s * z) / length, abs(u * x + v * y + w * z) / length
    if not min(one, other) < limits[2]:
        return -1
    angles = bin_of(one, cosines) * 64 + bin_of(other, cosines) * 8 + bin_of(abs(p * u + q * v + s * w), cosines)
    return int(length / bin_length) * 512 + angles


@compiled
def pair_keys(
    first: int,
    last: int,
    points: FloatArray,
    directions: FloatArray,
    i: IntArray,
    j: IntArray,
    bin_length: float,
    limits: FloatArray,
    cosines: FloatArray,
    keys: IntArray,
) -> None:
    """Write the keys of pairs (i, j), first to last, see `key_of`. O(1) a pair."""
    for m in range(first, last):
        keys[m] = key_of(points, directions, i[m], j[m], bin_length, limits, cosines)


@compiled
def all_pair_keys(
    first: int,
    last: int,
    points: FloatArray,
    directions: FloatArray,
    bin_length: float,
    limits: FloatArray,
    cosines: FloatArray,
    keys: NDArray[np.int32],
) -> None:
    """Write the keys of rows first to last with those behind them, and of the same pairs the other way round.

    See `key_of`. O(n) a row. Shapes: keys (n, n), -1 on its diagonal.
    """
    for a in range(first, last):
        keys[a, a] = -1
        for b in range(a + 1, len(points)):
            key = key_of(points, directions, a, b, bin_length, limits, cosines)
            keys[a, b] = key
            # The angles of either end change places.
            keys[b, a] = key if key < 0 else (key & ~511) + (key & 7) + ((key & 56) << 3) + ((key & 448) >> 3)


@compiled
def key_starts(keys: NDArray[np.int32], starts: IntArray) -> None:
    """Write where each key begins in the order of all but those below zero, and how many those are. O(n^2).

    Shapes: keys (n, n), starts (k + 1,), zero.
    """
    for a in range(len(keys)):
        for b in range(len(keys)):
            if keys[a, b] >= 0:
                starts[keys[a, b] + 1] += 1
    for key in range(1, len(starts)):
        starts[key] += starts[key - 1]


@compiled
def order_of_keys(
    keys: NDArray[np.int32], starts: IntArray, rows: NDArray[np.int32], columns: NDArray[np.int32]
) -> None:
    """Write the row and column of all keys but those below zero, (n, n), in their order; equal ones row by row. O(n^2).

    Starts, (k + 1,), hold where those of each key begin, and become where they end.
    """
    for a in range(len(keys)):
        for b in range(len(keys)):
            key = keys[a, b]
            if key >= 0:
                rows[starts[key]], columns[starts[key]] = a, b
                starts[key] += 1
