"""The commands, each imported when it is called, and help that is ordered by purpose."""

from __future__ import annotations

import copy
import dataclasses
import importlib

import click
from click.shell_completion import CompletionItem

from dqreg.errors import did_you_mean


@dataclasses.dataclass(frozen=True)
class Entry:
    """Where a command lives and what the list of commands says of it."""

    home: str  # ``module:attribute``
    words: str  # A few, for the list
    section: str  # Heading of the list under which it stands


LOOK, USE, STUDY, CARE = "See it work", "Register", "Compare and study", "Look after"
ENTRIES = {
    "demo": Entry("dqreg.cli.demo:demo", "a part and a scan that ship with dqreg, against the known truth", LOOK),
    "register": Entry("dqreg.cli.register:register_command", "the pose of a scan on a part or another scan", USE),
    "studio": Entry("dqreg.cli.studio:studio", "the local page: from two files to a signed sheet, by pointing", USE),
    "batch": Entry("dqreg.cli.batch:batch", "many registrations: one result each, a summary table", USE),
    "multiway": Entry("dqreg.cli.multiway:multiway_command", "many scans into one frame, with a model", USE),
    "odometry": Entry("dqreg.cli.odometry:odometry_command", "a LiDAR sequence to a trajectory", USE),
    "inspect": Entry("dqreg.cli.inspect:inspect_command", "a plan of datums and characteristics on a scan", USE),
    "faces": Entry("dqreg.cli.faces:faces_command", "faces of a part: shape, diameter, place", USE),
    "hand-eye": Entry(
        "dqreg.cli.hand_eye:hand_eye_command", "the pose of a sensor on a robot's hand or beside it", USE
    ),
    "show": Entry("dqreg.cli.show:show", "picture, window or report of a saved result", USE),
    "evaluate": Entry("dqreg.cli.evaluate:evaluate", "errors of a pose against the truth", STUDY),
    "compare": Entry("dqreg.cli.compare:compare", "dqreg and its peers on the same tasks", STUDY),
    "synth": Entry("dqreg.cli.synth:synth", "virtual scans with known truth from a recipe", STUDY),
    "reproduce": Entry("dqreg.cli.reproduce:reproduce", "tables and figures of the papers, reproduced", STUDY),
    "doctor": Entry("dqreg.cli.doctor:doctor", "what is installed, what is missing, how to install it", CARE),
    "completion": Entry("dqreg.cli.lazy_group:completion", "Tab completion for bash, zsh and fish", CARE),
}


class LazyGroup(click.Group):
    """A group that imports a command only when it is called, and lists all of them under headings."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the list."""
        return list(ENTRIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a name, imported now; None where there is none."""
        entry = ENTRIES.get(cmd_name)
        if entry is None:
            return None
        module, _, attribute = entry.home.partition(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the first word names; `click.UsageError` names the nearest where none fits."""
        name = args[0]
        if name not in ENTRIES and not name.startswith("-") and not ctx.resilient_parsing:
            ctx.fail(f"No such command {name!r}{did_you_mean(name, ENTRIES)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list, a heading a purpose."""
        width = max(map(len, ENTRIES))
        for section in dict.fromkeys(entry.section for entry in ENTRIES.values()):
            with formatter.section(section):
                rows = [(name, e.words) for name, e in ENTRIES.items() if e.section == section]
                formatter.write_dl([(name.ljust(width), words) for name, words in rows])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names with their words, without importing a single command."""
        found = [CompletionItem(name, help=e.words) for name, e in ENTRIES.items() if name.startswith(incomplete)]
        # Options of the group; the list of its commands is above.
        return [*found, *click.Command.shell_complete(self, ctx, incomplete)]


class SectionedCommand(click.Command):
    """A command whose help lists its options under headings."""

    def __init__(self, *arguments: object, sections: dict[str, tuple[str, ...]], **attributes: object) -> None:
        super().__init__(*arguments, **attributes)  # type: ignore[arg-type]
        self.sections = sections

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, a heading a purpose."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        records = {p.name: record for p in options if (record := p.get_help_record(ctx)) is not None}
        for heading, names in self.sections.items():
            with formatter.section(heading):
                formatter.write_dl([records.pop(name) for name in names])
        with formatter.section("Other options"):
            formatter.write_dl(list(records.values()))


class Choice(click.Choice[str]):
    """Like `click.Choice`, in one short sentence, with the word that was probably meant."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """What is said of a word that is not known."""
        return f"{str(value)!r} is not one of {', '.join(self.choices)}{did_you_mean(str(value), self.choices)}"


class Renamed(click.Option):
    """An option whose older names are taken, and not shown."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """What the help says of it."""
        shown = copy.copy(self)
        shown.opts = self.opts[:1]
        return click.Option.get_help_record(shown, ctx)


# Keywords of Python whose options have other names.
KEYWORDS = {
    "max-angle-deg": "max-angle",
    "no-accelerate": "no-acceleration",
    "viewpoints": "viewpoint",
    "form": "format",
}


def spelling(word: str) -> str:
    """The option that a word means, with its dashes or without, which may be spelled as the keyword of Python is.

    >>> spelling("time_limit"), spelling("--max_angle_deg"), spelling("--time-limit")
    ('time-limit', '--max-angle', '--time-limit')
    """
    name = word.removeprefix("--").replace("_", "-")
    return ("--" if word.startswith("--") else "") + KEYWORDS.get(name, name)


SETTINGS = {
    "help_option_names": ["-h", "--help"],
    "max_content_width": 110,
    # Of options, and of the words of a `Choice`.
    "token_normalize_func": spelling,
}


@click.group(cls=LazyGroup, context_settings=SETTINGS)
@click.version_option(package_name="dqreg")
def cli() -> None:
    """Register a scan to its CAD part or to another scan, with the uncertainty of the pose.

    \b
    dqreg demo                                              see it work
    dqreg register scan.ply part.stl --report report.html   no initial pose needed
    dqreg register scan.ply part.stl --start nominal.txt --out result.json
    dqreg register scan.ply part.stl --json | jq .verdict   for scripts
    dqreg show result.json --save view.png                  needs no display

    Help of a command: dqreg COMMAND --help.
    Exit codes: 0 verdict accepted, 1 ran but not accepted, 2 bad input, 3 accepted, but the part is out of tolerance.
    """


@click.command()
@click.argument("shell", type=Choice(["bash", "zsh", "fish"]), metavar="bash|zsh|fish")
@click.pass_context
def completion(context: click.Context, shell: str) -> int:
    """Print the script that makes the Tab key complete dqreg's commands, options and their values.

    \b
    dqreg completion bash >> ~/.bashrc
    dqreg completion zsh >> ~/.zshrc               after the line with compinit
    dqreg completion fish > ~/.config/fish/completions/dqreg.fish

    Then open a new shell.
    """
    from click.shell_completion import get_completion_class

    make = get_completion_class(shell)
    assert make is not None
    # Not `source()`: for bash it would first ask the shell for its version, which is the user's and not this script's.
    script = make(context.find_root().command, {}, "dqreg", "_DQREG_COMPLETE")
    click.echo(script.source_template % script.source_vars())
    return 0
