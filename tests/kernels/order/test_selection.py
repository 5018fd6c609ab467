"""Ranks against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.order.selection import median_of, quantile_of, ranked

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60)


@settings(deadline=None, max_examples=60)
@given(NUMBERS, st.floats(0.0, 1.0))
def test_ranks_are_those_of_sorted_numbers(values: list[float], share: float) -> None:
    moved, rank = np.array(values), int(share * (len(values) - 1))
    assert ranked(moved, rank) == np.sort(values)[rank]
    assert (moved[:rank] <= moved[rank]).all()
    assert (moved[rank:] >= moved[rank]).all()
    assert sorted(moved) == sorted(values)
    assert median_of(np.array(values)) == np.median(values)
    np.testing.assert_allclose(quantile_of(np.array(values), share), np.quantile(values, share), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("count", [7, 300, 5_000])
def test_numbers_in_order_and_copies_have_their_ranks(count: int) -> None:
    for values in (
        np.arange(float(count)),
        np.arange(float(count))[::-1].copy(),
        np.ones(count),
        np.arange(count) % 3.0,
    ):
        for rank in (0, count // 3, count - 1):
            assert ranked(values.copy(), rank) == np.sort(values)[rank]
