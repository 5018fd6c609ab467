"""`dqreg completion SHELL`: the script that completes commands, options and their words with the Tab key."""

from __future__ import annotations

import click

from dqreg.cli.choice import Choice

VARIABLE = "_DQREG_COMPLETE"


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
    script = make(context.find_root().command, {}, "dqreg", VARIABLE)
    click.echo(script.source_template % script.source_vars())
    return 0
