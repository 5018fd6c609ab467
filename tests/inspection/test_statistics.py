from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.inspection.membership.membership import by_reach
from dqreg.inspection.statistics import CHUNK_VALUES, summary_of


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 7, CHUNK_VALUES - 1, CHUNK_VALUES, 2 * CHUNK_VALUES + 3]))
def test_figures_are_those_of_numpy_and_values_stay_unless_they_may_be_written_over(seed: int, count: int) -> None:
    values = np.random.default_rng(seed).normal(size=count)
    kept, sizes = values.copy(), np.abs(values)
    found = summary_of(values, count + 2, tolerance=0.7)
    np.testing.assert_array_equal(values, kept)
    assert found == summary_of(values.copy(), count + 2, tolerance=0.7, overwrite_input=True)
    # A sum in pieces errs by less than the square root of its length in units of the last place.
    np.testing.assert_allclose(found.rms, np.sqrt(np.mean(values**2)), rtol=1e-13)
    assert (found.mean, found.max) == (values.mean(), sizes.max())
    assert [found.p50, found.p95, found.p99] == np.quantile(sizes, [0.5, 0.95, 0.99]).tolist()
    assert found.share_within == np.mean(sizes <= 0.7)
    assert (found.count, found.beyond) == (count, 2)


def test_what_is_no_number_is_beyond_any_reach() -> None:
    values = np.array([np.nan, -np.inf, -2.0, -1.0, -0.0, 1.0, np.nextafter(1.0, 2.0), np.inf])
    assert by_reach(values, 1.0).tolist() == [1, 1, 1, 0, 0, 0, 1, 1]
    assert by_reach(values, np.inf).tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
