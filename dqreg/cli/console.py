"""The console's entry: signals have their meaning before anything else is imported."""

from __future__ import annotations

from dqreg.cli.leaving import leave_at_once, listen


def main() -> None:
    """Run `dqreg` with the words of the command line, and exit."""
    # Never undone: while Python takes itself down at the end, a signal must not leave a traceback either.
    listen(leave_at_once)
    from dqreg.cli.main import main as run

    run()
