from __future__ import annotations

import dataclasses
import math
import pickle

import pytest

from dqreg.trust import judge
from dqreg.trust import verdict as verdicts
from dqreg.trust.checks import QUESTIONS
from dqreg.trust.deformation import BETWEEN_CLOUDS, ON_A_PART
from dqreg.trust.doubts import DOUBTS
from dqreg.trust.limits import RESIDUAL_NOISE_RATIO
from dqreg.trust.records import Check
from dqreg.trust.strain import MIN_BEND, MIN_DRIFT_DIAGONALS, MIN_STRAIN
from tests.trust.test_verdict import CAUSES, GOOD


def by_code(**changes: object) -> dict[str, Check]:
    return {check.code: check for check in judge(dataclasses.replace(GOOD, **changes)).checks}


def test_every_test_of_the_verdict_is_a_question_in_its_order() -> None:
    assert tuple(QUESTIONS) == tuple(code for code, _ in DOUBTS)
    assert tuple(by_code()) == (*QUESTIONS, "low_confidence")


@pytest.mark.parametrize("cause", CAUSES)
def test_the_check_of_a_cause_is_the_one_that_fails_and_its_figure_is_beyond_the_limit(cause: str) -> None:
    changes, _, code = CAUSES[cause]
    checks = by_code(**changes)
    assert [name for name, check in checks.items() if check.passed is False] == [code]
    failed = checks[code]
    if math.isfinite(failed.value):
        assert failed.value < failed.limit if failed.relation == "at least" else failed.value > failed.limit


def test_what_passes_is_within_its_limit() -> None:
    for check in by_code(looked_through=0.01, mirror_gain=-0.3, random_ratio=0.05).values():
        assert check.passed is not False
        if math.isfinite(check.value):
            assert check.passed
            assert check.value >= check.limit if check.relation == "at least" else check.value <= check.limit


def test_a_figure_is_what_the_sentence_says_and_nan_where_it_was_not_asked() -> None:
    checks = by_code(width=0.02)
    assert checks["large_residuals"].value == pytest.approx(2.0)
    assert checks["large_residuals"].limit == RESIDUAL_NOISE_RATIO
    for code in ("looked_through", "mirrored", "clutter", "falling_inlier_fraction"):
        assert math.isnan(checks[code].value)
        assert checks[code].passed is None
    for code in ("search_time_limit", "not_converged"):
        assert checks[code].passed is True


def test_shares_have_the_unit_one() -> None:
    units = {code: check.unit for code, check in by_code().items()}
    assert units["low_inlier_fraction"] == units["low_confidence"] == units["stretched"] == "1"
    assert "%" not in units.values()


def test_figures_of_shape_have_the_limit_from_which_on_they_are_told() -> None:
    for changes in ({"size": 100.0}, {"size": 100.0, "faces_apart": 0.0}):
        checks = by_code(**changes)
        between_clouds = "faces_apart" in changes
        assert {code: checks[code].limit for code in ("stretched", "bent", "deformed", "drift")} == {
            "stretched": MIN_STRAIN,
            "bent": MIN_BEND,
            "deformed": BETWEEN_CLOUDS.few[1].shown if between_clouds else ON_A_PART.few[0].shown,
            "drift": MIN_DRIFT_DIAGONALS,
        }
        assert all(checks[code].passed for code in ("stretched", "bent", "deformed", "drift"))
    # The shift between two exposures has no least size.
    small = by_code(size=100.0, drift=0.1)["drift"]
    assert small.passed is False
    assert small.value > small.limit == 0.0


def test_nothing_found_has_no_checks_and_a_later_doubt_keeps_them() -> None:
    assert judge(dataclasses.replace(GOOD, found=False)).checks == ()
    verdict = judge(GOOD)
    assert verdict.doubted(verdict.reasons[0]).checks == verdict.checks


def test_the_questions_are_answered_once_they_are_read_and_go_along_with_a_copy(monkeypatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(verdicts, "checks_of", lambda evidence, against: asked.append(against) or ())
    verdict = judge(GOOD)
    copies = pickle.loads(pickle.dumps(verdict)), dataclasses.replace(verdict, level="suspect")
    assert asked == [frozenset()]  # To copy the fields reads them.
    assert len(verdict.checks) == 1
    assert verdict.checks is verdict.checks
    assert len(asked) == 1
    assert copies[1].checks is verdict.checks
    # What was not asked is NaN, which equals nothing.
    assert repr(copies[0].checks) == repr(verdict.checks)
    with pytest.raises(AttributeError):
        _ = verdict.chekcs
