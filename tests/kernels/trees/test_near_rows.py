from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry.morton import morton_order
from dqreg.kernels.trees.near_rows import near_rows
from dqreg.kernels.trees.point_tree import LEAF_POINTS


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10_000),
    st.integers(0, 200),
    st.integers(0, 70),
    st.sampled_from([0.0, 0.03, 0.2, 1.0, 10.0, np.inf]),
)
def test_those_are_near_that_brute_force_finds(seed: int, count: int, others: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    points, cloud = rng.random((250, 3)), rng.random((80, 3)) * [1.0, 1.0, 0.1]
    # Some stand exactly where others do.
    points[::9] = cloud[: len(points[::9])]
    rows, theirs = (np.sort(rng.choice(n, k, replace=False)) for n, k in ((250, count), (80, others)))
    found = np.ones(count, dtype=bool)
    near_rows(points, rows, cloud, theirs, LEAF_POINTS, reach, found)
    apart = np.linalg.norm(points[rows][:, None] - cloud[theirs], axis=2)
    assert np.array_equal(found, (apart < reach).any(axis=1))


def test_what_is_exactly_as_far_as_the_reach_is_not_within_it() -> None:
    points, cloud, one = np.zeros((1, 3)), np.array([[3.0, 4.0, 0.0]]), np.zeros(1, dtype=np.int64)
    found = np.zeros(1, dtype=bool)
    near_rows(points, one, cloud, one, LEAF_POINTS, 5.0, found)
    assert not found[0]
    near_rows(points, one, cloud, one, LEAF_POINTS, np.nextafter(5.0, 6.0), found)
    assert found[0]


def test_points_in_any_order_are_found_too() -> None:
    rng = np.random.default_rng(1)
    points, cloud = rng.random((300, 3)), rng.random((200, 3))
    for order in (np.arange(200), morton_order(cloud)):
        found = np.zeros(300, dtype=bool)
        near_rows(points, np.arange(300), cloud, order, LEAF_POINTS, 0.08, found)
        apart = np.linalg.norm(points[:, None] - cloud, axis=2)
        assert np.array_equal(found, (apart < 0.08).any(axis=1))
