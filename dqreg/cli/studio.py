"""`dqreg studio [SCAN PART]`: the local page, from two files to a signed sheet."""

from __future__ import annotations

from pathlib import Path

import click

from dqreg.cli.exit_codes import code_of
from dqreg.cli.outputs import consoles, say
from dqreg.cli.values import FILE
from dqreg.errors import InputError


@click.command("studio")
@click.argument("scan", type=FILE, required=False)
@click.argument("part", type=FILE, required=False)
@click.option(
    "--port", type=click.IntRange(0, 65535), metavar="N", default=0, help="Port on 127.0.0.1; 0 takes a free one."
)
@click.option("--folder", type=FILE, help="Where visits are kept, to resume them another day  [default: a "
              "temporary folder, removed at the end].")  # fmt: skip
@click.option("--batch", type=FILE, metavar="FOLDER", help="Show the rows of a dqreg batch as it runs: its --out.")
@click.option("--odometry", type=FILE, metavar="SCANS", help="Show the odometry of a LiDAR sequence as it runs: map, "
              "frame, trajectory.")  # fmt: skip
@click.option("--no-browser", "browser", flag_value=False, default=True, help="Print the address, open nothing.")
@click.option("--replay", "visit", type=FILE, metavar="VISIT", help="Do a saved visit again without the page.")
@click.option("--out", type=FILE, default=Path(), help="Where --replay writes  [default: the working folder].")
@click.option("--quiet", is_flag=True, help="Print nothing but the address and errors.")
def studio(
    scan: Path | None,
    part: Path | None,
    port: int,
    folder: Path | None,
    batch: Path | None,
    odometry: Path | None,
    browser: bool,
    visit: Path | None,
    out: Path,
    quiet: bool,
) -> int:
    """Open a page in the browser: load a scan and its part, clean, align, judge, report.

    \b
    dqreg studio                           drop both files on the page
    dqreg studio scan.ply part.stl
    dqreg studio --folder visits           visits are kept there
    dqreg studio --batch out               the table of a batch, while it runs and after
    dqreg studio --odometry my_scans       a LiDAR sequence: map, frame, trajectory
    dqreg studio --replay visit.json --out sheet

    The page is served on 127.0.0.1 to this machine alone, under an address with a key; nothing leaves the machine and
    nothing is fetched. Ctrl-C ends it.

    Exit codes: 0 ended by Ctrl-C; 2 bad input; of --replay those of dqreg inspect.
    """
    console, _ = consoles(quiet=quiet, as_json=False)
    if visit is not None:
        from dqreg.studio.replay import inspected_again

        found, outcome = inspected_again(visit, out)
        judged = "" if outcome is None else f"; part: {outcome}"
        say(console, f"alignment: {found.registration.verdict.level}{judged}; wrote its files to {out}")
        return code_of([found.registration.verdict.level], [outcome])
    if odometry is not None and (scan is not None or batch is not None):
        raise InputError("--odometry has a page of its own: leave SCAN, PART and --batch out")
    if (scan is None) != (part is None):
        raise InputError("give SCAN and PART, or neither and drop them on the page")
    from dqreg.files.untrusted import require_readable
    from dqreg.studio.serve import serve

    for path in (scan, part):
        if path is not None:
            require_readable(path)

    def tell(address: str) -> None:
        click.echo(address)
        say(console, "Open this address on this machine. Ctrl-C ends the studio.")

    serve(scan, part, port=port, folder=folder, batch=batch, odometry=odometry, drive=drive, browser=browser, tell=tell)
    return 0


def drive(scans: Path, folder: Path) -> None:
    """Run the odometry of a sequence, and tell the page after every frame; in a worker process."""
    from dqreg.odometry.run_sequence import run_sequence
    from dqreg.odometry.scans import open_scans
    from dqreg.odometry.settings import OdometrySettings
    from dqreg.studio.travel import Story

    data = open_scans(scans)
    story = Story(folder, len(data))
    run_sequence(data, OdometrySettings(), show=story.show)
    story.end()
