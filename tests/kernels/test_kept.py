from __future__ import annotations

import threading

import pytest

from dqreg.kernels.kept import Kept
from dqreg.kernels.threads import TimeUpError, until


def test_a_deadline_ends_the_waiting_and_not_the_making() -> None:
    goes_on, made = threading.Event(), []

    def make() -> str:
        assert goes_on.wait(60.0)
        made.append("once")
        return "value"

    kept = Kept(make)
    for _ in range(2):
        with until(0.0), pytest.raises(TimeUpError):
            kept.result()
    assert not made
    goes_on.set()
    assert kept.result() == "value"
    with until(0.0):
        assert kept.result() == "value"
    assert made == ["once"]


def test_what_fails_is_made_anew() -> None:
    answers = iter([ValueError("the first time"), None])

    def make() -> str:
        if (error := next(answers)) is not None:
            raise error
        return "value"

    kept = Kept(make)
    with pytest.raises(ValueError, match="the first time"):
        kept.result()
    assert kept.result() == "value"
