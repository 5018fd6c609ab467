from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.trees.kd_order import CHUNK_PLACES, kd_order

LEAF = 8


def require_cut(places: np.ndarray, first: int, leaves: int) -> None:
    """Both halves of a node lie on two sides of a plane across its widest side, and so do theirs."""
    low, high, middle = first * LEAF, (first + leaves) * LEAF, (first + leaves // 2) * LEAF
    if leaves == 1 or middle >= len(places):
        if leaves > 1:
            require_cut(places, first, leaves // 2)
        return
    axis = int(np.ptp(places[low:high], axis=0).argmax())
    assert places[low:middle, axis].max() <= places[middle:high, axis].min()
    require_cut(places, first, leaves // 2)
    require_cut(places, first + leaves // 2, leaves // 2)


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10_000), st.integers(1, 3_000), st.sampled_from([1, 2, 5, 40, 10**9]))
def test_each_node_is_cut_across_its_widest_side(seed: int, size: int, places: int) -> None:
    # Few places: many keys are equal, also the pivot and its neighbours.
    points = np.random.default_rng(seed).integers(0, places, (size, 3)) * [1.0, 0.5, 0.25]
    order, leaves = kd_order(points, LEAF), 1
    assert np.array_equal(np.sort(order), np.arange(size))
    while leaves * LEAF < size:
        leaves *= 2
    require_cut(points[order], 0, leaves)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_many_places_are_ordered_alike_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    points = np.random.default_rng(0).normal(size=(3 * CHUNK_PLACES + 5, 3)).round(2)
    monkeypatch.setattr("dqreg.kernels.threads.thread_count", lambda: threads)
    order = kd_order(points, LEAF)
    require_cut(points[order], 0, 8_192)
    monkeypatch.setattr("dqreg.kernels.trees.kd_order.CHUNK_PLACES", len(points))
    assert np.array_equal(order, kd_order(points, LEAF))
