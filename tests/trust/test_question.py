from __future__ import annotations

import dataclasses
import math
import pickle
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.trust import Evidence, judge, limits
from dqreg.trust.deformation import BETWEEN_CLOUDS, ON_A_PART
from dqreg.trust.limits import RESIDUAL_NOISE_RATIO
from dqreg.trust.question import Question
from dqreg.trust.records import Alternative, Check
from dqreg.trust.strain import MIN_BEND, MIN_DRIFT_DIAGONALS, MIN_STRAIN
from dqreg.trust.verdict import QUESTIONS
from tests.trust.test_verdict import CAUSES, FREE, GOOD, HELD, ROTATION, SHIFT

NAN = float("nan")
# What the limits are, and what lies about them; where a figure may be missing.
FIGURES = st.sampled_from([NAN, 0.0, 5e-4, MIN_STRAIN, MIN_BEND, 1.0, 25.0, 1_000.0]) | st.floats(0.0, 2.0)
LIMITS = st.sampled_from(sorted({value for value in vars(limits).values() if isinstance(value, float)}))
CHANGES: dict[str, st.SearchStrategy[Any]] = {
    **{field.name: FIGURES | LIMITS for field in dataclasses.fields(Evidence) if field.type == "float"},
    "size": st.just(NAN) | st.floats(1e-3, 1e3),
    "mirror_gain": st.sampled_from([-math.inf, -0.3, 0.1, limits.MIRROR_GAIN]),
    "freed_gain": st.sampled_from([NAN, -0.1, 0.1, 0.3, limits.MIRROR_GAIN]),
    "sliding_loss": st.sampled_from([NAN, -0.4, 5.0, limits.CONSTRAINT_LOG_LIKELIHOOD, 100.0, math.inf]),
    "directions": st.permutations([HELD, HELD, HELD, FREE, ROTATION, SHIFT]).map(tuple),
    "carriers": st.just(()) | st.lists(st.sampled_from([NAN, 4.0, 20.0, 500.0]), min_size=6, max_size=6).map(tuple),
    "alternatives": st.lists(st.sampled_from(["", "a half-turn"])).map(
        lambda found: tuple(Alternative(np.eye(4), 0.1, symmetry) for symmetry in found)
    ),
    "search": st.sampled_from(["", "refined", "judged"]),
    "status": st.sampled_from(["converged", "stalled", "iteration limit"]),
    "clutter": st.sampled_from(["allowed", "none"]),
    **dict.fromkeys(("has_border", "is_scene", "is_detail", "carriers_of_both"), st.booleans()),
}
# Some of these at a time: where all are bad every question fails.
MADE = st.sets(st.sampled_from(sorted(CHANGES)), max_size=6).flatmap(
    lambda names: st.fixed_dictionaries({name: CHANGES[name] for name in sorted(names)})
)


def by_code(**changes: object) -> dict[str, Check]:
    return {check.code: check for check in judge(dataclasses.replace(GOOD, **changes)).checks}


def test_every_test_of_the_verdict_is_a_question_in_its_order() -> None:
    assert tuple(by_code()) == (*(question.code for question in QUESTIONS), "low_confidence")


@given(MADE)
@settings(max_examples=400)
def test_the_figure_shown_tells_the_verdict_whatever_the_evidence(changes: dict[str, Any]) -> None:
    verdict = judge(dataclasses.replace(GOOD, **changes))
    doubted = set(verdict.codes) if verdict.level == "suspect" else set()
    for check in verdict.checks:
        assert (check.passed is False) == (check.code in doubted), check
        if math.isfinite(check.value):
            within = check.value >= check.limit if check.relation == "at least" else check.value <= check.limit
            assert check.passed == within, check
        elif check.passed:
            # Yes or no: they have no figure.
            assert not check.unit, check
            assert not check.limit, check


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
    asked, check = [], Question.check
    monkeypatch.setattr(Question, "check", lambda self, evidence: asked.append(self) or check(self, evidence))
    verdict = judge(GOOD)
    copies = pickle.loads(pickle.dumps(verdict)), dataclasses.replace(verdict, level="suspect")
    assert len(asked) == len(QUESTIONS)  # To copy the fields reads them.
    assert verdict.checks is verdict.checks
    assert len(asked) == len(QUESTIONS)
    assert copies[1].checks is verdict.checks
    # What was not asked is NaN, which equals nothing.
    assert repr(copies[0].checks) == repr(verdict.checks)
    with pytest.raises(AttributeError):
        _ = verdict.chekcs
