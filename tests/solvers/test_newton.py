from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.rigid import pose
from dqreg.solvers.newton import descend
from dqreg.solvers.quadratic import derivatives, split_derivatives
from tests.solvers.cost_cases import frames, mixed, numeric_slopes
from tests.solvers.free_chart import FreeChart
from tests.solvers.problems import fast


@pytest.mark.parametrize("pivot", [np.zeros(3), np.array([1.0, -2.0, 0.5])], ids=["origin", "pivot"])
def test_split_slopes_are_those_of_a_turn_and_a_shift_after_it(pivot: np.ndarray) -> None:
    form, T = mixed(0).cost.form, frames(4)
    y = form.coordinates(T)
    gradient, hessian, _ = split_derivatives(form, T[:3, :3], y, y[9:12] + form.origin_target - pivot)
    chart = FreeChart(T, pivot)
    numeric = numeric_slopes(lambda x: form.value(chart.moved(x).pose), 1e-3)
    size = np.abs(hessian).max()
    np.testing.assert_allclose(gradient, numeric[0], atol=1e-9 * size)
    np.testing.assert_allclose(hessian, numeric[1], atol=1e-5 * size)
    for ours, chart_ours in zip((gradient, hessian), chart.slopes(form), strict=False):
        np.testing.assert_allclose(ours, chart_ours, atol=1e-12 * size)


@fast
@given(st.integers(0, 500))
def test_newton_ends_level_and_says_so(seed: int) -> None:
    case = mixed(seed)
    form = case.cost.form
    start = FreeChart(case.truth @ pose.exp([0.2, 0.1, -0.3, 0.1, 0.2, 0.1]), form.origin_target)
    end = descend(form, start)
    gradient, hessian, _ = derivatives(form, end.chart.pose)
    assert end.converged
    assert end.value <= form.value(start.pose)
    assert np.abs(gradient).max() <= 1e-13 * np.abs(hessian).max()
    # The pose is still a rotation after all its steps.
    R = end.chart.pose[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert end.iterations <= 30


def test_a_level_hessian_does_not_throw_the_pose_away() -> None:
    # A quarter turn from the answer the curvature is exactly zero and the slope is largest.
    corners = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    from dqreg.solvers import PoseCost

    cost = PoseCost.points(corners, corners)
    start = pose.exp([0, 0, np.pi / 2, 0, 0, 0])
    end = descend(cost.form, FreeChart(start, cost.form.origin_target))
    np.testing.assert_allclose(end.chart.pose, np.eye(4), atol=1e-12)
    assert end.iterations <= 12
