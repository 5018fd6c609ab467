"""A reader that goes away silences the output and changes nothing else."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dqreg.cli import pipes
from dqreg.cli.outputs import consoles, print_json, say
from dqreg.cli.pipes import PatientConsole
from dqreg.errors import InputError


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


class Full(Closed):
    """What standard error is where the disk of its log is full."""

    def write(self, text: str) -> int:
        raise OSError(28, "No space left on device")


def test_progress_that_cannot_be_written_is_lost_alone(void: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", Full())
    _, shown = consoles(quiet=False, as_json=True)
    # In a pipe nothing is shown beside JSON.
    shown.quiet = False
    say(shown, "search  proposed")
    with shown.status("writing"):
        say(shown, "search  screened")
    assert void
    # The answer itself is another matter.
    with pytest.raises(InputError, match="No space left"):
        say(PatientConsole(file=Full()), "ACCEPTED")


def test_an_error_that_cannot_be_told_keeps_its_exit_code(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("no device that is always full")
    with full.open("w") as log:
        done = subprocess.run([sys.executable, "-m", "dqreg", "faces", tmp_path / "no.stl"], stderr=log, check=False)
    assert done.returncode == 2


def test_json_that_nobody_reads_does_not_change_the_exit_code(void: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout", Closed())
    print_json({"outcome": "pass"})
    assert void
