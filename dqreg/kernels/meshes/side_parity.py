"""Whether each side of some triangles is shared, without sorting them: every edge has a random number of its own.

The exclusive or of the numbers of all sides is that of the edges that an odd number of triangles has. It is zero where
there is none, and by chance once in 2^64. So is the sum where as many triangles run along every edge in each sense, and
that of numbers of the triangles where each has its like of the other sense.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.meshes.duplicate_triangles import MURMUR_FACTOR, MURMUR_FACTOR_2

Words = NDArray[np.uint64]


@inside_kernels
def scrambled(word: np.uint64) -> np.uint64:
    """A number each of whose bits depends on all of a word: the finaliser of MurmurHash3, which loses nothing."""
    word = (word ^ (word >> np.uint64(33))) * np.uint64(MURMUR_FACTOR)
    word = (word ^ (word >> np.uint64(33))) * np.uint64(MURMUR_FACTOR_2)
    return word ^ (word >> np.uint64(33))


@compiled
def number_nodes(first: int, last: int, vertices: FloatArray, spacing: float, numbers: Words) -> None:
    """Write a random number of the node that vertices first to last round to; of themselves where the spacing is 0."""
    place = np.zeros(1)
    words = place.view(np.uint64)
    for v in range(first, last):
        number = np.uint64(0)
        for k in range(3):
            value = vertices[v, k]
            # Minus zero is the same place as zero.
            place[0] = (np.rint(value / spacing) if spacing > 0.0 else value) + 0.0
            number = scrambled(number ^ words[0]) + np.uint64(k)
        numbers[v] = number


@compiled
def sums_of_sides(first: int, last: int, faces: IntArray, numbers: Words, chunk: int, sums: Words) -> None:
    """Write three sums of faces first to last to the row of their range, see above; of the first an exclusive or.

    A face two of whose corners are one node joins nothing. Shapes: faces (f, 3), numbers (v,), sums (., 3).
    """
    odd, uneven, single = np.uint64(0), np.uint64(0), np.uint64(0)
    for f in range(first, last):
        a, b, c = numbers[faces[f, 0]], numbers[faces[f, 1]], numbers[faces[f, 2]]
        if a != b and b != c and c != a:
            ab, bc, ca = scrambled(a + b), scrambled(b + c), scrambled(c + a)
            odd = odd ^ ab ^ bc ^ ca
            uneven = uneven + ab if a < b else uneven - ab
            uneven = uneven + bc if b < c else uneven - bc
            uneven = uneven + ca if c < a else uneven - ca
            face = scrambled(a + b + c)
            single = single + face if (a < b) ^ (b < c) ^ (c < a) else single - face
    sums[first // chunk, 0], sums[first // chunk, 1], sums[first // chunk, 2] = odd, uneven, single
