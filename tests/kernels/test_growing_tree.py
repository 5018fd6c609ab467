from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.growing_tree import LEAF, GrowingTree
from dqreg.kernels.point_tree import PointTree


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(0, 400), min_size=1, max_size=6),
    st.integers(1, 20),
    st.sampled_from([1, 3, 1000]),
)
def test_a_tree_that_grew_answers_as_one_that_was_built(seed: int, sizes: list[int], count: int, places: int) -> None:
    rng, tree = np.random.default_rng(seed), GrowingTree()
    # Each time around another place: parts of the tree become too full. Of few places many are equally near.
    parts = [rng.integers(0, places, size=(size, 3)) / 3.0 + rng.integers(-5, 6, 3) for size in sizes]
    points, taken = np.vstack([*parts, np.full((7, 3), np.nan)]), 0
    for part in parts:
        taken += len(part)
        tree.grow(points, taken)
        if taken < count:
            continue
        known = points[:taken]
        queries = np.concatenate([known[:40], rng.uniform(-6, 6, size=(20, 3)), known[:1] + 1e3])
        for found, expected in zip(
            tree.tree.nearest(queries, count), PointTree.of(known).nearest(queries, count), strict=True
        ):
            np.testing.assert_array_equal(found, expected)


def test_each_point_stands_in_one_place_and_all_boxes_hold_theirs() -> None:
    rng, grown = np.random.default_rng(0), GrowingTree()
    points = np.cumsum(rng.normal(size=(5_000, 3)), axis=0)
    for taken in range(0, 5_001, 250):
        grown.grow(points, taken)
        tree, leaves = grown.tree, len(grown.tree.boxes) // 2
        held = np.isfinite(tree.places).all(axis=1)
        np.testing.assert_array_equal(np.sort(tree.rows[held]), np.arange(taken))
        np.testing.assert_array_equal(tree.places[held], points[tree.rows[held]])
        np.testing.assert_array_equal(tree.places[grown.standing], points[:taken])
        for node in range(1, 2 * leaves):
            height = leaves.bit_length() - node.bit_length()
            part = slice(((node << height) - leaves) * LEAF, (((node + 1) << height) - leaves) * LEAF)
            inside = tree.places[part][held[part]]
            if len(inside):
                np.testing.assert_array_equal(tree.boxes[node], [*inside.min(axis=0), *inside.max(axis=0)])
