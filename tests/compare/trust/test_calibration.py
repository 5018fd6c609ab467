from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.compare.trust import calibration
from dqreg.compare.trust.calibration import (
    as_code,
    calibration_of,
    cross_validated,
    fit_confidence,
    rescale_confidence,
)
from dqreg.compare.trust.output import reliability_plot
from dqreg.compare.trust.trial import Trial
from dqreg.errors import InputError
from dqreg.trust.confidence import NAMES


def drawn(count: int) -> tuple[list[Trial], np.ndarray]:
    """Trials whose poses are right with a probability that follows from two of the figures."""
    rng = np.random.default_rng(0)
    figures = rng.normal(size=(count, len(NAMES)))
    p = 1.0 / (1.0 + np.exp(-(0.5 - 1.5 * figures[:, 0] + figures[:, 3])))
    right = rng.uniform(size=count) < p
    return [
        Trial("tree", seed, False, "suspect", bool(r), 0.0, (), "", 100, 1.0, float(q), tuple(map(float, row)))
        for seed, (r, q, row) in enumerate(zip(right, p, figures, strict=True))
    ], p


def test_a_true_probability_is_calibrated_and_a_sharper_one_is_not():
    trials, _ = drawn(4000)
    found = calibration_of(trials)
    # Twice what chance gives on average is beyond three of its standard deviations with ten bins.
    assert found.error < 2.0 * found.expected_by_chance < 0.04
    assert sum(one.trials for one in found.bins) == found.trials == 4000
    sure = calibration_of([dataclasses.replace(one, confidence=float(one.confidence > 0.5)) for one in trials])
    assert sure.error > 0.1
    assert reliability_plot(found).as_file()[:4] == b"\x89PNG"


def test_the_fit_finds_the_weights_that_made_the_trials():
    trials, p = drawn(4000)
    offset, weights = fit_confidence(trials)
    # Standard errors are about 1 / sqrt(4000 * 0.18) = 0.04.
    assert offset == pytest.approx(0.5, abs=0.15)
    assert weights[NAMES[0]] == pytest.approx(-1.5, abs=0.15)
    assert weights[NAMES[3]] == pytest.approx(1.0, abs=0.15)
    assert max(abs(weights[name]) for name in NAMES if name not in (NAMES[0], NAMES[3])) < 0.15
    assert as_code(offset, weights).count("\n") == len(NAMES) + 3
    assert len(p) == 4000


def test_a_map_that_favours_poses_and_condemns_doubted_ones_is_shifted_back(monkeypatch):
    # The trials' own map, shifted: two numbers bring it back, on seeds that were not seen too.
    trials, p = drawn(2000)
    weights = dict.fromkeys(NAMES, 0.0) | {NAMES[0]: -4.0, NAMES[3]: 1.0}
    monkeypatch.setattr(calibration, "WEIGHTS", weights)
    monkeypatch.setattr(calibration, "OFFSET", 3.0)
    offset, found = rescale_confidence(trials)
    assert offset == pytest.approx(0.5, abs=0.15)
    assert found == weights | {NAMES[0]: pytest.approx(-1.5, abs=0.15)}
    in_five = [dataclasses.replace(one, seed=one.seed % 5) for one in trials]
    assert cross_validated(in_five, rescale_confidence).error < 0.05
    as_it_was = cross_validated(in_five, lambda _: (3.0, weights))
    assert as_it_was.error > 0.1
    assert as_it_was.trials == len(p)


def test_poses_that_were_all_right_are_not_certain_for_that():
    found = rescale_confidence([dataclasses.replace(one, right=True) for one in drawn(200)[0]])
    assert np.isfinite([found[0], *found[1].values()]).all()


def test_no_figure_speaks_for_a_pose_that_can_only_speak_against_it():
    turned = [dataclasses.replace(one, right=not one.right) for one in drawn(4000)[0]]
    weights = fit_confidence(turned)[1]
    assert weights[NAMES[0]] == weights[NAMES[3]] == 0.0


def test_few_trials_are_not_fitted():
    with pytest.raises(InputError, match="tasks are needed"):
        fit_confidence(drawn(20)[0])
