"""An option that several commands have is the same one in each."""

from collections import defaultdict

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
    ("odometry", "--search"),  # Degrees
    ("inspect", "--json"),  # A file
    ("show", "--start"),  # A file alone
    ("show", "--tolerance"),  # One side: the end of the colours
    ("multiway", "--viewpoint"),  # One place for all
}


def kind(option: click.Option) -> tuple[object, ...]:
    info = option.type.to_info_dict()
    return info["name"].removesuffix(" range"), info.get("choices"), option.metavar, option.nargs, option.multiple


def test_the_same_name_has_the_same_type_everywhere() -> None:
    found = defaultdict(lambda: defaultdict(list))
    context = click.Context(cli)
    for name in cli.list_commands(context):
        for option in cli.get_command(context, name).params:
            if isinstance(option, click.Option) and (name, option.opts[0]) not in OTHERS:
                found[option.opts[0]][kind(option)].append(name)
    assert {name: dict(kinds) for name, kinds in found.items() if len(kinds) > 1} == {}


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
