"""Figures of the page's tables."""

from __future__ import annotations

import math
from types import SimpleNamespace

from dqreg.report.facts import checks_of
from dqreg.trust.records import Check, Verdict


def test_each_question_shows_its_figure_and_limit_or_that_it_was_not_asked() -> None:
    checks = (
        Check("low_inlier_fraction", "Inliers", 1.0, "at least", 0.7, "1", True),
        Check("mirrored", "Gain", math.nan, "at most", 0.015, "", None),
        Check("falling_inlier_fraction", "Fall", math.nan, "at least", math.nan, "%", True),
        Check("not_converged", "Converged", math.nan, "at most", 0.0, "", True),
        Check("deviating_patches", "Patches", 0.0413, "at most", 0.03, "%", False),
    )
    rows = checks_of(SimpleNamespace(verdict=Verdict("suspect", (), checks)))  # type: ignore[arg-type]
    shown = {row["code"]: (row["sign"], row["value"], row["limit"]) for row in rows}
    assert shown == {
        "low_inlier_fraction": ("✓", "100 %", "at least 70 %"),
        "mirrored": ("–", "not asked", "at most 0.015"),
        "falling_inlier_fraction": ("–", "not asked", ""),
        "not_converged": ("✓", "", ""),
        "deviating_patches": ("✗", "4.1 %", "at most 3 %"),
    }
