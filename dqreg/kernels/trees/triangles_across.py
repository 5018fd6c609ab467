"""Which triangle lies across each side of each, by the bits of their corners: where a search may walk to."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.meshes.duplicate_triangles import MURMUR_FACTOR, MURMUR_FACTOR_2, HashWords
from dqreg.kernels.trees.triangle import closest_on, height_square

# Steps of a walk: from 6 on they save no more on parts, but for one above a face that is a fan of needles. There the
# query lies beside the triangle, and as many more steps are taken, and again; of queries on a bracket of 7,600 needles
# it saves a fifth.
STEPS_PER_ROUND, MAX_ROUNDS = 8, 12
# Square of the distance beside the triangle, in squares of the height above it.
BESIDE_HEIGHTS = 9.0


@compiled
def triangles_across(words: HashWords, faces: IntArray, across: IntArray) -> None:
    """Write the slot of the triangle across each side of each slot, (n, 3), below zero where there is none.

    Sides run from a corner to the next. Sides are one where their corners have the same bits: what is found is a place
    to begin with, and no topology. Of more than two, each meets the first. O(n). Shapes: words (m, 3, 3), the bits of
    the corners, faces (n,).
    """
    size, shift = 8, np.uint64(32)
    while size < 6 * len(faces):
        size *= 2
    # Sides of the table count from one: zero is empty.
    keys, sides, hashes = np.zeros(size, np.uint64), np.zeros(size, np.int64), np.zeros(3, np.uint64)
    for t in range(len(faces)):
        for k in range(3):
            mixed = np.uint64(0)
            for axis in range(3):
                mixed = (mixed ^ words[faces[t], k, axis]) * np.uint64(MURMUR_FACTOR)
                mixed ^= mixed >> shift
            hashes[k] = mixed * np.uint64(MURMUR_FACTOR_2)
        for k in range(3):
            # A sum, so that the sense in which a side runs does not matter.
            key = hashes[k] + hashes[(k + 1) % 3]
            place = np.int64((key ^ (key >> shift)) & np.uint64(size - 1))
            while sides[place] > 0 and keys[place] != key:
                place = (place + 1) & (size - 1)
            other = sides[place] - 1
            across[t, k] = other // 3 if other >= 0 else other
            if other < 0:
                keys[place], sides[place] = key, 3 * t + k + 1
            elif across[other // 3, other % 3] < 0:
                across[other // 3, other % 3] = t


@inside_kernels
def walk_across(
    packed: FloatArray, across: IntArray, t: int, x: float, y: float, z: float
) -> tuple[int, float, float, float]:
    """The triangle to which a walk from t leads, across sides behind which it is nearer, and the place on it.

    As `closest_on`, whose corners a, b and c are the sides' first: no farther than t, and the closest where that is its
    neighbour on a face that goes on.
    """
    d, u, v = closest_on(packed, t, x, y, z)
    for step in range(STEPS_PER_ROUND * MAX_ROUNDS if len(across) > 0 else 0):
        if u > 0.0 and v > 0.0 and u + v < 1.0:
            break
        if step > 0 and step % STEPS_PER_ROUND == 0 and not d > BESIDE_HEIGHTS * height_square(packed, t, x, y, z):
            break
        # In a corner the place lies on two sides.
        one = 0 if v <= 0.0 else 2 if u <= 0.0 else 1
        two = 2 if one == 0 and u <= 0.0 else 1 if u + v >= 1.0 else one
        other = across[t, one]
        if other >= 0:
            d1, u1, v1 = closest_on(packed, other, x, y, z)
            if d1 < d:
                t, d, u, v = other, d1, u1, v1
                continue
        other = across[t, two]
        if two == one or other < 0:
            break
        d1, u1, v1 = closest_on(packed, other, x, y, z)
        if not d1 < d:
            break
        t, d, u, v = other, d1, u1, v1
    return t, d, u, v
