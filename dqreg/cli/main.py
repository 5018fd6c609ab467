"""`dqreg`: the group of commands, and how errors leave the program."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

import click

from dqreg.cli.grouping import Commands, Entry
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
    """Run the command line and exit; expected errors are one line on stderr, unexpected ones keep their trace.

    Parameters
    ----------
    arguments : list of str, optional
        Instead of ``sys.argv[1:]``.
    """
    _terminate_in_order()
    try:
        code = cli.main(arguments, prog_name="dqreg", standalone_mode=False)
    except click.ClickException as error:
        _leave(error.format_message())
    except click.Abort:
        _leave("stopped by the user; no file is left half-written", code=STOPPED)
    except DqregError as error:
        _leave(str(error))
    except OSError as error:
        # Files are opened where errors have names; what has none is the output itself.
        if error.filename is not None:
            raise
        _leave_without_output(error)
    sys.exit(code if isinstance(code, int) else 0)


def _leave(message: str, code: int = BAD_INPUT) -> None:
    click.echo(f"dqreg: error: {' '.join(message.split())}", err=True)
    sys.exit(code)


def _leave_without_output(error: OSError) -> None:
    # What is still in the buffer would fail once more at the very end.
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    _leave(f"cannot write to the standard output: {error.strerror or error}")


def _terminate_in_order() -> None:
    # A process that is ended otherwise leaves what it was writing; as an exception SIGTERM runs all that tidies up.
    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, leave)
