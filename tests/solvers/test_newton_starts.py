from __future__ import annotations

import numpy as np
import pytest

from dqreg.solvers import Freedom
from dqreg.solvers.newton_starts import rotation_grid, starts
from tests.solvers.cost_cases import frames, mixed


@pytest.mark.parametrize("words", ["rz", "rx ry", "r", "rz tx", "rx ry tz", "rz tx ty", "all", "t"])
def test_starts_come_in_the_order_of_their_costs_each_with_its_best_shift(words: str) -> None:
    form = mixed(1, noise=0.2).cost.form
    charts, closed = starts(form, Freedom.only(*words.split(), frame=frames(2)), frames(3))
    assert not closed
    values = [form.value(chart.pose) for chart in charts]
    # The closed form of the linear part stands beside the grid, at its place in the order.
    assert values == sorted(values)
    for chart in charts:
        gradient, hessian, _ = chart.slopes(form)
        assert np.abs(gradient[chart.turns :]).max(initial=0.0) <= 1e-11 * np.abs(hessian).max()


@pytest.mark.parametrize(
    ("turns", "farthest_deg"),
    [((False, True, False), 2.0), ((True, False, True), 12.0), ((True, True, True), 25.0)],
)
def test_no_turn_is_far_from_the_grid(turns: tuple[bool, bool, bool], farthest_deg: float) -> None:
    grid = rotation_grid(turns)
    np.testing.assert_allclose(np.linalg.norm(grid, axis=1), 1.0, atol=1e-14)
    assert not grid[:, 1:][:, ~np.array(turns)].any()
    drawn = np.random.default_rng(0).normal(size=(2_000, 4)) * (1.0, *turns)
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    nearest = np.abs(drawn @ grid.T).max(axis=1)
    assert np.rad2deg(2.0 * np.arccos(nearest.clip(max=1.0))).max() <= farthest_deg
    np.testing.assert_allclose(grid[0], [1, 0, 0, 0], atol=1e-15)
