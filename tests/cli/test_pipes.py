"""A reader that goes away silences the output and changes nothing else."""

from __future__ import annotations

import io
import os
from typing import Any

import pytest

from dqreg.cli import pipes
from dqreg.cli.outputs import print_json, say
from dqreg.cli.pipes import PatientConsole


class Closed(io.StringIO):
    """What standard output is once `head -1` has its line."""

    def write(self, text: str) -> int:
        raise BrokenPipeError

    def flush(self) -> None:
        raise BrokenPipeError


@pytest.fixture
def void(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Times that standard output was sent away; not that of the tests."""
    times: list[int] = []

    def dup2(*_: Any) -> None:
        times.append(1)

    monkeypatch.setattr(pipes.os, "dup2", dup2)
    monkeypatch.setattr(pipes.os, "open", lambda *_: os.dup(2))
    return times


def test_a_console_falls_silent_and_goes_on(void: list[int]) -> None:
    console = PatientConsole(file=Closed())
    # Rich itself raises SystemExit(1) here: the files after it would not be written.
    say(console, "ACCEPTED")
    assert console.quiet
    say(console, "wrote sheet.html")
    assert void


def test_json_that_nobody_reads_does_not_change_the_exit_code(void: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout", Closed())
    print_json({"outcome": "pass"})
    assert void
