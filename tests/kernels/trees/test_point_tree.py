from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.kernels import threads
from dqreg.kernels.trees.point_tree import CHUNK_QUERIES, NO_PLACES, PointTree


def brute_force(points: np.ndarray, queries: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """All distances, sorted by distance and then by row."""
    x, y, z = np.moveaxis(points[None] - queries[:, None], 2, 0)
    squares = x * x + y * y + z * z
    rows = np.argsort(squares, axis=1, kind="stable")[:, :count]
    return rows, np.sqrt(np.take_along_axis(squares, rows, axis=1))


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.integers(1, 20), st.sampled_from([1, 3, 1000]))
def test_neighbours_are_those_of_brute_force(seed: int, size: int, count: int, places: int) -> None:
    rng = np.random.default_rng(seed)
    # Of few places many are equally near, and many points are in one.
    points = rng.integers(0, places, size=(size, 3)) / 3.0
    queries = np.concatenate([points[:40], rng.integers(-2, places + 2, size=(20, 3)) / 3.0, points[:1] + 1e3])
    count = min(count, size)
    rows, distances = PointTree.of(points).nearest(queries, count)
    expected, apart = brute_force(points, queries, count)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(distances, apart)
    # Any order of the points is a tree; in Morton order a good one. Any place of it is a bound to begin with.
    for at in (NO_PLACES, rng.integers(0, size, len(queries))):
        rows, distances = PointTree.of(points, in_order=True).nearest(queries, count, at=at)
        np.testing.assert_array_equal(rows, expected)
        np.testing.assert_array_equal(distances, apart)


@settings(deadline=None, max_examples=100)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 300),
    st.integers(1, 24),
    st.sampled_from([1, 3, 12, 1000]),
    st.floats(0.1, 1.0),
    st.booleans(),
)
def test_neighbours_of_its_own_points_are_those_of_brute_force(
    seed: int, size: int, count: int, places: int, share: float, in_order: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, places, size=(size, 3)) / 3.0
    points[: size // 2, 2] = 0.0
    asked = rng.permutation(size)[: max(int(share * size), 1)]
    count = min(count, size)
    rows, distances = PointTree.of(points, in_order=in_order).nearest_of(asked, count)
    known = rows[:, 0] >= 0
    expected, apart = brute_force(points, points[asked], count)
    np.testing.assert_array_equal(rows[known], expected[known])
    np.testing.assert_array_equal(distances[known], apart[known])
    # Where nothing is known, as of many copies of a point, the tree is asked as for any other.
    rows, distances = NeighbourTree(points, in_order=in_order).nearest_to(asked, count)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(distances, apart)


def test_nearly_all_points_of_a_surface_are_answered_leaf_by_leaf() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(size=(4_000, 2)), np.zeros(4_000)])
    points[3_000:] *= 0.05
    rows, _ = PointTree.of(points).nearest_of(np.arange(4_000), 16)
    assert np.count_nonzero(rows[:, 0] < 0) < 0.05 * len(points)


@pytest.mark.parametrize("in_order", [True, False])
def test_a_place_beside_a_query_changes_no_answer(in_order: bool) -> None:
    rng = np.random.default_rng(1)
    points, queries = rng.normal(size=(300, 3)), rng.normal(size=(50, 3))
    tree = NeighbourTree(points, in_order=in_order)
    for found, expected in zip(
        tree.nearest_beside(queries, rng.integers(300, size=50), 7), tree.nearest(queries, 7), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
    own = np.array([0, 4, 299])
    np.testing.assert_array_equal(tree.nearest_to(own, 1)[0][:, 0], own)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 100), st.floats(1e-3, 3.0))
def test_within_a_distance_the_nearer_ones_are_found_alone(seed: int, size: int, within: float) -> None:
    rng = np.random.default_rng(seed)
    points, queries = rng.normal(size=(size, 3)), rng.normal(size=(40, 3))
    rows, distances = PointTree.of(points).nearest(queries, min(3, size), within)
    expected, apart = brute_force(points, queries, min(3, size))
    near = apart < within * (1.0 - 1e-15)
    np.testing.assert_array_equal(rows[near], expected[near])
    np.testing.assert_array_equal(rows[apart > within * (1.0 + 1e-15)], size)
    np.testing.assert_allclose(distances, np.minimum(apart, within), rtol=1e-15)


def test_any_number_of_threads_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(3_000, 3)), rng.normal(size=(3 * CHUNK_QUERIES + 7, 3))
    tree, found = PointTree.of(points), []
    for count in (1, 2, 8):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        found.append(tree.nearest(queries, 5))
    for rows, distances in found[1:]:
        np.testing.assert_array_equal(rows, found[0][0])
        np.testing.assert_array_equal(distances, found[0][1])


def test_far_from_the_points_and_far_from_the_origin() -> None:
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(400, 3)) + 5e6, rng.normal(size=(50, 3)) * 1e4 + 5e6
    rows, distances = PointTree.of(points).nearest(queries, 3)
    expected, apart = brute_force(points, queries, 3)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(distances, apart)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.integers(1, 20), st.sampled_from([1, 3, 1000]), st.booleans())
def test_points_have_others_near_where_the_last_of_the_nearest_is_near(
    seed: int, size: int, count: int, places: int, in_order: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(places, 3))[rng.integers(0, places, size=size)]
    tree, within = PointTree.of(points, in_order=in_order), float(rng.uniform(0.0, 2.0))
    apart = brute_force(points, points, count)[1][:, -1]
    np.testing.assert_array_equal(tree.have_near(count, within), apart <= within)


def test_a_late_tree_answers_as_one_that_is_built_at_once() -> None:
    points = np.random.default_rng(5).normal(size=(3_000, 3))
    points = points[morton_order(points)]
    late, built = NeighbourTree(points, late=True), NeighbourTree(points)
    few, many = np.arange(0, 3_000, 31), np.arange(0, 3_000, 2)
    for rows in (few, many, few):
        for one, other in zip(late.nearest_to(rows, 9), built.nearest_to(rows, 9), strict=True):
            np.testing.assert_array_equal(one, other)
        for one, other in zip(late.nearest(points[rows] + 0.1, 4), built.nearest(points[rows] + 0.1, 4), strict=True):
            np.testing.assert_array_equal(one, other)
