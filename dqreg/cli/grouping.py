"""Commands that are imported when they are called, and help that is ordered by purpose."""

from __future__ import annotations

import dataclasses
import importlib

import click
from click.shell_completion import CompletionItem

from dqreg.cli.choice import meant


@dataclasses.dataclass(frozen=True)
class Entry:
    """Where a command lives and what the list of commands says of it."""

    home: str  # ``module:attribute``
    words: str  # A few, for the list
    section: str  # Heading of the list under which it stands


class Commands(click.Group):
    """A group that imports a command only when it is called, and lists all of them under headings."""

    def __init__(self, entries: dict[str, Entry] | None = None, **attributes: object) -> None:
        super().__init__(**attributes)  # type: ignore[arg-type]
        self.entries = entries or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the list."""
        return list(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a name, imported now; None where there is none."""
        entry = self.entries.get(cmd_name)
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
        if name not in self.entries and not name.startswith("-") and not ctx.resilient_parsing:
            ctx.fail(f"No such command {name!r}.{meant(name, self.entries)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list, a heading a purpose."""
        width = max(map(len, self.entries))
        for section in dict.fromkeys(entry.section for entry in self.entries.values()):
            with formatter.section(section):
                rows = [(name, e.words) for name, e in self.entries.items() if e.section == section]
                formatter.write_dl([(name.ljust(width), words) for name, words in rows])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names with their words, without importing a single command."""
        found = [CompletionItem(name, help=e.words) for name, e in self.entries.items() if name.startswith(incomplete)]
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
