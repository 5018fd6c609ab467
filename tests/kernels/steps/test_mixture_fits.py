"""EM in one kernel against the same in arrays, and its exponentials against NumPy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.steps.mixture_fits import BLOCK, exponentials
from dqreg.solvers.robust import HALF_NORMAL, LEAST_FRACTION, SETTLED_SHARE, InlierMixture


def fitted(mixture: InlierMixture, distances: np.ndarray, floor: float, rounds: int) -> tuple[float, float]:
    """Scale and inlier fraction after rounds of EM, in arrays."""
    scale, fraction, squares = mixture.scale, mixture.inlier_fraction, distances**2
    for _ in range(rounds):
        inlier = np.exp(-0.5 * squares / scale**2)
        weights = inlier / (inlier + (1.0 - fraction) / mixture.limit * scale * HALF_NORMAL / fraction)
        total, before = weights.sum(), (scale, fraction)
        if total == 0.0:
            break
        scale = max(math.sqrt(weights @ squares / total), floor)
        fraction = min(max(total / len(distances), LEAST_FRACTION), 1.0 - LEAST_FRACTION)
        if np.allclose((scale, fraction), before, rtol=SETTLED_SHARE, atol=0.0):
            break
    return scale, fraction


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 2 * BLOCK + 9), st.floats(0.0, 1.0), st.integers(1, 30))
def test_rounds_of_em_are_those_of_arrays(seed: int, count: int, share: float, rounds: int) -> None:
    rng = np.random.default_rng(seed)
    inliers = np.abs(rng.normal(size=count))
    distances = np.where(rng.uniform(size=count) < share, inliers, rng.uniform(0.0, 40.0, size=count))
    mixture = InlierMixture(10.0 ** rng.uniform(-1.0, 1.0), 0.5, 40.0)
    found = mixture.fit(distances, floor=0.05, rounds=rounds)
    expected = fitted(mixture, distances, 0.05, rounds)
    np.testing.assert_allclose((found.scale, found.inlier_fraction), expected, rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 300])
def test_exponentials_are_good_to_two_units_in_the_last_place(count: int) -> None:
    values = -np.geomspace(1e-12, 707.0, 300)[:count]
    steps, found = np.zeros((2, count))
    exponentials.py_func(values, count, steps, found)
    np.testing.assert_array_max_ulp(found, np.exp(values), maxulp=2)


def test_exponentials_of_zero_and_of_what_is_far_below_are_one_and_none() -> None:
    values, steps, found = np.array([0.0, -0.0, -709.0, -1e300, -np.inf]), np.zeros(5), np.zeros(5)
    exponentials.py_func(values, 5, steps, found)
    assert found.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
