"""`dqreg reproduce PAPER`: the papers' tables, figures and formulas, ours beside theirs."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from dqreg.cli.outputs import quiet_option, say
from dqreg.cli.values import FILE


@click.command()
@click.argument("paper", type=click.Choice(["walker1991", "jia2020"]))
@click.option("--out", type=FILE, help="Folder for the files it writes  [default: dqreg-PAPER].")
@click.option(
    "--seed", type=click.IntRange(min=0), metavar="N", default=0, show_default=True, help="Seed of all random draws."
)
@click.option("--quick", is_flag=True, help="Fewer trials: seconds, with less exact numbers.")
@quiet_option
def reproduce(paper: str, out: Path | None, seed: int, quick: bool, quiet: bool) -> int:
    """Reproduce a paper: tables on the screen; numbers, figures and one HTML page in a folder.

    \b
    walker1991   Walker, Shao and Volz: dual quaternions from points and directions
    jia2020      Jia's notes on quaternions

    Exit codes: 0 reproduced; 2 bad input.
    """
    from dqreg.cli.pipes import PatientConsole
    from dqreg.papers import PAPERS, prepare_folder, print_section, write_report
    from dqreg.papers import reproduce as answer

    folder = out or Path(f"dqreg-{paper}")
    prepare_folder(folder, PAPERS[paper].figures)
    # A pipe has no width of its own; the tables need more than the usual 80.
    console = PatientConsole(quiet=quiet, width=None if sys.stdout.isatty() else 170, highlight=False)
    console.print(PAPERS[paper].citation, markup=False)
    report = answer(paper, seed, quick=quick, observe=lambda section: print_section(console, section))
    console.print()
    for path in write_report(report, folder):
        say(console, f"wrote {path}")
    return 0
