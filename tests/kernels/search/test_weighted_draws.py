from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.search.weighted_draws import drawn_rows


def drawn(totals: np.ndarray, numbers: np.ndarray, steps: int) -> np.ndarray:
    rows = np.zeros(len(numbers), dtype=np.int64)
    drawn_rows(totals, numbers, np.zeros(steps, dtype=np.int64), rows)
    return rows


@given(st.lists(st.sampled_from([0.0, 1e-9, 0.3, 1.0, 1e6]), min_size=1, max_size=40), st.integers(1, 50))
@settings(deadline=None)
def test_rows_are_those_of_a_binary_search(weights: list[float], steps: int) -> None:
    totals = np.cumsum(weights)
    if totals[-1] == 0.0:
        return
    numbers = np.concatenate([np.random.default_rng(0).random(50) * totals[-1], totals[totals < totals[-1]]])
    expected = np.searchsorted(totals, numbers, side="right")
    np.testing.assert_array_equal(drawn(totals, numbers, steps), np.minimum(expected, len(totals) - 1))


def test_rows_are_drawn_as_often_as_they_weigh() -> None:
    weights = np.array([1.0, 0.0, 3.0])
    rows = drawn(np.cumsum(weights), np.random.default_rng(1).random(20_000) * 4.0, 3)
    assert np.bincount(rows, minlength=3)[1] == 0
    assert np.mean(rows == 2) == pytest.approx(0.75, abs=0.02)
