from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.cells.voxel_rows import VoxelSums, first_of_voxels, measured_rows, one_of_voxels
from dqreg.kernels.maps.voxel_blocks import FACTOR_A


@pytest.mark.parametrize("count", [0, 1, 500, 20_000])
def test_the_first_row_of_each_voxel_is_found(count: int) -> None:
    # Oracle: distinct cells, by sorting. Many cells of either sign, with many points in some.
    points = np.random.default_rng(count).normal(size=(count, 3)) * [8.0, 5.0, 0.4]
    _, rows = np.unique(np.floor(points / 0.3), axis=0, return_index=True)
    np.testing.assert_array_equal(first_of_voxels(points, 0.3), np.sort(rows))


def test_it_leaves_what_kiss_icp_leaves() -> None:
    # Oracle: KISS-ICP's downsampling, in an order of its own.
    voxels = pytest.importorskip("kiss_icp.voxelization")
    points = np.random.default_rng(3).normal(size=(5000, 3)) * 4.0
    found, known = points[first_of_voxels(points, 0.5)], np.array(voxels.voxel_down_sample(points, 0.5))
    assert len(found) == len(known)
    np.testing.assert_array_equal(found[np.lexsort(found.T)], known[np.lexsort(known.T)])


@pytest.mark.parametrize("count", [0, 1, 500, 20_000])
def test_one_row_of_each_voxel_is_found(count: int) -> None:
    # Oracle: distinct cells, by sorting the mixed numbers of the rows. Cells of either sign, with many points in some.
    points = np.random.default_rng(count).normal(size=(count, 3)) * [8.0, 5.0, 0.4]
    mixed = np.argsort(np.arange(count, dtype=np.uint64) * FACTOR_A)
    _, rows = np.unique(np.floor(points[mixed] * (1.0 / 0.3)), axis=0, return_index=True)
    found = one_of_voxels(points, 0.3)
    np.testing.assert_array_equal(np.sort(found), np.sort(mixed[rows]))
    # Not the first one of most.
    assert count < 10_000 or np.mean(found == one_of_voxels(points[::-1], 0.3)) < 0.5


def test_means_of_some_voxels_are_those_of_all() -> None:
    rng = np.random.default_rng(7)
    points, times = rng.normal(size=(5_000, 3)) * [8.0, 5.0, 0.4], rng.uniform(-1, 0, 5_000)
    sums = VoxelSums.of(points, times, 0.7, 0.1)
    means, when = sums.means()
    rows = one_of_voxels(points, 2.0)
    some, seen = sums.means_at(points[rows])
    _, order = np.unique(np.floor(points * (1.0 / 0.7)), axis=0, return_inverse=True)
    _, first = np.unique(order.ravel(), return_index=True)
    which = np.searchsorted(np.sort(first), first)[order.ravel()[rows]]
    # Two of the places may lie in one.
    _, kept = np.unique(which, return_index=True)
    np.testing.assert_array_equal(some, means[which[np.sort(kept)]])
    np.testing.assert_array_equal(seen, when[which[np.sort(kept)]])


@pytest.mark.parametrize("count", [1, 500, 20_000])
def test_the_means_of_each_voxel_are_found(count: int) -> None:
    # Oracle: distinct cells, by sorting; in the order of their first points.
    rng = np.random.default_rng(count)
    points, times = rng.normal(size=(count, 3)) * [8.0, 5.0, 0.4], rng.uniform(-1, 0, count)
    _, rows, which = np.unique(np.floor(points / 0.3), axis=0, return_index=True, return_inverse=True)
    counts, which = np.bincount(which.ravel()), which.ravel()
    for given in (None, times):
        means, when = VoxelSums.of(points, given, 0.3, 2.0).means()
        for k, column in enumerate((*points.T, np.zeros(count) if given is None else given)):
            expected = (np.bincount(which, column) / counts)[np.argsort(rows)]
            np.testing.assert_allclose(means[:, k] if k < 3 else when, expected, atol=1e-12)


def test_what_is_seen_at_both_ends_of_a_sweep_is_not_mixed() -> None:
    points = np.array([[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.3, 0.3, 0.3]])
    means, when = VoxelSums.of(points, np.array([-1.0, -0.96, 0.0]), 1.0, 0.1).means()
    np.testing.assert_allclose(means, [[0.15, 0.15, 0.15]])
    np.testing.assert_allclose(when, [-0.98])


@pytest.mark.parametrize("wrong", [0.0, np.nan, np.inf, -np.inf, 1e9])
def test_what_is_no_measurement_is_neither_counted_nor_bounded(wrong: float) -> None:
    points = np.random.default_rng(0).normal(size=(200, 3))
    rows = np.arange(200) % 9 == 4
    points[rows, :: 1 if wrong == 0.0 else 2] = wrong
    # One coordinate of zero is a measurement.
    points[0, 1] = 0.0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    assert measured_rows(points, 1e6, low, high) == np.count_nonzero(~rows)
    np.testing.assert_array_equal(low, points[~rows].min(axis=0))
    np.testing.assert_array_equal(high, points[~rows].max(axis=0))
