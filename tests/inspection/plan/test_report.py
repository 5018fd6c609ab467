"""What of a report a plan asks for."""

from __future__ import annotations

from typing import Any

import pytest

from dqreg.errors import InputError
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.plan.report import PARTS, VIEWS, PlannedReport
from dqreg.report.cameras import BEST
from dqreg.report.cameras import VIEWS as CAMERAS

CUT = {"name": "middle", "point": [0, 0, 0], "normal": [1, 0, 0]}


def asked(report: Any) -> PlannedReport:
    return plan_of({"tolerance": 0.1, "section": [CUT, {**CUT, "name": "end"}], "report": report}, "plan.toml").report


def test_without_a_choice_all_is_shown() -> None:
    assert asked({}) == plan_of({"tolerance": 0.1}).report == PlannedReport()
    assert PlannedReport().parts == PARTS
    assert PlannedReport().draws("middle")


def test_parts_stand_in_the_order_of_the_page_and_cuts_and_views_as_asked() -> None:
    chosen = asked({"parts": ["sections", "view"], "cuts": ["end"], "views": ["top", [35, -12.5]]})
    assert chosen == PlannedReport(("view", "sections"), ("end",), ("top", "35/-12.5"))
    assert (chosen.draws("end"), chosen.draws("middle")) == (True, False)


def test_views_have_the_names_of_the_cameras() -> None:
    assert set(VIEWS) == {BEST, *CAMERAS}


@pytest.mark.parametrize(
    ("report", "words"),
    [
        ({"part": ["view"]}, r"plan\.toml: report: 'part' is not known; did you mean parts"),
        ({"parts": ["deviation"]}, r"report: parts must be one of .*'deviation'; did you mean deviations"),
        ({"parts": "view"}, r"report: parts is a list of names; got 'view'"),
        ({"cuts": ["start"]}, r"report: cuts must be one of middle, end; got 'start'"),
        ({"cuts": ["end"], "parts": ["view"]}, r'report: cuts are given, but parts leave out "sections"'),
        ({"views": ["above"]}, r"report: views must be one of best, front"),
        ({"views": [["a", 1]]}, r"report: views must be a number; got 'a'"),
        (["view"], r"report must be a table"),
    ],
)
def test_a_wrong_choice_is_named(report: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        asked(report)
