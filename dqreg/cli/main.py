"""`dqreg`: the group of commands, and how errors leave the program."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

import click

from dqreg.cli.grouping import Commands, Entry
from dqreg.cli.leaving import Signals, say
from dqreg.errors import DqregError

BAD_INPUT, STOPPED = 2, 130

LOOK, USE, STUDY, CARE = "See it work", "Register", "Compare and study", "Look after"
ENTRIES = {
    "demo": Entry("dqreg.cli.demo:demo", "a part and a scan that ship with dqreg, against the known truth", LOOK),
    "register": Entry("dqreg.cli.register:register_command", "the pose of a scan on a part or another scan", USE),
    "batch": Entry("dqreg.cli.batch:batch", "many registrations: one result each, a summary table", USE),
    "odometry": Entry("dqreg.cli.odometry:odometry_command", "a LiDAR sequence to a trajectory", USE),
    "show": Entry("dqreg.cli.show:show", "pictures, window or report of a saved result", USE),
    "evaluate": Entry("dqreg.cli.evaluate:evaluate", "errors of a pose against the truth", STUDY),
    "compare": Entry("dqreg.cli.compare:compare", "dqreg and its peers on the same tasks, one judge", STUDY),
    "synth": Entry("dqreg.cli.synth:synth", "virtual scans with known truth from a recipe", STUDY),
    "reproduce": Entry("dqreg.cli.reproduce:reproduce", "tables and figures of the papers, ours beside theirs", STUDY),
    "doctor": Entry("dqreg.cli.doctor:doctor", "what is installed, what is missing, how to mend it", CARE),
    "completion": Entry("dqreg.cli.completion:completion", "Tab completion for bash, zsh and fish", CARE),
}


@click.group(
    cls=Commands,
    entries=ENTRIES,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="dqreg")
def cli() -> None:
    """Puts a scan on its CAD part, or on another scan, and says how sure it is.

    \b
    dqreg demo                                              see it work
    dqreg register scan.ply part.stl --report report.html   no start needed
    dqreg register scan.ply part.stl --start nominal.txt --out result.json
    dqreg register scan.ply part.stl --json | jq .verdict   for scripts
    dqreg show result.json --save view.png                  needs no display

    Every command explains itself: dqreg COMMAND --help.
    Exit codes: 0 verdict accepted, 1 ran but not accepted, 2 bad input.
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; expected errors are one line on stderr, unexpected ones keep their trace."""
    noted = _Noted()
    try:
        with Signals(noted):
            code = cli.main(arguments, prog_name="dqreg", standalone_mode=False)
    except BaseException as error:
        if noted.number:
            # What a signal has become on its way through other people's code is not worth a trace.
            say(noted.number)
            sys.exit(128 + noted.number)
        code = _tell(error)
    if noted.number:
        # It was swallowed on its way: the work is done, and whoever sent it has to know.
        say(noted.number)
        code = 128 + noted.number
    sys.exit(code if isinstance(code, int) else 0)


class _Noted:
    """Raises what a signal stands for, so that all that tidies up is run, and remembers which it was."""

    def __init__(self) -> None:
        self.number = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


def _tell(error: BaseException) -> int:
    """Say what went wrong; unexpected errors go on as they are."""
    if isinstance(error, click.ClickException):
        return _bad(error.format_message())
    if isinstance(error, click.Abort):
        # An interrupt that a command has kept for itself until now.
        say(signal.SIGINT)
        return STOPPED
    if isinstance(error, DqregError):
        return _bad(str(error))
    # Files are opened where errors have names; what has none is the output itself.
    if isinstance(error, OSError) and error.filename is None:
        # What is still in the buffer would fail once more at the very end.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
        return _bad(f"cannot write to the standard output: {error.strerror or error}")
    raise error


def _bad(message: str) -> int:
    click.echo(f"dqreg: error: {' '.join(message.split())}", err=True)
    return BAD_INPUT
