from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.area_order import LEVELS, SLABS, area_order
from dqreg.kernels.trees.area_order import cut as cut_inside


@compiled
def cut(
    spans: FloatArray,
    order: IntArray,
    first: int,
    last: int,
    slabs: FloatArray,
    beyond: FloatArray,
    nodes: FloatArray,
    node: int,
) -> int:
    return cut_inside(spans, order, first, last, slabs, beyond, nodes, node)


def tree_over(spans: FloatArray, leaf: int) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Boxes in their order, that order, and nodes and links that are used."""
    n = len(spans)
    rows, order = spans.copy(), np.zeros(n, dtype=np.int64)
    nodes, links = np.zeros((2 * n, 6)), np.zeros((2 * n, 3), dtype=np.int64)
    count = area_order(rows, leaf, order, nodes, links)
    return rows, order, nodes[:count], links[:count]


def boxes(rng: np.random.Generator, count: int, size: float) -> FloatArray:
    low = rng.normal(size=(count, 3))
    return np.hstack([low, low + size * rng.uniform(size=(count, 3))])


def depth_of(links: IntArray) -> int:
    """Levels below the first node, found from the parents down."""
    levels = np.zeros(len(links), dtype=int)
    for node, (child, rows, _) in enumerate(links):
        if rows == 0:
            levels[child] = levels[child + 1] = levels[node] + 1
    return int(levels.max())


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 90), st.sampled_from([0.0, 0.1, 3.0]), st.sampled_from([1, 2, 5]))
def test_every_node_is_the_box_of_its_rows_and_every_row_in_one_leaf(
    seed: int, count: int, size: float, leaf: int
) -> None:
    spans = boxes(np.random.default_rng(seed), count, size)
    rows, order, nodes, links = tree_over(spans, leaf)
    assert np.array_equal(rows, spans[order])
    held = [np.zeros(0, dtype=np.int64)] * len(links)
    for node in range(len(links) - 1, -1, -1):
        child, many, _ = links[node]
        assert many or (links[child : child + 2, 2] == node).all()
        assert many or child % 2
        held[node] = np.arange(child, child + many) if many else np.concatenate([held[child], held[child + 1]])
        assert 0 < many <= leaf or not many
        np.testing.assert_array_equal(nodes[node, :3], rows[held[node], :3].min(axis=0))
        np.testing.assert_array_equal(nodes[node, 3:], rows[held[node], 3:].max(axis=0))
    assert np.array_equal(np.sort(held[0]), np.arange(count))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.sampled_from([0.0, 0.5]))
def test_no_cut_between_slabs_is_cheaper(seed: int, count: int, size: float) -> None:
    # Oracle: each cut of each axis, by its own boxes.
    spans = boxes(np.random.default_rng(seed), count, size)
    costs = []
    for axis in range(3):
        middles = spans[:, axis] + spans[:, 3 + axis]
        slabs = min(SLABS, count)
        slab = ((middles - middles.min()) * (slabs * (1.0 - 1e-9) / np.ptp(middles))).astype(int)
        for place in range(1, slabs):
            sides = [spans[slab < place], spans[slab >= place]]
            if all(map(len, sides)):
                costs.append(sum(cost(side) for side in sides))
    order = np.arange(count)
    nodes = np.zeros((2, 6))
    middle = cut(spans, order, 0, count, *work_space(), nodes, 0)
    assert cost(spans[:middle]) + cost(spans[middle:]) == pytest.approx(min(costs), rel=1e-12)
    for node, side in zip(nodes, (spans[:middle], spans[middle:]), strict=True):
        np.testing.assert_array_equal(node, np.r_[side[:, :3].min(axis=0), side[:, 3:].max(axis=0)])


def cost(spans: FloatArray) -> float:
    x, y, z = spans[:, 3:].max(axis=0) - spans[:, :3].min(axis=0)
    return float(len(spans) * (x * y + y * z + z * x))


def work_space() -> tuple[FloatArray, FloatArray]:
    return np.zeros((3 * SLABS, 7)), np.zeros((SLABS + 1, 7))


def test_boxes_in_one_place_are_halved() -> None:
    *_, links = tree_over(np.tile([0.0, 0, 0, 1, 1, 1], (1_000, 1)), 1)
    assert depth_of(links) == 10
    flat = np.tile([0.0, 0, 0, 1, 1, 1], (5, 1))
    assert cut(flat, np.arange(5), 0, 5, *work_space(), np.zeros((2, 6)), 0) == -1


def test_boxes_that_shrink_without_end_make_no_endless_tree() -> None:
    # Each slab but the first holds next to nothing, at every level.
    places = np.outer(0.75 ** np.arange(2_000.0), np.ones(3))
    *_, links = tree_over(np.hstack([places, places]), 1)
    assert depth_of(links) <= LEVELS + 11
