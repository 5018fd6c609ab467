"""The order of many Morton codes on all threads: split by their leading digit, then sorted bucket by bucket."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.morton import Codes, settled, sorted_rows
from dqreg.kernels.threads import over_chunks

# Bits of the leading digit at most, and codes for each of its values: a bucket of a surface, which fills a part of
# them, fits into a core's cache and is still worth sorting by itself.
DIGIT, EACH = 11, 1 << 11
# Codes that are split at once, and shares of the buckets that are sorted at once.
CHUNK, SHARES = 1 << 16, 256
# Bits of a digit within a bucket; codes up to which two of them put most in order, and three beyond.
INNER, FEW = 10, 1 << 21
BUCKETS, REST = 1 << INNER, np.uint64((1 << INNER) - 1)
Counts = NDArray[np.int64]


def split_sorted_rows(codes: Codes) -> tuple[IntArray, Codes]:
    """What `sorted_rows` returns, of many codes: O(n) on all threads, and in memory that stays near."""
    digit = min((len(codes) // EACH).bit_length(), DIGIT)
    shift, buckets = max(int(codes.max(initial=0)).bit_length() - digit, 0), 1 << digit
    counts = np.zeros((len(codes) // CHUNK + 1, buckets), dtype=np.int64)
    over_chunks(count_leading, len(codes), codes, shift, CHUNK, counts, chunk=CHUNK)
    # Where each range begins in each bucket: ranges in their order, so that equal codes keep theirs.
    ends = np.cumsum(counts.T).reshape(buckets, -1)
    places = np.ascontiguousarray((ends - counts.T).T)
    starts = np.append(ends[:, -1] - counts.sum(axis=0), len(codes))
    # In one piece: of several megabytes the system gives large pages, at a fraction of the time.
    keys, spare = np.zeros((2, len(codes)), dtype=np.uint64)
    rows = spare.view(np.int64)
    over_chunks(split_leading, len(codes), codes, shift, CHUNK, places, rows, keys, chunk=CHUNK)
    digits = 2 if len(codes) < FEW else 3
    over_chunks(sort_buckets, buckets, starts, rows, keys, shift, digits, chunk=max(buckets // SHARES, 1))
    return rows, keys


@compiled
def count_leading(first: int, last: int, codes: Codes, shift: int, chunk: int, counts: Counts) -> None:
    """Count the codes first to last by their leading digit, in the row of their range: a range has ``chunk`` codes."""
    row = first // chunk
    for i in range(first, last):
        counts[row, np.int64(codes[i] >> np.uint64(shift))] += 1


@compiled
def split_leading(
    first: int, last: int, codes: Codes, shift: int, chunk: int, places: Counts, rows: IntArray, keys: Codes
) -> None:
    """Write the codes first to last, and their rows, to the buckets of their leading digit, in their order."""
    row = first // chunk
    for i in range(first, last):
        bucket = np.int64(codes[i] >> np.uint64(shift))
        place = places[row, bucket]
        places[row, bucket] = place + 1
        rows[place], keys[place] = i, codes[i]


@compiled
def sort_buckets(first: int, last: int, starts: IntArray, rows: IntArray, keys: Codes, shift: int, digits: int) -> None:
    """Put the codes of buckets first to last, and their rows, in order: they differ below bit ``shift``. O(n).

    So many digits below it put points of a surface in order but for a few neighbours, which then change places.
    """
    most = np.int64(0)
    for b in range(first, last):
        most = max(most, starts[b + 1] - starts[b])
    spare_rows, spare_keys, counts = np.zeros(most, np.int64), np.zeros(most, np.uint64), np.zeros(BUCKETS, np.int64)
    for b in range(first, last):
        n = starts[b + 1] - starts[b]
        own, inner = rows[starts[b] : starts[b + 1]], keys[starts[b] : starts[b + 1]]
        other, outer = spare_rows[:n], spare_keys[:n]
        for digit in range(-digits, 0):
            lowest = np.uint64(max(shift + INNER * digit, 0))
            counts[:] = 0
            for i in range(n):
                counts[np.int64((inner[i] >> lowest) & REST)] += 1
            place = np.int64(0)
            for value in range(BUCKETS):
                held = counts[value]
                counts[value] = place
                place += held
            for i in range(n):
                bucket = np.int64((inner[i] >> lowest) & REST)
                place = counts[bucket]
                counts[bucket] = place + 1
                other[place], outer[place] = own[i], inner[i]
            own, other, inner, outer = other, own, outer, inner
        if digits % 2 == 1:
            for i in range(n):
                other[i], outer[i] = own[i], inner[i]
            own, inner = other, outer
        if not settled(own, inner):
            order, in_order = sorted_rows(inner)
            for i in range(n):
                spare_rows[i] = own[order[i]]
            for i in range(n):
                own[i], inner[i] = spare_rows[i], in_order[i]
