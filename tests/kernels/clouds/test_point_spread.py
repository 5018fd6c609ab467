from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry.spacing import Spread
from dqreg.rigid import pose, twist


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.sampled_from([0.0, 1e4]))
def test_the_spread_of_points_is_that_of_numpy_and_tells_their_motion(seed: int, count: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    points = away + rng.normal(size=(count, 3)) * rng.uniform(0.1, 3.0, size=3)
    spread = Spread.of(points)
    np.testing.assert_allclose(spread.mean, points.mean(axis=0), rtol=1e-12, atol=1e-12)
    expected = np.atleast_2d(np.cov(points.T, bias=True)) if count > 1 else np.zeros((3, 3))
    np.testing.assert_allclose(spread.covariance, expected, rtol=1e-9, atol=1e-9)
    T_a, T_b = twist.exp(rng.normal(size=(2, 6)))
    moved = np.linalg.norm(pose.apply(T_b, points) - pose.apply(T_a, points), axis=1)
    assert spread.motion(T_a, T_b) == pytest.approx(np.sqrt(np.mean(moved**2)), rel=1e-9)
    assert spread.motion(T_a, T_a) == 0.0
