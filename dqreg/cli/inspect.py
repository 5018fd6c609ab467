"""`dqreg inspect SCAN PART --plan FILE`: a first-article inspection, from files to a sheet."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.attempts import register_files
from dqreg.cli.faces import read_part_in
from dqreg.cli.lazy_group import Choice, SectionedCommand
from dqreg.cli.outputs import as_json_option, consoles, print_json, read_head, say, tell_decision
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.registration.inspected import Inspected
    from dqreg.registration.result import Registration

UNITS = Choice(["mm", "cm", "m", "inch", "ft"])
FILE = click.Path(path_type=Path)
SECTIONS = {
    "Plan": ("plan", "suggest", "tolerance", "required"),
    "Output": ("report", "pdf", "head", "table", "out", "deviations", "as_json"),
    "Points of the part": ("reach", "exclude", "keep"),
    "Registration": ("start", "source_units", "target_units", "display_units", "time_limit", "seed"),
}


@click.command("inspect", cls=SectionedCommand, sections=SECTIONS)
@click.argument("scan", type=FILE, required=False)
@click.argument("part", type=FILE, required=False)
@click.option("--plan", type=FILE, help="The inspection plan (TOML): datums, alignment, characteristics.")
@click.option("--suggest", type=FILE, metavar="PART", help="Print a first plan for this part, and nothing else; with "
              "SCAN only of the faces that it covers.")  # fmt: skip
@click.option("--tolerance", type=float, metavar="LENGTH", help="Largest deviation allowed anywhere on the part, in "
              "its unit, beside the plan or in its place.")  # fmt: skip
@click.option("--required", type=float, metavar="PERCENT", default=95.0, show_default=True, help="Points that must be "
              "within --tolerance, of all and of each region.")  # fmt: skip
@click.option("--report", type=FILE, help="The sheet as a page (.html) or in print (.pdf).")
@click.option("--pdf", type=FILE, help="The sheet in print, beside --report.")
@click.option("--head", multiple=True, metavar="NAME=VALUE", help="Field of the sheet's head, such as serial=0007; "
              "may be given again; wins over the plan's.")  # fmt: skip
@click.option("--csv", "table", type=FILE, help="The characteristics as a table.")
@click.option("--out", type=FILE, help="The registration as JSON.")
@click.option("--deviations", type=FILE, help="Every point with its signed deviation in the sheet's alignment: "
              "coloured .ply, .csv or .npy.")  # fmt: skip
@click.option("--reach", type=float, metavar="LENGTH", help="Points farther from the part belong to something else  "
              "[default: 0.05 of the smaller diagonal].")  # fmt: skip
@click.option("--exclude", type=float, nargs=6, multiple=True, metavar="X Y Z X Y Z", help="Leave the points in this "
              "box out: two opposite corners, PART's coordinates; may be given again.")  # fmt: skip
@click.option("--keep", is_flag=True, help="Count surfaces that leave the part (a table, a clamp) and outliers too.")
@click.option("--start", default="none", show_default=True, metavar="none|identity|FILE", help="Initial pose, as in "
              "dqreg register.")  # fmt: skip
@click.option("--time-limit", type=float, metavar="SECONDS", help="Time limit of the registration.")
@click.option("--source-units", type=UNITS, help="Length unit of SCAN, where its file does not say.")
@click.option("--target-units", type=UNITS, help="Length unit of PART, where its file does not say  [default: the "
              "plan's].")  # fmt: skip
@click.option("--display-units", type=UNITS, help="Length unit of the sheet, and of all lengths given here  [default: "
              "the plan's, else PART's].")  # fmt: skip
@click.option("--seed", type=int, metavar="N", default=0, show_default=True, help="Seed of all random draws.")
@as_json_option
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def inspect_command(
    scan: Path | None,
    part: Path | None,
    plan: Path | None,
    suggest: Path | None,
    tolerance: float | None,
    required: float,
    start: str,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> int:
    """Inspect SCAN against PART by a plan: register it, fit features, align to datums, measure every characteristic.

    \b
    dqreg inspect --suggest part.stl > plan.toml                a first plan, to be edited
    dqreg inspect scan.ply --suggest part.stl > plan.toml       of the faces that were scanned
    dqreg inspect scan.ply part.stl --plan plan.toml
    dqreg inspect scan.ply part.stl --plan plan.toml --report sheet.pdf --csv sheet.csv --head serial=0007

    Exit codes: 0 alignment trusted and all characteristics pass; 1 alignment not trusted; 2 bad input; 3 alignment
    trusted, but a characteristic fails or is undecided.
    """
    goals = {name: options.pop(name) for name in ("report", "pdf", "table", "out", "deviations")}
    taken = {name: options.pop(name) for name in ("reach", "exclude", "keep")}
    head = read_head(options.pop("head"))
    if suggest is not None:
        return _suggest(suggest, scan, start, options)
    if scan is None or part is None or (plan is None and tolerance is None):
        raise InputError("give SCAN, PART and --plan FILE; dqreg inspect --suggest PART writes a first plan")
    from dqreg.inspection import read_plan
    from dqreg.registration.inspected import inspect_registration

    _check(goals)
    asked = None if plan is None else read_plan(plan)
    unit = options.pop("display_units") or (None if asked is None else asked.units)
    if goals["out"] is not None and unit is not None and read_part_in(part, options["target_units"], unit)[1] != 1.0:
        raise InputError(f"--out is in the part's unit, and the sheet in {unit}: give one of the two")
    console, shown = consoles(quiet=quiet, as_json=as_json, apart=True)
    result = _registered(scan, part, start, unit, shown, options)
    try:
        found = inspect_registration(result, asked, tolerance, required_share=required / 100.0, **taken)
    except InputError:
        if result.verdict.level == "failed":
            _tell_failed(console, result)
            return 1
        raise
    _tell(console, result, found, required / 100.0)
    _write(goals, result, found, tolerance, required / 100.0, head, console)
    if as_json:
        print_json(_record(result, found, head))
    if result.verdict.level != "accepted":
        return 1
    return 0 if found.outcome == "pass" else 3


def _check(goals: dict[str, Path | None]) -> None:
    from dqreg.files.atomic import require_writable
    from dqreg.inspection.deviation_files import require_suffix
    from dqreg.report.page_file import page_path

    for name, path in goals.items():
        if path is not None:
            (page_path if name in ("report", "pdf") else require_writable)(path)
    if goals["pdf"] is not None and goals["pdf"].suffix.lower() != ".pdf":
        raise InputError(f"--pdf must end in .pdf; got {goals['pdf'].name!r}")
    if goals["deviations"] is not None:
        require_suffix(goals["deviations"])


def _registered(
    scan: Path, part: Path, start: str, unit: str | None, shown: Console, options: dict[str, Any]
) -> Registration:
    """The scan on the part, in the unit that was asked for."""
    import numpy as np

    from dqreg._open3d import load_open3d
    from dqreg.files.poses import read_start
    from dqreg.report import make_progress

    began = read_start(start)
    target: Any = part
    if unit is not None:
        mesh, scale = read_part_in(part, options["target_units"], unit)
        options["target_units"] = unit
        if scale != 1.0:
            target = mesh
            if not isinstance(began, str) and began is not None:
                began = np.vstack([np.column_stack([began[:3, :3], scale * began[:3, 3]]), began[3]])
    shows = make_progress(shown, quiet=shown.quiet, unit=options["target_units"], searching=began is None)
    with shows as progress:
        if scan.exists() and part.exists():
            load_open3d()
        told = {"observe": progress, "observe_search": progress.search}
        found = register_files(scan, target, began, shown, **told, **options)
    # A part that was converted is still that file to its reader.
    return dataclasses.replace(found, settings={**found.settings, "target": str(part)})


def _tell_failed(console: Console, result: Registration) -> None:
    from dqreg.report import print_summary

    print_summary(console, result)
    say(console, "not inspected: no pose was found")


def _tell(console: Console, result: Registration, found: Inspected, required_share: float) -> None:
    from dqreg.report.inspection_table import tell_alignment, tell_inspection

    tell_alignment(console, result)
    if found.decision is not None:
        tell_decision(found.deviations, required_share, console)
    if found.sheet is not None:
        tell_inspection(console, found.sheet, str(result.settings.get("target_units") or ""))


def _write(
    goals: dict[str, Path | None],
    result: Registration,
    found: Inspected,
    tolerance: float | None,
    required_share: float,
    head: dict[str, str],
    console: Console,
) -> None:
    from dqreg.files.atomic import write_atomically
    from dqreg.report.inspection_table import characteristics_table
    from dqreg.report.page import to_html
    from dqreg.report.page_file import write_page
    from dqreg.report.report_data import collect
    from dqreg.report.table import to_csv

    shown = found.registration
    if goals["table"] is not None and found.sheet is not None:
        rows = characteristics_table(found.sheet, str(result.settings.get("target_units") or ""))
        write_atomically(goals["table"], to_csv(rows.head, rows.rows))
    if goals["out"] is not None:
        result.save(goals["out"])
    if goals["deviations"] is not None:
        shown.deviations(tolerance).save(goals["deviations"])
    pages = [path for path in (goals["report"], goals["pdf"]) if path is not None]
    if pages:
        assert shown.inputs is not None
        with console.status("writing the report"):
            data = collect(shown, shown.inputs, tolerance, required_share=required_share, inspection=found.sheet)
            html = to_html(shown, data, found.sheet, head)
            for path in pages:
                write_page(path, html)
    for goal in goals.values():
        if goal is not None and goal.exists():
            say(console, f"wrote {goal}")


def _suggest(part: Path, scan: Path | None, start: str, options: dict[str, Any]) -> int:
    from dqreg.inspection.suggested_plan import suggested_plan

    wanted = options.pop("display_units")
    mesh, _ = read_part_in(part, options["target_units"], wanted)
    if scan is None:
        click.echo(suggested_plan(mesh, units=mesh.units))
        return 0
    from dqreg.inspection.scanned_part import ScannedPart

    result = _registered(scan, part, start, mesh.units, consoles(quiet=True, as_json=True)[1], options)
    shares = dict(enumerate(ScannedPart.of(result.deviations()).coverage().tolist()))
    click.echo(suggested_plan(mesh, shares, units=mesh.units))
    return 0 if result.verdict.level == "accepted" else 1


def _record(result: Registration, found: Inspected, head: dict[str, str]) -> dict[str, Any]:
    from dqreg.report.sheet import digests_of

    sheet = found.sheet
    return {
        "verdict": result.verdict,
        "outcome": found.outcome,
        "units": result.settings.get("target_units"),
        "T_target_source": found.registration.T_target_source,
        "alignment": None if sheet is None or sheet.alignment is None else dataclasses.asdict(sheet.alignment),
        "head": {**({} if sheet is None else sheet.plan.head), **head},
        "characteristics": [] if sheet is None else [dataclasses.asdict(row) for row in sheet.characteristics],
        "faces": [] if sheet is None else [dataclasses.asdict(face) for face in sheet.faces],
        "decision": None if found.decision is None else dataclasses.asdict(found.decision),
        "sha256": dict(digests_of(result.settings)),
    }
