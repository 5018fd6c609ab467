"""Equal rows of numbers, found by hashing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.copies import mixed
from dqreg.kernels.threads import aside

Words = NDArray[np.uint64]


def numbered_rows(rows: FloatArray) -> tuple[IntArray, IntArray]:
    """Number of each row of three, (n,), by first appearance, and the row that each number appeared in first, (d,).

    Minus zero equals zero. O(n).
    """
    words = np.ascontiguousarray(rows + 0.0).view(np.uint64)
    numbers, firsts = np.zeros(len(rows), dtype=np.int64), np.zeros(len(rows), dtype=np.int64)
    count = aside(number_rows, words, numbers, firsts)
    return numbers, firsts[:count].copy()


@compiled
def number_rows(words: Words, numbers: IntArray, firsts: IntArray) -> int:
    """Write the number of each row, (n, 3), by first appearance, and the first row of each; returns how many. O(n)."""
    n, size, count = len(words), 1, 0
    while size < 2 * n:
        size *= 2
    # Numbers in the table count from one: zero is empty.
    table = np.zeros(size, np.int64)
    for i in range(n):
        key = mixed(mixed(mixed(np.uint64(0), words[i, 0]), words[i, 1]), words[i, 2])
        place = np.int64(key & np.uint64(size - 1))
        while True:
            number = table[place] - 1
            if number < 0:
                number, table[place], firsts[count] = count, count + 1, i
                count += 1
                break
            row = firsts[number]
            if words[row, 0] == words[i, 0] and words[row, 1] == words[i, 1] and words[row, 2] == words[i, 2]:
                break
            place = (place + 1) & (size - 1)
        numbers[i] = number
    return count
