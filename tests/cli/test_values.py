"""Values of options as they are written on a command line."""

from __future__ import annotations

from typing import Any

import click
import pytest

from dqreg.cli.inspect import inspect_command
from dqreg.cli.multiway import multiway_command
from dqreg.cli.register import register_command
from dqreg.cli.values import places_of

FILES = ["scan.ply", "part.stl"]
COMMANDS = (register_command, inspect_command, multiway_command)
# Words, and the place that they mean.
FORMS: list[tuple[list[str], Any]] = [
    (["--viewpoint", "1", "-2", "3e1"], (1.0, -2.0, 30.0)),
    (["--viewpoint=1", "-2", "3e1"], (1.0, -2.0, 30.0)),
    (["--viewpoint", "-1,2,3"], (-1.0, 2.0, 3.0)),
    (["--viewpoint=-1,2,3"], (-1.0, 2.0, 3.0)),
    (["--viewpoint", "1 2 3"], (1.0, 2.0, 3.0)),
    (["--viewpoint", "1, 2, 3"], (1.0, 2.0, 3.0)),
    (["--viewpoint", "origin"], (0.0, 0.0, 0.0)),
    (["--viewpoint", "none"], "none"),
    (["--viewpoint=none"], "none"),
]


def read(command: click.Command, words: list[str]) -> dict[str, Any]:
    return command.make_context("dqreg", list(words)).params


@pytest.mark.parametrize(("words", "place"), FORMS)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_viewpoint_has_the_same_forms_everywhere(command: click.Command, words: list[str], place: Any) -> None:
    is_one = command is multiway_command
    for given in ([*words, *FILES], [*FILES, *words], [FILES[0], *words, FILES[1]]):
        found = read(command, given)
        assert found["viewpoint"] == (place if is_one else (place,))
        names = [*found["scans"]] if is_one else [str(found[key]) for key in ("scan", "target", "part") if key in found]
        assert names == FILES


def test_several_viewpoints_are_several_places() -> None:
    found = read(register_command, ["--viewpoint", "0", "0", "5", "--viewpoint", "origin", *FILES, "--viewpoint=1,2,3"])
    assert places_of(found["viewpoint"]) == ((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (1.0, 2.0, 3.0))


@pytest.mark.parametrize("words", [["0", "0"], ["here"], ["1,2"], ["0", "here", "9"], ["0", "0", "none"], [""], []])
@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_no_viewpoint_is_refused(command: click.Command, words: list[str]) -> None:
    with pytest.raises(click.UsageError) as error:
        read(command, [*FILES, "--viewpoint", *words])
    assert "--viewpoint" in error.value.format_message()


def test_names_behind_two_dashes_are_no_options() -> None:
    found = read(multiway_command, ["--viewpoint", "origin", "--", "--viewpoint", "1", "2"])
    assert (found["viewpoint"], found["scans"]) == ((0.0, 0.0, 0.0), ("--viewpoint", "1", "2"))
