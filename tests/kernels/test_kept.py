from __future__ import annotations

import os
import signal
import threading

import pytest

from dqreg.kernels import kept as home
from dqreg.kernels.kept import Kept
from dqreg.kernels.threads import TimeUpError, ask_clock, until


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


def test_what_is_not_for_others_ends_with_the_time_of_its_caller() -> None:
    kept = Kept(lambda: ask_clock() or threading.get_ident(), for_others=False)
    with until(0.0), pytest.raises(TimeUpError):
        kept.result()
    assert kept.result() == threading.get_ident()


def test_what_was_begun_is_made_beside_and_waited_for_as_long_as_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(home, "thread_count", lambda: 2)
    goes_on = threading.Event()
    kept = Kept(lambda: goes_on.wait(60.0) and threading.get_ident())
    with until(0.0):
        kept.begin()
        kept.begin()
    with until(0.0), pytest.raises(TimeUpError):
        kept.result()
    # It goes on, for whoever asks later.
    goes_on.set()
    assert kept.result() not in (False, threading.get_ident())


def test_without_another_core_it_is_made_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(home, "thread_count", lambda: 1)
    kept = Kept(threading.get_ident)
    kept.begin()
    with until(0.0):
        assert kept.result() == threading.get_ident()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_does_not_wait_for_its_parents_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(home, "thread_count", lambda: 2)
    goes_on, is_there, parent = threading.Event(), threading.Event(), os.getpid()
    kept = Kept(lambda: os.getpid() != parent or (is_there.set(), goes_on.wait(30.0)))
    kept.begin()
    assert is_there.wait(30.0)
    child = os.fork()
    if not child:
        signal.alarm(20)
        os._exit(0 if kept.result() is True else 1)
    assert os.waitpid(child, 0)[1] == 0
    goes_on.set()
