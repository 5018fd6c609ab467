"""Exact duplicates of triangles, and of numbers, found by hashing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Multipliers of the finaliser of MurmurHash3: each bit of a word changes half of the hash.
MURMUR_FACTOR, MURMUR_FACTOR_2 = 0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53
HashWords = NDArray[np.uint64]


def first_duplicates(corners: FloatArray) -> IntArray:
    """First face with the same three corners as each face, in whatever order, (m,).

    Shapes: corners (m, 3, 3). O(m).
    """
    # Minus zero is the same place as zero.
    words = np.ascontiguousarray(corners + 0.0).view(np.uint64)
    first: IntArray = _first_duplicates(words)
    return first


@compiled
def _first_duplicates(words: HashWords) -> IntArray:
    n, size = len(words), 1
    while size < 2 * n:
        size *= 2
    # Rows of the table count from one: zero is empty.
    table, keys, first = np.zeros(size, np.int64), np.zeros(n, np.uint64), np.zeros(n, np.int64)
    for i in range(n):
        keys[i] = _key(words, i)
        place = np.int64(keys[i] & np.uint64(size - 1))
        while True:
            j = table[place] - 1
            if j < 0:
                table[place], j = i + 1, i
            if keys[j] == keys[i] and _same_corners(words, i, j):
                first[i] = j
                break
            place = (place + 1) & (size - 1)
    return first


@compiled
def first_equal(numbers: HashWords) -> IntArray:
    """First of some random numbers that is equal to each, (n,)."""
    n, size = len(numbers), 1
    while size < 2 * n:
        size *= 2
    table, first = np.zeros(size, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        place = np.int64(numbers[i] & np.uint64(size - 1))
        while table[place] and numbers[table[place] - 1] != numbers[i]:
            place = (place + 1) & (size - 1)
        if not table[place]:
            table[place] = i + 1
        first[i] = table[place] - 1
    return first


@inside_kernels
def _key(words: HashWords, i: int) -> np.uint64:
    # A sum over the corners, so that their order does not matter.
    total = np.uint64(0)
    for a in range(3):
        mixed = np.uint64(0)
        for k in range(3):
            mixed = (mixed ^ words[i, a, k]) * np.uint64(MURMUR_FACTOR)
            mixed = (mixed ^ (mixed >> np.uint64(33))) * np.uint64(MURMUR_FACTOR_2)
            mixed = mixed ^ (mixed >> np.uint64(33))
        total += mixed
    return total


@inside_kernels
def _same_corners(words: HashWords, i: int, j: int) -> bool:
    for a in range(3):
        found = False
        for b in range(3):
            same = words[i, a, 0] == words[j, b, 0] and words[i, a, 1] == words[j, b, 1]
            found = found or (same and words[i, a, 2] == words[j, b, 2])
        if not found:
            return False
    return True
