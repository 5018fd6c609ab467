from __future__ import annotations

import itertools

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.geometry.moved_points import UNMOVED
from dqreg.kernels.order.morton import BITS, count_cells, morton_cells, new_places, sorted_rows
from dqreg.kernels.order.split_sort import sort_buckets, split_sorted_rows


@settings(deadline=None, max_examples=200)
@given(
    hnp.arrays(np.uint64, st.integers(0, 60), elements=st.integers(0, 2**63 - 1)), st.sampled_from([1, 2**11, 2**40])
)
def test_the_order_is_that_of_numpy(codes: np.ndarray, coarse: int) -> None:
    # Coarse ones are equal often: then the order of the rows counts.
    codes = codes // np.uint64(coarse) * np.uint64(coarse)
    before = codes.copy()
    rows, keys = sorted_rows(codes)
    np.testing.assert_array_equal(rows, np.argsort(codes, kind="stable"))
    np.testing.assert_array_equal(keys, codes[rows])
    np.testing.assert_array_equal(codes, before)


@pytest.mark.parametrize("count", [0, 1, 2, 65_536, 150_000])
@pytest.mark.parametrize("most", [1, 2_000, 2**40, 2**63 - 1])
def test_split_by_the_leading_digit_the_order_is_the_same(count: int, most: int) -> None:
    # Half of the codes are in one bucket, as where a stray point is far away, and many are equal.
    rng = np.random.default_rng(count)
    codes = rng.integers(0, most, count, dtype=np.uint64)
    codes[: count // 2] = rng.integers(0, min(most, 5_000), count // 2, dtype=np.uint64)
    rng.shuffle(codes)
    rows, keys = split_sorted_rows(codes)
    np.testing.assert_array_equal(rows, np.argsort(codes, kind="stable"))
    np.testing.assert_array_equal(keys, codes[rows])


@pytest.mark.parametrize("digits", [1, 2, 3])
@pytest.mark.parametrize("crowded", [False, True])
def test_buckets_are_put_in_order_by_any_number_of_digits(digits: int, crowded: bool) -> None:
    # Crowded codes share all digits that are asked about, and are too many for neighbours to change places.
    rng, shift = np.random.default_rng(digits), 60
    leading = np.sort(rng.integers(0, 8, 3_000)).astype(np.uint64) << np.uint64(shift)
    keys = leading | rng.integers(0, 2 ** (20 if crowded else shift), 3_000).astype(np.uint64)
    keys[::7] = keys[0] & np.uint64(2**shift - 1) | leading[::7]
    rows, expected = np.arange(3_000), np.argsort(keys, kind="stable")
    codes, starts = keys.copy(), np.searchsorted(leading, np.arange(9, dtype=np.uint64) << np.uint64(shift))
    for first, last in ((0, 5), (5, 8)):
        sort_buckets(first, last, starts, rows, keys, shift, digits)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(keys, codes[expected])


@pytest.mark.parametrize("upper", [1, 50, 40_000])
def test_many_codes_are_in_order_whether_few_or_many_share_their_upper_digits(upper: int) -> None:
    rng = np.random.default_rng(0)
    codes = (rng.integers(0, upper, 40_000) << 33 | rng.integers(0, 2**33, 40_000)).astype(np.uint64)
    rows, keys = sorted_rows(codes)
    np.testing.assert_array_equal(rows, np.argsort(codes, kind="stable"))
    np.testing.assert_array_equal(keys, codes[rows])


def plain_codes(points: FloatArray, low: FloatArray, cells: float) -> list[int]:
    """The same one bit at a time."""
    grid = ((points - low) * cells).astype(np.int64).tolist()
    return [
        sum((cell[axis] >> bit & 1) << (3 * bit + 2 - axis) for bit in range(BITS) for axis in range(3))
        for cell in grid
    ]


@pytest.mark.parametrize("cells", [0.0, 1.0, 1e5, (2**BITS - 1) / 20.0])
def test_codes_are_those_set_bit_by_bit(cells: float) -> None:
    points = np.random.default_rng(0).uniform(-10.0, 10.0, size=(300, 3))
    points[0], low, move = 10.0, np.full(3, -10.0), np.array([0.5, 1.0, 2.0, 3.0])
    codes = np.zeros(300, dtype=np.uint64)
    morton_cells(0, 150, points, move, low, cells, codes)
    morton_cells(150, 300, points, move, low, cells, codes)
    assert codes.tolist() == plain_codes(0.5 * points + move[1:], low, cells)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_new_is_what_differs_from_the_one_before(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 2, size=(count, 3)).astype(float)
    codes = rng.integers(0, 2, size=count).astype(np.uint64)
    order = np.argsort(codes, kind="stable")
    differ = [bool((points[a] != points[b]).any()) for a, b in itertools.pairwise(order)]
    shared = [bool(codes[a] == codes[b]) for a, b in itertools.pairwise(order)]
    new, mixed = new_places(points, UNMOVED, codes[order], order)
    assert new.tolist() == [True] + [d or not s for d, s in zip(differ, shared, strict=True)]
    assert mixed == any(d and s for d, s in zip(differ, shared, strict=True))


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 200), st.sampled_from([1, 2**10, 2**63 - 1]))
def test_cells_of_every_size_are_counted(seed: int, count: int, most: int) -> None:
    codes = np.sort(np.random.default_rng(seed).integers(0, most, count, dtype=np.uint64))
    expected = [len(np.unique(codes >> np.uint64(3 * level))) for level in range(BITS + 1)]
    assert count_cells(codes).tolist() == expected
