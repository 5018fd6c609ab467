from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dqreg.kernels.clouds.components import components


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(0, 60))
def test_components_are_those_of_scipy(seed: int, count: int, links: int) -> None:
    one, two = np.random.default_rng(seed).integers(0, count, (2, links))
    graph = coo_array((np.ones(links), (one, two)), shape=(count, count))
    np.testing.assert_array_equal(components(count, one, two), connected_components(graph, directed=False)[1])


def test_a_long_chain_in_any_order_is_one() -> None:
    order = np.random.default_rng(0).permutation(100_000)
    for rows in (np.arange(99_999), order[order < 99_999], np.arange(99_999)[::-1]):
        assert not components(100_000, np.ascontiguousarray(rows), rows + 1).any()
