from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from dqreg.papers.directions import SIGMA_RATIOS, directions_section, measure_directions
from dqreg.papers.simulation import SetUp
from dqreg.papers.trials import choose_directions, tilt
from dqreg.papers.weights import WEIGHINGS, measure_weights, weights_section

# Standard errors beyond which a difference is not chance; about a hundred of them are looked at.
SURE = 4.0


@pytest.fixture(scope="module")
def losses():
    return measure_weights(np.random.default_rng(2), choices=5, trials=200)


@pytest.fixture(scope="module")
def gains():
    return measure_directions(np.random.default_rng(4), choices=5, trials=100)


def test_likelihood_reaches_the_bound(losses):
    for loss in losses:
        if loss.weighing == "likelihood":
            for found in (loss.turn, loss.shift):
                assert abs(found.value - 1.0) < SURE * found.error


def test_nothing_beats_the_bound(losses):
    for loss in losses:
        assert loss.turn.value > 1.0 - SURE * loss.turn.error
        assert loss.shift.value > 1.0 - SURE * loss.shift.error
        assert min(loss.predicted_turn, loss.predicted_shift) > 1.0 - 1e-3


def test_simulation_agrees_with_first_order_theory(losses):
    # Second-order terms: weights far off leave rotations of degrees, whose square is a per mille of one.
    for loss in losses:
        assert abs(loss.turn.value - loss.predicted_turn) < SURE * loss.turn.error + 0.01 * loss.predicted_turn


def test_every_fixed_weight_loses_somewhere(losses):
    worst = {name: max(loss.turn.value for loss in losses if loss.weighing == name) for name in WEIGHINGS}
    assert worst.pop("likelihood") < 1.1
    assert worst.pop("sigma_n taken twice too large") < 1.4
    assert all(loss > 5.0 for loss in worst.values())


def test_likelihood_is_never_worse_than_equal_weights(gains):
    assert gains
    for gain in gains:
        for likely, equal in (
            (gain.likely.turn_deg, gain.equal.turn_deg),
            (gain.likely.shift, gain.equal.shift),
        ):
            assert likely.value <= equal.value + SURE * np.hypot(likely.error, equal.error) + 1e-9 * equal.value


def test_directions_help_more_the_more_there_are(gains):
    for points in (3, 5):
        for ratio in SIGMA_RATIOS:
            row = [g.likely.turn_deg for g in gains if g.points == points and g.ratio == ratio]
            assert len(row) == 5
            for few, many in pairwise(row):
                assert many.value < few.value + SURE * np.hypot(few.error, many.error)
            assert row[-1].value < row[0].value


def test_simulated_errors_lie_on_the_bound(gains):
    for gain in gains:
        assert abs(gain.likely.turn_deg.value - gain.bound[0]) < SURE * gain.likely.turn_deg.error
        assert abs(gain.likely.shift.value - gain.bound[1]) < SURE * gain.likely.shift.error


def test_free_poses_are_nan_and_not_an_identity():
    free = SetUp.draw(np.random.default_rng(0), (1, 1), 2, 5)
    found = free.simulate((0.5, 0.1), (1.0, 1.0))
    assert np.isnan(found.turn_deg.value)
    assert np.isnan(found.shift.value)


def test_tilt_has_the_asked_variance_both_ways():
    rng = np.random.default_rng(5)
    directions = choose_directions(rng, 1, 1)[0]
    tilted = tilt(directions, 0.01, rng.normal(size=(20_000, 3)))
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), 1.0, atol=1e-14)
    scatter = np.cov((tilted - directions).T)
    # 20,000 draws: a variance is good to 1 %.
    np.testing.assert_allclose(scatter, 1e-4 * (np.eye(3) - np.outer(directions, directions)), atol=4e-6)


def test_sections_show_every_number(losses, gains):
    weights = weights_section(losses)
    assert len(weights.tables[0].rows) * len(WEIGHINGS) == len(losses)
    directions = directions_section(gains)
    assert [len(table.rows) * len(SIGMA_RATIOS) for table in directions.tables] == [len(gains)] * 2
    assert len(directions.figures[0].panels) == 3
