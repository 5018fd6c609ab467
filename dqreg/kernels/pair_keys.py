"""Keys of pairs of oriented points: distance and angles in bins."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels


@inside_kernels
def bin_of(cosine: float, cosines: FloatArray) -> int:
    """Number of the falling cosines, bounds of bins of angles, that a cosine is no greater than."""
    found = 0
    for k in range(len(cosines)):
        found += cosine <= cosines[k]
    return found


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
    """Write the keys of pairs (i, j), first to last: of length and angles without signs; -1 where one is not usable.

    Limits are the shortest and the longest length and the greatest cosine, of which one direction has to stay below.
    With seven cosines a key is a bin of lengths times 512. O(1) a pair.
    """
    for m in range(first, last):
        a, b = i[m], j[m]
        x, y, z = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        length = np.sqrt(x * x + y * y + z * z)
        keys[m] = -1
        if not limits[0] < length < limits[1]:
            continue
        p, q, s = directions[a, 0], directions[a, 1], directions[a, 2]
        u, v, w = directions[b, 0], directions[b, 1], directions[b, 2]
        one, other = abs(p * x + q * y + s * z) / length, abs(u * x + v * y + w * z) / length
        if not min(one, other) < limits[2]:
            continue
        angles = bin_of(one, cosines) * 64 + bin_of(other, cosines) * 8 + bin_of(abs(p * u + q * v + s * w), cosines)
        keys[m] = int(length / bin_length) * 512 + angles
