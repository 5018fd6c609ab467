"""Ranks against NumPy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.selection import median_of, quantile_of, ranked

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


def test_numbers_in_order_and_copies_of_one_are_no_worst_case() -> None:
    reads = 0

    class Counted(np.ndarray):
        def __getitem__(self, key):
            nonlocal reads
            reads += 1
            return super().__getitem__(key)

    for values in (np.arange(2_000.0), np.arange(2_000.0)[::-1].copy(), np.ones(2_000)):
        reads = 0
        ranked.py_func(values.view(Counted), 1_000)
        assert reads < 20 * 2_000
