"""What the shell is told, by one rule."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from dqreg.cli.exit_codes import code_of
from dqreg.cli.studio import studio


@pytest.mark.parametrize(
    ("levels", "outcomes", "code"),
    [
        (["accepted"], [], 0),
        (["accepted"], [None], 0),
        (["accepted"], ["pass"], 0),
        (["accepted"], ["fail"], 3),
        (["accepted"], ["undecided"], 3),
        (["accepted", "accepted"], ["pass", "fail"], 3),
        (["suspect"], ["pass"], 1),
        (["failed"], ["undecided"], 1),
        (["accepted", "suspect"], ["fail", "pass"], 1),
    ],
)
def test_codes(levels: list[str], outcomes: list[str | None], code: int) -> None:
    assert code_of(levels, outcomes) == code


@pytest.mark.parametrize(("outcome", "code"), [("pass", 0), ("undecided", 3), ("fail", 3), (None, 0)])
def test_a_visit_done_again_says_how_the_part_did(monkeypatch: pytest.MonkeyPatch, outcome: str, code: int) -> None:
    found = SimpleNamespace(registration=SimpleNamespace(verdict=SimpleNamespace(level="accepted")))
    module = importlib.import_module("dqreg.studio.replay")  # The room has a function of that name.
    monkeypatch.setattr(module, "inspected_again", lambda *_: (found, outcome))
    answer = CliRunner().invoke(studio, ["--replay", "visit.json"], catch_exceptions=False, standalone_mode=False)
    assert answer.return_value == code


def test_codes_stand_in_one_file() -> None:
    # Numbers of their own in the commands went apart.
    sources = Path(__file__).parents[2].joinpath("dqreg", "cli").glob("*.py")
    own = [path.name for path in sources if any(f"return {n}\n" in path.read_text() for n in (1, 3, 4))]
    assert own == []
