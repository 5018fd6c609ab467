from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable

import pytest

from dqreg.trust.records import Direction, Reason, Verdict


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda verdict: pickle.loads(pickle.dumps(verdict))])
def test_copies_keep_sentences_and_codes(again: Callable[[Verdict], Verdict]) -> None:
    verdict = Verdict("suspect", (Reason("one pose of two", "alternative_poses"), Reason("of old")))
    other = again(verdict)
    assert other == verdict
    assert other.codes == verdict.codes == ("alternative_poses", "")
    assert type(other.reasons[0]) is Reason


def test_a_reason_is_its_sentence() -> None:
    reason = Reason("one pose of two", "alternative_poses")
    assert reason == "one pose of two"
    assert json.dumps([reason]) == '["one pose of two"]'
    assert f"{reason}; {reason!r}" == "one pose of two; 'one pose of two'"
    assert {reason: 1}["one pose of two"] == 1


def test_plain_sentences_become_reasons_without_a_code() -> None:
    assert Verdict("failed", ("a", Reason("b", "no_pose"))).codes == ("", "no_pose")  # type: ignore[arg-type]


def test_a_motion_without_a_sigma_is_free() -> None:
    assert Direction(0.0, float("nan"), "free").is_free
    assert not Direction(0.0, 0.0, "held").is_free


def test_a_further_doubt_stands_first_and_saves_no_failed_pose() -> None:
    doubt, note = Reason("late", "time_stamp"), Reason("2 of 3 left out", "dropped_points")
    assert Verdict("accepted", (Reason("fine", "accepted"), note)).doubted(doubt) == Verdict("suspect", (doubt, note))
    assert Verdict("suspect", (note,)).doubted(doubt) == Verdict("suspect", (doubt, note))
    failed = Verdict("failed", (Reason("nothing", "no_pose"),))
    assert failed.doubted(doubt) is failed
