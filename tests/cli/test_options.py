"""An option that several commands have is the same one in each."""

import re
from collections import defaultdict
from collections.abc import Iterator

import click
import pytest

from dqreg.cli import values
from dqreg.cli.lazy_group import cli
from dqreg.files.units import METRES
from dqreg.registration.options import options

# Same name, other thing; this list only shrinks.
OTHERS = {
    ("odometry", "--engine"),  # One of two
    ("odometry", "--method"),  # Its own three
    ("inspect", "--json"),  # A file
    ("show", "--start"),  # A file alone
    ("show", "--tolerance"),  # One side: the end of the colours
    ("multiway", "--viewpoint"),  # One place for all
    ("studio", "--port"),  # Any that is free
    ("synth", "--seed"),  # That of the recipe, where none is given
}
# Options whose words, or default, say what the command at hand does with it; this list only shrinks.
OWN_WORDS = {
    "--csv", "--deviations", "--display-units", "--expected-deviation", "--head", "--json", "--out", "--plan",
    "--quiet", "--reach", "--report", "--required", "--resume", "--source-units", "--start", "--target",
    "--target-units", "--threads", "--time-limit", "--timeout", "--tolerance", "--truth", "--workers",
}  # fmt: skip
# Names that Click gives to types: they say nothing of what is meant.
UNTOLD = ("TEXT", "INTEGER", "FLOAT", "INTEGER RANGE", "FLOAT RANGE")


def all_options() -> Iterator[tuple[str, click.Option]]:
    context = click.Context(cli)
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        yield from ((name, option) for option in command.params if isinstance(option, click.Option))


def kind(option: click.Option) -> tuple[object, ...]:
    info = option.type.to_info_dict()
    return info["name"].removesuffix(" range"), info.get("choices"), option.metavar, option.nargs, option.multiple


def words(option: click.Option) -> tuple[str, ...]:
    """The first sentence of an option, and the default that its help shows."""
    record = option.get_help_record(click.Context(cli))
    assert record is not None
    first = re.split(r"[.:;] |\.$| +\[", record[1])[0]
    return (first, *re.findall(r"\[default: ([^\];]*)", record[1]))


@pytest.mark.parametrize("told", [kind, words])
def test_the_same_name_is_the_same_option_everywhere(told) -> None:
    found = defaultdict(lambda: defaultdict(list))
    for name, option in all_options():
        if (name, option.opts[0]) not in OTHERS and not (told is words and option.opts[0] in OWN_WORDS):
            found[option.opts[0]][told(option)].append(name)
    assert {name: dict(kinds) for name, kinds in found.items() if len(kinds) > 1} == {}


def test_lists_of_exceptions_hold_what_is_there() -> None:
    names = [option.opts[0] for _, option in all_options()]
    assert {(name, option.opts[0]) for name, option in all_options()} >= OTHERS
    assert {name for name in OWN_WORDS if names.count(name) < 2} == set()


def test_every_value_says_what_it_is() -> None:
    context = click.Context(cli)
    shown = {(name, option.opts[0]): option.make_metavar(context) for name, option in all_options()
             if not option.is_flag}  # fmt: skip
    assert {place: metavar for place, metavar in shown.items() if metavar in UNTOLD} == {}


def test_the_help_of_every_command_tells_its_exit_codes() -> None:
    context = click.Context(cli)
    helps = {name: cli.get_command(context, name).help for name in cli.list_commands(context)}
    assert {name for name, text in helps.items() if "Exit code" not in text} == {"completion", "demo"}


@pytest.mark.parametrize(("name", "old", "new", "value"), [
    ("compare", "--home", "--success", "0.02"), ("odometry", "--search", "--search-deg", "30"),
])  # fmt: skip
def test_an_older_name_is_taken_and_not_shown(name: str, old: str, new: str, value: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    key = next(option.name for _, option in all_options() if new in option.opts)
    assert command.make_context(name, ["x", old, value]).params[key] == float(value)
    assert command.make_context(name, ["x", new, value]).params[key] == float(value)
    text = command.get_help(click.Context(command))
    assert new in text
    assert not re.search(rf"{old}\b(?!-)", text)


def test_words_are_those_of_the_library() -> None:
    assert tuple(values.UNITS.choices) == tuple(METRES)
    assert (values.NO_PLACE, values.ORIGIN) == (options.NO_VIEWPOINT, options.ORIGIN)


@pytest.mark.parametrize("command", ["register", "inspect", "batch", "compare"])
def test_a_unit_is_one_that_files_may_have(command: str) -> None:
    found = cli.get_command(click.Context(cli), command)
    assert found is not None
    words = ["a.csv"] if command == "batch" else ["a.ply", "b.stl"]
    params = found.make_context(command, [*words, "--source-units", "um"]).params
    assert params["source_units"] == "um"
    with pytest.raises(click.BadParameter, match="did you mean mm"):
        found.make_context(command, [*words, "--source-units", "millimetres"])
