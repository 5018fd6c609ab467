from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg.result import Alternative, Direction
from dqreg.trust import Evidence, judge
from dqreg.trust.verdict import FEW_INLIERS, FEWEST_INLIERS, ROUGH

NAN = float("nan")
HELD = Direction(0.1, 0.01, "held against a shift along (1.00, 0.00, 0.00)")
FREE = Direction(0.0, NAN, "free to shift along (0.00, 0.00, 1.00)")
GOOD = Evidence(
    status="converged",
    found=True,
    inliers=1_000.0,
    share_near=0.95,
    near=2.0,
    width=0.01,
    expected=0.01,
    spacing=1.0,
    to_cloud=False,
    max_distance=20.0,
    directions=(HELD,) * 6,
    alternatives=(),
)
# Each cause, and the one sentence that it brings.
CAUSES: dict[str, tuple[dict[str, Any], str]] = {
    "few points": ({"inliers": FEWEST_INLIERS - 1.0}, "only 29 points lie on the target"),
    "unknown points": ({"inliers": NAN}, "only nan points lie on the target"),
    "clutter": ({"share_near": FEW_INLIERS - 0.01}, "% of the points within 2 of the target"),
    "unknown share": ({"share_near": NAN}, "% of the points within 2 of the target"),
    "rough": ({"width": 1.1 * ROUGH * 0.01}, "shapes differ, or the pose is wrong"),
    "unknown width": ({"width": NAN}, "shapes differ, or the pose is wrong"),
    "rough to a cloud": ({"to_cloud": True, "width": 1.1 * ROUGH}, "shapes differ, or the pose is wrong"),
    "free": ({"directions": (FREE, *(HELD,) * 5)}, FREE.words),
    "ambiguous": ({"alternatives": (Alternative(np.eye(4), 0.1),)}, "1 other pose(s) explain the scan about as well"),
    "stopped": ({"status": "iteration limit"}, "the loop did not converge: iteration limit"),
}


def test_nothing_against_it_is_accepted_and_says_why() -> None:
    verdict = judge(GOOD)
    assert verdict.level == "accepted"
    assert verdict.reasons == (
        "1000 points lie on the target to 0.01 (one sigma), 95 % of those within 2 of it; all six motions are held",
    )


@pytest.mark.parametrize("cause", CAUSES)
def test_a_doubt_appears_with_its_cause_and_alone(cause: str) -> None:
    changes, sentence = CAUSES[cause]
    verdict = judge(dataclasses.replace(GOOD, **changes))
    assert verdict.level == "suspect"
    assert len(verdict.reasons) == 1
    assert sentence in verdict.reasons[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"inliers": float(FEWEST_INLIERS)},
        {"share_near": FEW_INLIERS},
        {"width": 0.99 * ROUGH * 0.01},
        {"width": 0.99 * ROUGH, "to_cloud": True},
        {"width": 0.0},
        {"expected": 0.0},
    ],
)
def test_at_the_limit_there_is_no_doubt(changes: dict[str, Any]) -> None:
    assert judge(dataclasses.replace(GOOD, **changes)).level == "accepted"


def test_all_doubts_stand_side_by_side_and_each_free_motion_for_itself() -> None:
    changes: dict[str, Any] = {
        "inliers": 10.0,
        "share_near": 0.1,
        "width": 1.0,
        "directions": (FREE, FREE, *(HELD,) * 4),
        "alternatives": (Alternative(np.eye(4), 0.1),) * 3,
        "status": "stalled",
    }
    verdict = judge(dataclasses.replace(GOOD, **changes))
    assert verdict.level == "suspect"
    assert len(verdict.reasons) == 7
    assert sum("free to" in reason for reason in verdict.reasons) == 2
    assert "3 other pose(s)" in verdict.reasons[5]


@pytest.mark.parametrize(
    ("status", "sentence"),
    [
        ("no correspondences", "hardly any scan point comes within 20 of the target"),
        ("degenerate correspondences", "no pose: the loop ended with 'degenerate correspondences'"),
    ],
)
def test_nothing_found_is_failed_whatever_else_is_known(status: str, sentence: str) -> None:
    for evidence in (GOOD, dataclasses.replace(GOOD, inliers=0.0, share_near=NAN, width=NAN, directions=())):
        verdict = judge(dataclasses.replace(evidence, found=False, status=status))
        assert verdict.level == "failed"
        assert len(verdict.reasons) == 1
        assert sentence in verdict.reasons[0]
