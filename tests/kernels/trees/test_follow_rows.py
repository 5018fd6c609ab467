"""The followed candidates against all points."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.kernels.trees.follow_rows import follow_in_tree, follow_rows, look_up_rows
from dqreg.kernels.trees.point_tree import PointTree


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(1, 6), st.floats(0.0, 0.5))
def test_a_candidate_within_the_bound_is_the_nearest_of_all(seed: int, k: int, way: float) -> None:
    rng = np.random.default_rng(seed)
    cloud, before = rng.normal(size=(50, 3)), rng.normal(size=(40, 3))
    away = np.linalg.norm(before[:, None] - cloud, axis=2)
    nearest = np.argsort(away, axis=1)[:, : k + 1]
    others = np.take_along_axis(away, nearest[:, k:], axis=1)[:, 0]
    step = rng.normal(size=(40, 3))
    points = before + way * step / np.linalg.norm(step, axis=1, keepdims=True)
    rows, distances, bounds = np.zeros(40, dtype=np.int64), np.zeros(40), np.zeros(40)
    follow_rows(0, 40, points, before, nearest[:, :k].astype(np.int32), others, cloud, 1.0, rows, distances, bounds)
    now = np.linalg.norm(points[:, None] - cloud, axis=2)
    np.testing.assert_allclose(distances, np.take_along_axis(now, nearest[:, :k], axis=1).min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(bounds, others - way, rtol=0, atol=1e-12)
    settled = distances < bounds
    np.testing.assert_array_equal(rows[settled], now.argmin(axis=1)[settled])


def test_of_two_candidates_that_are_as_near_none_is_taken() -> None:
    cloud = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    rows, distances, bounds = np.zeros(2, dtype=np.int64), np.zeros(2), np.zeros(2)
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    candidates, others = np.array([[0, 1], [0, 1]], dtype=np.int32), np.full(2, 5.0)
    follow_rows(0, 2, points, points, candidates, others, cloud, 1.0 - 1e-12, rows, distances, bounds)
    assert bounds[0] == 0.0
    assert (rows[1], bounds[1]) == (0, 5.0 * (1.0 - 1e-12))


def test_what_stands_at_rows_is_looked_up() -> None:
    rng = np.random.default_rng(0)
    cloud, all_normals, all_variances = rng.normal(size=(9, 3)), rng.normal(size=(9, 3)), rng.normal(size=9)
    order, rows = rng.permutation(9), np.array([3, 3, 8, 0])
    points, normals, variances, elements = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(4, dtype=np.int64)
    look_up_rows(1, 4, rows, cloud, all_normals, all_variances, order, points, normals, variances, elements)
    some = rows[1:]
    np.testing.assert_array_equal(points[1:], cloud[some])
    np.testing.assert_array_equal(normals[1:], all_normals[some])
    np.testing.assert_array_equal(variances[1:], all_variances[some])
    np.testing.assert_array_equal(elements[1:], order[some])
    assert not points[0].any()


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 4), st.floats(0.0, 3.0), st.booleans())
def test_the_tree_is_asked_where_no_candidate_is_sure(seed: int, k: int, way: float, look_up: bool) -> None:
    rng = np.random.default_rng(seed)
    cloud, before = rng.normal(size=(50, 3)), rng.normal(size=(40, 3))
    tree, points = PointTree.of(cloud), before + way * rng.normal(size=(40, 3))
    nearest, away = tree.nearest(before, k)
    normals, variances, order = rng.normal(size=(50, 3)), rng.uniform(size=50), rng.permutation(50)
    rows, distances, bounds = np.zeros(40, dtype=np.int64), np.zeros(40), np.zeros(40)
    found, (feet, there) = np.zeros((40, k), dtype=np.int32), np.zeros((2, 40 if look_up else 0, 3))
    spread, numbers = np.zeros(40), np.zeros(40, dtype=np.int64)
    given = points, before, nearest.astype(np.int32), away[:, -1].copy(), 1.0 - 1e-12
    held = tree.boxes, tree.places, tree.leaf, tree.rows, cloud, normals, variances, order
    follow_in_tree(0, 40, *given, *held, rows, distances, bounds, found, feet, there, spread, numbers)
    now = np.linalg.norm(points[:, None] - cloud, axis=2)
    np.testing.assert_array_equal(rows, now.argmin(axis=1))
    np.testing.assert_allclose(distances, now.min(axis=1), rtol=1e-12)
    # No point but the candidates is nearer than the bound, which is what the next motion is measured by.
    others = now.copy()
    np.put_along_axis(others, found.astype(np.int64), np.inf, axis=1)
    assert (others.min(axis=1) >= bounds - 1e-9).all()
    if look_up:
        np.testing.assert_array_equal(feet, cloud[rows])
        np.testing.assert_array_equal(there, normals[rows])
        np.testing.assert_array_equal(spread, variances[rows])
        np.testing.assert_array_equal(numbers, order[rows])


@pytest.mark.parametrize("k", [1, 4])
def test_without_candidates_the_tree_is_asked_about_every_query(k: int) -> None:
    rng = np.random.default_rng(k)
    cloud, points = rng.normal(size=(50, 3)), rng.normal(size=(40, 3))
    tree = PointTree.of(cloud)
    nearest, away = tree.nearest(points, k)
    rows, distances, bounds = np.zeros(40, dtype=np.int64), np.zeros(40), np.zeros(40)
    found, (feet, there) = np.zeros((40, k), dtype=np.int32), np.zeros((2, 40, 3))
    spread, numbers = np.zeros(40), np.zeros(40, dtype=np.int64)
    given = points, points, np.zeros((0, k), dtype=np.int32), bounds, 1.0 - 1e-12
    held = tree.boxes, tree.places, tree.leaf, tree.rows, cloud, cloud, np.zeros(50), np.arange(50)
    for first in (0, 25):
        # Ranges of rows are all that a thread sees.
        last = first + 25 if first == 0 else 40
        follow_in_tree(first, last, *given, *held, rows, distances, bounds, found, feet, there, spread, numbers)
    np.testing.assert_array_equal(found, nearest)
    np.testing.assert_array_equal(rows, nearest[:, 0])
    np.testing.assert_array_equal(distances, away[:, 0])
    np.testing.assert_array_equal(bounds, away[:, -1])
    np.testing.assert_array_equal(feet, cloud[nearest[:, 0]])
