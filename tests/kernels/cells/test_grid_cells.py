"""Cells of points by a table of numbers, against those that sorting the points by their codes makes."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry.morton import cells_by_edge, corner_and_cells, morton_codes, sorted_codes
from dqreg.geometry.moved_points import UNMOVED
from dqreg.kernels.cells.cell_blocks import ALONG_X, ALONG_Y, ALONG_Z, cell_blocks, cells_around
from dqreg.kernels.cells.grid_cells import FIRST_SLOTS, cells_of_points
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.morton import BITS


def strewn(count: int) -> np.ndarray:
    """Points of a ball with a crowd in it, off the origin, and copies of one."""
    rng = np.random.default_rng(0)
    middle = np.array([1e3, -2e3, 5.0])
    points = rng.normal(size=(count, 3)) + middle
    points[::7] = 0.01 * points[::7] + middle
    points[::50] = points[0]
    return points


# Few cells, and more than the first table has room for.
@pytest.mark.parametrize(("count", "size"), [(1, 1.0), (5_000, 0.4), (60_000, 0.05)])
def test_cells_of_points_have_the_sums_of_points_in_the_order_of_codes(count: int, size: float) -> None:
    points = strewn(count)
    codes, counts, means, scatters = cells_of_points(points, UNMOVED, *corner_and_cells(points, size))
    order, keys = sorted_codes(morton_codes(points, size))
    starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    np.testing.assert_array_equal(codes, keys[starts])
    np.testing.assert_array_equal(counts, np.diff(np.r_[starts, count]))
    if count == 60_000:
        assert len(codes) > FIRST_SLOTS // 2
    # Summed in the order of rows, as offsets from the first: the same bits.
    offsets = points[order] - np.repeat(points[order[starts]], counts.astype(int), axis=0)
    for k, (first, last) in enumerate(zip(starts, np.r_[starts[1:], count], strict=True)):
        sums = np.zeros(3)
        for offset in offsets[first:last]:
            sums += offset
        np.testing.assert_array_equal(means[k], points[order[first]] + sums / counts[k])
        away = points[order[first:last]] - means[k]
        expected = (away.T @ away)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        np.testing.assert_allclose(scatters[k], expected, atol=1e-9 * size**2 * counts[k])


@pytest.mark.parametrize("finest", [0, 10])
def test_cells_of_each_edge_are_those_of_codes_without_bits(finest: int) -> None:
    points = strewn(3_000)
    codes = morton_codes(points)
    found = cells_by_edge(points, UNMOVED, (points.min(axis=0), points.max(axis=0)), finest)
    expected = [len(np.unique(codes >> np.uint64(3 * level))) for level in range(finest, BITS)]
    np.testing.assert_array_equal(found[: len(expected)], expected)


@compiled
def around(block: int, starts: np.ndarray, blocks: np.ndarray, table: np.ndarray, near: np.ndarray) -> int:
    return cells_around(block, starts, blocks, table, np.zeros(9, np.uint64), np.zeros(28, np.int64), near)


def along(codes: np.ndarray, mask: np.uint64) -> np.ndarray:
    bits = [(codes >> np.uint64(k)) & np.uint64(1) for k in range(64) if int(mask) >> k & 1]
    return np.asarray(sum(bit.astype(np.int64) << k for k, bit in enumerate(bits)))


def test_cells_around_a_block_are_those_of_blocks_that_differ_by_one_along_each_axis() -> None:
    points = strewn(20_000)
    codes, counts, _, scatters = cells_of_points(points, UNMOVED, *corner_and_cells(points, 0.2))
    starts, blocks, table, weights, weighted = cell_blocks(codes, counts, scatters, 8.0)
    np.testing.assert_array_equal(weights, np.minimum(counts, 8.0))
    np.testing.assert_allclose(weighted, scatters * (weights / counts)[:, None])
    places = np.stack([along(codes >> np.uint64(3), mask) for mask in (ALONG_X, ALONG_Y, ALONG_Z)], axis=1)
    near = np.zeros(27 * 8, np.int64)
    for block in range(0, len(blocks) - 1, 11):
        found = near[: around(block, starts, blocks, table, near)]
        expected = np.flatnonzero(np.abs(places - places[starts[block]]).max(axis=1) <= 1)
        np.testing.assert_array_equal(np.sort(found), expected)
