"""`dqreg batch MANIFEST`: many registrations, one result file each, one summary."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.exit_codes import NOT_ACCEPTED, NOT_PASSED, SIGNAL_CODE
from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, read_head, say
from dqreg.cli.overwriting import require_apart
from dqreg.cli.registration_options import (
    effort_option,
    max_angle_option,
    max_distance_option,
    method_option,
    seed_option,
    units_option,
)
from dqreg.cli.signals import PoliteSignals
from dqreg.cli.values import FILE, UNITS, ToleranceType
from dqreg.errors import printable

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray
    from dqreg.registration.batch import Batch, BatchProgress
    from dqreg.registration.result.result import Registration
    from dqreg.report.work_bar import WorkBar

# Rows that are named one by one on the screen; all of them are in the summary.
NAMED_ROWS = 20
# Options of `dqreg.register` that the command line offers for all rows; a manifest may say each for its own.
SHARED = ("method", "effort", "max_distance", "max_angle_deg", "source_units", "target_units", "seed")
PICTURE_WIDTH, PICTURE_HEIGHT = 240, 180
PICTURE_POINTS = 20_000


@click.command()
@click.argument("manifest", type=FILE)
@click.option("--target", type=FILE, help="Target of the rows that name none; required if MANIFEST is a folder.")
@click.option("--out", type=FILE, help="Folder for results and summary  [default: NAME-results].")
@click.option(
    "--workers", type=int, metavar="N", help="Worker processes on this machine  [default: one for each core]."
)
@click.option("--scheduler", metavar="ADDRESS", help="Work on a Dask cluster instead, such as tcp://host:8786.")
@click.option(
    "--resume",
    is_flag=True,
    help="Resume in a folder that holds results: rows that are done, by this dqreg and unchanged, are kept.",
)
@click.option("--timeout", type=float, metavar="SECONDS", default=600.0, show_default=True, help="Time limit for each "
              "row.")  # fmt: skip
@click.option("--threads", type=int, metavar="N", help="Threads of each process  [default: cores divided by workers].")
@click.option("--start", default="none", show_default=True, metavar="none|identity|FILE", help="Default initial pose, "
              "for rows that name none.")  # fmt: skip
@method_option(of_rows=True)
@effort_option(of_rows=True)
@max_distance_option
@max_angle_option(of_rows=True)
@units_option("source", "the scans, where their files do not say")
@units_option("target", "the targets, where their files do not say")
@seed_option(of_rows=True)
@click.option("--plan", type=FILE, help="Inspection plan (TOML) of the parts, as in dqreg inspect.")
@click.option("--tolerance", type=ToleranceType(), metavar="LENGTH", help="Largest deviation allowed, target units, or "
              "two sides as +0.2/-0.05: each part passes, fails or is undecided.")  # fmt: skip
@click.option("--required", type=float, metavar="PERCENT", help="Points that must be within the tolerance  [default: "
              "the plan's, else 95].")  # fmt: skip
@click.option("--display-units", type=UNITS, help="Length unit of values, trends and reports, and of --tolerance; "
              "lengths of a plan are converted; results/*.json stay in the target's  "
              "[default: the plan's, else the target's].")  # fmt: skip
@click.option("--head", multiple=True, metavar="NAME=VALUE", help="Field of the head of all reports, such as "
              "operator='M. Muster'.")  # fmt: skip
@click.option("--no-reports", "reports", flag_value=False, default=True, help="No report for each row, where parts are "
              "inspected.")  # fmt: skip
@click.option("--no-thumbnails", "thumbnails", flag_value=False, default=True, help="No pictures in the summary.")
@as_json_option
@quiet_option
def batch(manifest: Path, target: Path | None, out: Path | None, as_json: bool, quiet: bool, **options: Any) -> int:
    """Register every row of MANIFEST, each in a worker process: a crash or a time-out affects one row.

    MANIFEST is a CSV file with the columns scan and target; optional columns are name, start and options of dqreg
    register (effort, max_distance, viewpoint ...), plan and tolerance of the part, and fields of its report's head
    (part, drawing, serial, order, operator, device, note). Paths are relative to it. It may also be a folder of scans,
    with --target. Options given here are the defaults of all rows.

    \b
    dqreg batch parts.csv
    dqreg batch my_scans --target part.stl --effort fast --out on_part
    dqreg batch parts.csv --resume                 after an interruption or a correction: only what is missing
    dqreg batch parts.csv --scheduler tcp://host:8786
    dqreg batch parts.csv --plan plan.toml         inspect every part: values, trends, a report for each
    dqreg batch parts.csv --tolerance 0.1
    dqreg batch parts.csv --json | jq '.rows[] | select(.verdict != "accepted")'

    Writes results/NAME.json for each row, summary.csv and summary.html; where parts are inspected also
    reports/NAME.html, values.csv (every value) and trends.csv (mean, spread, Cp, Cpk, control limits).
    Ctrl-C keeps the rows that are done and writes the summary; a second one stops at once.

    Exit codes: 0 every row accepted (and every part passes), 1 some were not, 2 bad input, 3 all accepted, but a part
    fails or is undecided, 130 or 143 stopped by a signal.
    """
    from dqreg.inspection.tolerances import share_of_percent
    from dqreg.registration.batch import Defaults, RowInspection, Workers, read_manifest, run_batch
    from dqreg.registration.batch.run import SUMMARY_CSV, TRENDS_CSV, VALUES_CSV
    from dqreg.report.work_bar import WorkBar

    console, shown = consoles(quiet=quiet, as_json=as_json)
    with PoliteSignals() as stop:
        workers = Workers(*(options[name] for name in ("workers", "scheduler", "threads", "timeout")))
        asked = RowInspection(
            None if options["plan"] is None else options["plan"].absolute(),
            options["tolerance"],
            None if options["required"] is None else share_of_percent(options["required"], "--required"),
            report=options["reports"],
            head=tuple(read_head(options["head"]).items()),
            display_units=options["display_units"],
        )
        shared = {name: options[name] for name in SHARED if options[name] is not None}
        rows = read_manifest(manifest, Defaults(target, options["start"], shared, asked))
        place = out or Path(f"{manifest.absolute().name if manifest.is_dir() else manifest.stem}-results")
        for name in (SUMMARY_CSV, VALUES_CSV, TRENDS_CSV):
            require_apart((manifest,), {"--out": place / name})
        stop.polite = True
        with WorkBar(shown) as bar:
            found = run_batch(
                rows,
                place,
                workers,
                resume=options["resume"],
                title=manifest.absolute().name,
                thumbnail=thumbnail if options["thumbnails"] else None,
                observe=_told(bar, shown),
                stop=stop.asked,
            )
    _show(console, found)
    if as_json:
        print_json(_record(found))
    if found.stopped:
        click.echo(
            f"dqreg: stopped; the rows done so far are in {printable(str(place))}: resume with --resume", err=True
        )
        return SIGNAL_CODE + stop.number
    if not found.accepted:
        return NOT_ACCEPTED
    return 0 if found.passed else NOT_PASSED


def _record(found: Batch) -> dict[str, Any]:
    """What came of a batch as plain values."""
    from dqreg.registration.batch.summary import to_records
    from dqreg.registration.batch.trends import trend_records, trends_of

    trends = trend_records(trends_of(found.lines))
    return {"rows": to_records(found.lines), "trends": trends, "files": [str(path) for path in found.files]}


def thumbnail(result: Registration) -> bytes | None:
    """A small picture of the scan on its target; runs in the worker, which has both at hand."""
    import io

    import numpy as np

    # Matplotlib brings it along, and takes ten times as long to load.
    from PIL import Image

    from dqreg.geometry import Mesh
    from dqreg.report.cameras import VIEWS, best_corner
    from dqreg.report.colours import ALIGNED, TARGET, rgb
    from dqreg.report.raster import Dots, PartScene, frame_of

    if result.inputs is None or not np.isfinite(result.T_target_source).all():
        return None
    target = result.inputs.target
    size = target.surface.diagonal
    scan = _some(result.inputs.placed(result.T_target_source)) / size
    geometry, layers = target.geometry, [Dots(scan, np.array(rgb(ALIGNED), np.uint8), 0.004)]
    if isinstance(geometry, Mesh):
        mesh, part = geometry, geometry.vertices / size
        corner = best_corner(target.surface.closest(scan * size).normals)
    else:
        mesh, part, corner = None, _some(geometry.points) / size, "iso"
        layers.insert(0, Dots(part, np.array(rgb(TARGET), np.uint8), 0.004))
    image = PartScene(mesh, size).render(
        frame_of(part, VIEWS[corner], PICTURE_WIDTH, PICTURE_HEIGHT), TARGET, "#ffffff", layers
    )
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "jpeg", quality=80, optimize=True)
    return buffer.getvalue()


def _some(points: FloatArray) -> FloatArray:
    return points[:: max(1, len(points) // PICTURE_POINTS)]


def _told(bar: WorkBar, console: Console) -> Callable[[BatchProgress], None]:
    """Shows how far a batch is."""
    from dqreg.report.progress import left_words

    def tell(progress: BatchProgress) -> None:
        row, left = progress.line, progress.seconds_left
        if row is None:
            words, line = "", _kept_words(progress)
        else:
            words = f"{row.row.shown}: {row.verdict}"
            took = "" if math.isnan(row.seconds) else f"{row.seconds:.1f} s"
            rest = left_words(left) if progress.done < progress.total else ""
            line = ", ".join(filter(None, (f"{progress.done}/{progress.total}  {words}", took, rest)))
        if not bar.show(progress.done, progress.total, left, words) and line:
            say(console, line)

    return tell


def _kept_words(progress: BatchProgress) -> str:
    """What an earlier session has left to this one."""
    words = [f"{progress.done} of {progress.total} rows are done already"] if progress.done else []
    if progress.outdated:
        words.append(f"{progress.outdated} are done again: another dqreg, or other versions, did them")
    return "; ".join(words)


def _show(console: Console, found: Batch) -> None:
    from dqreg.registration.batch.summary import counts, part_counts
    from dqreg.registration.batch.trends import trends_of

    bad = [line for line in found.lines if line.verdict not in ("accepted", "not run")]
    for line in bad[:NAMED_ROWS]:
        say(console, f"  {line.row.shown}: {line.verdict.upper()}: {'; '.join(line.reasons)}")
    if len(bad) > NAMED_ROWS:
        say(console, f"  and {len(bad) - NAMED_ROWS} more: see the summary")
    say(console, ", ".join(f"{count} {verdict}" for verdict, count in counts(found.lines).items()))
    missed = [line for line in found.lines if line.inspection and line.inspection.get("error")]
    for line in missed[:NAMED_ROWS]:
        say(console, f"  {line.row.shown}: part undecided: {(line.inspection or {})['error']}")
    parts = part_counts(found.lines)
    if parts:
        say(console, "parts: " + ", ".join(f"{count} {part.words}" for part, count in parts.items()))
    withheld = {trend.withheld: None for trend in trends_of(found.lines) if trend.withheld}
    for words in withheld:
        say(console, f"  {words}: see trends.csv")
    for path in found.files:
        say(console, f"wrote {path}")
