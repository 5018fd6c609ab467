from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.steps.systematic_rows import systematic_rows


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.sampled_from([0.0, 0.3, 0.9]))
def test_rows_are_those_where_the_running_sum_passes_a_whole_number_and_a_half(
    seed: int, runs: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    left_out = rng.uniform(size=20 * runs) < share
    lengths = np.add.reduceat(~left_out, np.arange(0, 20 * runs, 20)).astype(np.int64)
    rates = rng.uniform(size=runs)
    passed = np.floor(np.cumsum(np.repeat(rates, lengths)) + 0.5)
    expected = np.flatnonzero(~left_out)[np.diff(passed, prepend=0.0) > 0.0]
    rows = np.zeros(20 * runs + 2, dtype=np.int64)
    assert rows[: systematic_rows(rates, lengths, left_out, rows)].tolist() == expected.tolist()
    if not share:
        none = np.zeros(0, dtype=bool)
        assert rows[: systematic_rows(rates, lengths, none, rows)].tolist() == expected.tolist()
