"""Morton codes, and the order that they sort points into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

Codes = NDArray[np.uint64]

# Bits of one coordinate's cell, and of a digit of the sort: six digits make up the 63 bits of a code.
BITS = 21
DIGIT, DIGITS = 11, 6
BUCKETS = 1 << DIGIT
# Places that a point may move on average where the lower half of its digits is put in order.
MOVES = 4
# Numbers of a digit with two zero bits between each two of theirs: a table costs half of what shifting takes.
SPREAD = np.sum([((np.arange(BUCKETS, dtype=np.uint64) >> k) & 1) << 3 * k for k in range(DIGIT)], axis=0)
REST = (1 << (BITS - DIGIT)) - 1


@compiled
def morton_cells(
    first: int, last: int, points: FloatArray, move: FloatArray, low: FloatArray, cells: float, codes: Codes
) -> None:
    """Write the codes of points first to last: cells of the edge ``1 / cells`` from the corner ``low`` on.

    Points are moved where they are read: scaled by the first number of a move, (4,), then shifted by the others.
    """
    for i in range(first, last):
        code = np.uint64(0)
        for k in range(3):
            cell = np.int64((move[0] * points[i, k] + move[1 + k] - low[k]) * cells)
            spread = SPREAD[cell & (BUCKETS - 1)] | (SPREAD[(cell >> DIGIT) & REST] << np.uint64(3 * DIGIT))
            code = (code << np.uint64(1)) | spread
        codes[i] = code


@compiled
def sorted_rows(codes: Codes) -> tuple[IntArray, Codes]:
    """Stable order of codes below 2^63, as of ``np.argsort``, and the codes in it: a radix sort, O(n).

    The upper half of the digits puts points of a surface in order but for a few neighbours, which then change places.
    """
    most = np.uint64(0)
    for i in range(len(codes)):
        most = max(most, codes[i])
    # In a loop: for a constant of its own each call would be compiled once more.
    for lowest in range(DIGITS // 2, -1, -(DIGITS // 2)):
        # Numbers of large cells are small: their upper half orders nothing.
        if lowest > 0 and most >> np.uint64(DIGIT * lowest) < np.uint64(len(codes)):
            continue
        rows, keys = _by_digits(codes, most, lowest)
        if lowest == 0 or settled(rows, keys):
            break
    return rows, keys


@inside_kernels
def _by_digits(codes: Codes, most: np.uint64, lowest: int) -> tuple[IntArray, Codes]:
    """Order of codes up to the largest by their digits from one on, and the codes in it."""
    n, rows = len(codes), np.arange(len(codes))
    # Half of the digits at a time: they and a row are one number, which moves in half the time of two.
    for first in range(lowest, DIGITS, DIGITS // 2):
        if most >> np.uint64(DIGIT * first) == np.uint64(0):
            break
        packed, bits = np.zeros(n, np.uint64), 0
        while n >> bits != 0:
            bits += 1
        for i in range(n):
            half = (codes[rows[i]] >> np.uint64(DIGIT * first)) & np.uint64((1 << DIGIT * (DIGITS // 2)) - 1)
            packed[i] = half << np.uint64(bits) | np.uint64(rows[i])
        packed = _sorted_above(packed, bits)
        for i in range(n):
            rows[i] = np.int64(packed[i] & np.uint64((1 << bits) - 1))
    keys = np.zeros(n, np.uint64)
    for i in range(n):
        keys[i] = codes[rows[i]]
    return rows, keys


@inside_kernels
def _sorted_above(numbers: Codes, bits: int) -> Codes:
    """Stable order of numbers by the digits above so many bits, which are written over."""
    n, other, counts = len(numbers), np.zeros(len(numbers), np.uint64), np.zeros(DIGITS // 2 * BUCKETS, np.int64)
    for i in range(n):
        for digit in range(DIGITS // 2):
            counts[BUCKETS * digit + _digit(numbers[i] >> np.uint64(bits), digit)] += 1
    for digit in range(DIGITS // 2):
        start = BUCKETS * digit
        # A digit that all share orders nothing.
        if n == 0 or counts[start + _digit(numbers[0] >> np.uint64(bits), digit)] == n:
            continue
        place = 0
        for b in range(start, start + BUCKETS):
            held = counts[b]
            counts[b] = place
            place += held
        for i in range(n):
            bucket = start + _digit(numbers[i] >> np.uint64(bits), digit)
            place = counts[bucket]
            counts[bucket] = place + 1
            other[place] = numbers[i]
        numbers, other = other, numbers
    return numbers


@inside_kernels
def _digit(key: np.uint64, digit: int) -> np.int64:
    return np.int64((key >> np.uint64(DIGIT * digit)) & np.uint64(BUCKETS - 1))


@inside_kernels
def settled(rows: IntArray, keys: Codes) -> bool:
    """Put keys in order by insertion, and say whether that was done: few may stand in the wrong order. O(n)."""
    # Insertion; given up where more than a few stand in the wrong order, as of points that crowd in one cell.
    left = MOVES * len(keys)
    for i in range(1, len(keys)):
        row, key, j = rows[i], keys[i], i
        while j > 0 and keys[j - 1] > key:
            rows[j], keys[j] = rows[j - 1], keys[j - 1]
            j -= 1
        rows[j], keys[j] = row, key
        left -= i - j
        if left < 0:
            return False
    return True


@compiled
def new_places(points: FloatArray, move: FloatArray, keys: Codes, order: IntArray) -> tuple[BoolArray, bool]:
    """Which points differ from the one before them in an order by codes, and whether two such share a cell. O(n).

    The keys are the codes in that order: they are walked along, not looked up. Points are moved as for these.
    """
    new, mixed = np.zeros(len(order), np.bool_), False
    for i in range(len(order)):
        new[i] = True
        if i == 0:
            continue
        if keys[i - 1] == keys[i]:
            a, b, same = order[i - 1], order[i], True
            for k in range(3):
                same = same and move[0] * points[a, k] + move[1 + k] == move[0] * points[b, k] + move[1 + k]
            new[i] = not same
            mixed = mixed or not same
    return new, mixed


@compiled
def take_points(
    first: int, last: int, points: FloatArray, move: FloatArray, order: IntArray, taken: FloatArray
) -> None:
    """Write points, (n, 3), after a move in an order of their rows, at places first to last. O(n)."""
    scale, x, y, z = move[0], move[1], move[2], move[3]
    # Unsigned: of a signed number each access asks whether it counts from the end.
    for i in range(np.uint64(first), np.uint64(last)):
        row = np.uint64(order[i])
        taken[i, 0] = scale * points[row, 0] + x
        taken[i, 1] = scale * points[row, 1] + y
        taken[i, 2] = scale * points[row, 2] + z


@compiled
def count_cells(codes: Codes) -> IntArray:
    """How many cells hold points, of codes in order, at each edge: the cells' own, twice that, and so on. O(n)."""
    filled = np.zeros(BITS + 1, np.int64)
    for i in range(1, len(codes)):
        apart = codes[i] ^ codes[i - 1]
        if apart != np.uint64(0):
            filled[_last_bit(apart) // 3] += 1
    # Points apart at one edge are apart at all shorter ones; one cell more than there are changes.
    for level in range(BITS - 1, -1, -1):
        filled[level] += filled[level + 1]
    for level in range(BITS + 1):
        filled[level] += 1
    return filled


@compiled
def filled_cells(points: FloatArray, move: FloatArray, low: FloatArray, cells: float, dropped: int) -> IntArray:
    """The same of points, whose codes are those of `morton_cells` without so many bits. O(n)."""
    codes, most = np.zeros(len(points), np.uint64), np.uint64(0)
    # Of the type that it has elsewhere: for a plain zero it would be compiled once more.
    first = int(np.int64(0))
    morton_cells(first, len(points), points, move, low, cells, codes)
    for i in range(len(codes)):
        codes[i] >>= np.uint64(dropped)
        most = max(most, codes[i])
    # Half of the digits at a time, the lower ones first; and of large cells there are no others.
    half = DIGIT * (DIGITS // 2)
    for bits in range(first, DIGIT * DIGITS, half):
        if most >> np.uint64(bits) != np.uint64(0):
            codes = _sorted_above(codes, bits)
    return count_cells(codes)


@inside_kernels
def _last_bit(number: np.uint64) -> int:
    last, step = 0, 32
    while step > 0:
        if number >> np.uint64(step) != np.uint64(0):
            number, last = number >> np.uint64(step), last + step
        step //= 2
    return last
