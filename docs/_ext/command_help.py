"""The directive ``command-help``: what ``dqreg COMMAND --help`` prints, so that the page can never differ from it."""

from __future__ import annotations

from typing import Any

import click
from docutils import nodes
from docutils.parsers.rst import Directive

WIDTH = 86


class CommandHelp(Directive):
    """Takes the name of a command; without one it shows the list of all."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The help as a literal block."""
        from dqreg.cli.lazy_group import cli

        settings = {"terminal_width": WIDTH, "max_content_width": WIDTH, "help_option_names": ["-h", "--help"]}
        context = click.Context(cli, info_name="dqreg", **settings)
        command: click.Command = cli
        if self.arguments:
            found = cli.get_command(context, self.arguments[0])
            if found is None:
                raise self.error(f"there is no command {self.arguments[0]}")
            command, context = found, click.Context(found, info_name=self.arguments[0], parent=context, **settings)
        text = command.get_help(context)
        return [nodes.literal_block(text, text, language="text")]


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
