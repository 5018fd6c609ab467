"""`dqreg`: the group of commands, and how errors leave the program."""

from __future__ import annotations

import sys

import click

from dqreg.cli.batch import batch
from dqreg.cli.compare import compare
from dqreg.cli.demo import demo
from dqreg.cli.doctor import doctor
from dqreg.cli.evaluate import evaluate
from dqreg.cli.odometry import odometry_command
from dqreg.cli.register import register_command
from dqreg.cli.reproduce import reproduce
from dqreg.cli.show import show
from dqreg.cli.synth import synth
from dqreg.errors import DqregError

BAD_INPUT = 2


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="dqreg")
def cli() -> None:
    """Registers scans to CAD meshes and clouds.

    \b
    dqreg demo                                     see it work on a part that ships with the package
    dqreg register scan.ply part.stl               find the pose of a scan on its part
    dqreg register scan.ply part.stl --start T.txt --out result.json --aligned on_part.ply
    dqreg show result.json --save view.png         a picture of it, without a display; or a window with one
    dqreg compare my_case                          every engine on the same task, on one judge
    dqreg evaluate result.json --truth truth.json  errors of a pose against the truth
    dqreg reproduce walker1991                     the paper's tables, ours beside theirs (also: jia2020)
    dqreg odometry my_scans --out poses.txt        a LiDAR sequence to a trajectory, a verdict a frame
    dqreg batch parts.csv --resume                 many registrations: one result each, a summary table
    dqreg doctor                                   what is installed, what is missing, how to mend it

    Exit codes: 0 verdict accepted, 1 ran but not accepted, 2 bad input.
    """


for command in (batch, compare, demo, doctor, evaluate, odometry_command, register_command, reproduce, show, synth):
    cli.add_command(command)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; expected errors are one line on stderr, unexpected ones keep their trace.

    Parameters
    ----------
    arguments : list of str, optional
        Instead of ``sys.argv[1:]``.
    """
    try:
        code = cli.main(arguments, prog_name="dqreg", standalone_mode=False)
    except click.ClickException as error:
        _leave(error.format_message())
    except click.Abort:
        _leave("stopped by the user; nothing was written", code=130)
    except DqregError as error:
        _leave(str(error))
    sys.exit(code if isinstance(code, int) else 0)


def _leave(message: str, code: int = BAD_INPUT) -> None:
    click.echo(f"dqreg: error: {' '.join(message.split())}", err=True)
    sys.exit(code)
