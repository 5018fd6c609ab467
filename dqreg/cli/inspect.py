"""`dqreg inspect SCAN PART --plan FILE`: a first-article inspection, from files to a sheet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.attempts import refuse_swapped, register_files
from dqreg.cli.exit_codes import code_of
from dqreg.cli.faces import read_part_in
from dqreg.cli.inspection_outputs import (
    check_goals,
    record_of,
    record_without_pose,
    tell,
    tell_failed,
    write,
    write_failed,
)
from dqreg.cli.outputs import consoles, print_json, quiet_option, read_head, require_below_reach
from dqreg.cli.registration_options import (
    dof_option,
    exclude_option,
    keep_option,
    search_option,
    seed_option,
    start_option,
    time_limit_option,
    units_option,
    viewpoint_option,
)
from dqreg.cli.values import FILE, UNITS, PlaceCommand, ToleranceType, places_of
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.inspection import Tolerance
    from dqreg.registration.result.display_unit import ShownTarget
    from dqreg.registration.result.result import Registration

# Columns of a pipe, so that tables are not broken.
PIPE_COLUMNS = 160
GOALS = ("report", "pdf", "table", "out", "deviations", "sections", "as_json")
SECTIONS = {
    "Plan": ("plan", "suggest", "tolerance", "required"),
    "Output": ("report", "pdf", "head", "table", "out", "deviations", "sections", "as_json"),
    "Points of the part": ("reach", "exclude", "keep"),
    "Registration": (
        "expected_deviation",
        "start",
        "search",
        "dof",
        "viewpoint",
        "source_units",
        "target_units",
        "display_units",
        "time_limit",
        "seed",
    ),
}


class InspectCommand(PlaceCommand):
    """Its --json takes a file that ends in .json, and else none: what follows may be SCAN."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        following = [*args[1:], ""]
        words = [
            "--json=-" if word == "--json" and not after.lower().endswith(".json") else word
            for word, after in zip(args, following, strict=True)
        ]
        return super().parse_args(ctx, words)


@click.command("inspect", cls=InspectCommand, sections=SECTIONS)
@click.argument("scan", type=FILE, required=False)
@click.argument("part", type=FILE, required=False)
@click.option("--plan", type=FILE, help="The inspection plan (TOML): datums, alignment, characteristics.")
@click.option("--suggest", type=FILE, metavar="PART", help="Print a first plan for this part, and nothing else; with "
              "SCAN only of the faces that it covers.")  # fmt: skip
@click.option("--tolerance", type=ToleranceType(), metavar="LENGTH", help="Largest deviation allowed anywhere on the "
              "part, or two sides as +0.2/-0.05; without a plan, or in place of its own.")  # fmt: skip
@click.option("--required", type=float, metavar="PERCENT", help="Points that must be within the tolerance, of all and "
              "of each region  [default: the plan's, else 95].")  # fmt: skip
@click.option("--report", type=FILE, help="The sheet as a page (.html) or in print (.pdf).")
@click.option("--pdf", type=FILE, help="The sheet in print, beside --report.")
@click.option("--head", multiple=True, metavar="NAME=VALUE", help="Field of the sheet's head, such as serial=0007; "
              "may be given again; wins over the plan's.")  # fmt: skip
@click.option("--csv", "table", type=FILE, help="All that was measured as a table: characteristics, regions, places.")
@click.option("--out", type=FILE, help="The registration as JSON.")
@click.option("--deviations", type=FILE, help="Every point with its signed deviation in the sheet's alignment: "
              "coloured .ply, .csv or .npy.")  # fmt: skip
@click.option("--sections", type=FILE, help="Deviations along the plan's sections: .csv.")
@click.option("--reach", type=float, metavar="LENGTH", help="Points farther from the part belong to something else  "
              "[default: found in the scan].")  # fmt: skip
@click.option("--expected-deviation", type=float, metavar="LENGTH", help="Deviation of the part from PART that does "
              "not speak against the alignment  [default: the plan's, else twice the largest tolerance, 0.0005 of the "
              "part's size at least].")  # fmt: skip
@exclude_option
@keep_option
@start_option
@search_option
@dof_option
@viewpoint_option
@time_limit_option
@units_option("source", "SCAN, where its file does not say")
@units_option("target", "PART, where its file does not say", "the plan's")
@click.option("--display-units", type=UNITS, help="Length unit of the sheet, and of all lengths given here; those of "
              "the plan are converted  [default: the plan's, else PART's].")  # fmt: skip
@seed_option()
@click.option("--json", "as_json", type=FILE, metavar="[FILE.json]",
              help="All that was measured as JSON: in a file, or alone on standard output.")  # fmt: skip
@quiet_option
def inspect_command(
    scan: Path | None,
    part: Path | None,
    plan: Path | None,
    suggest: Path | None,
    tolerance: float | Tolerance | None,
    required: float | None,
    quiet: bool,
    **options: Any,
) -> int:
    """Inspect SCAN against PART by a plan: register it, fit features, align to datums, measure every characteristic.

    \b
    dqreg inspect --suggest part.stl > plan.toml                a first plan, to be edited
    dqreg inspect scan.ply --suggest part.stl > plan.toml       of the faces that were scanned
    dqreg inspect scan.ply part.stl --tolerance 0.1 --report report.html
    dqreg inspect scan.ply part.stl --plan plan.toml
    dqreg inspect scan.ply part.stl --plan plan.toml --report sheet.pdf --csv sheet.csv --head serial=0007

    Exit codes: 0 alignment trusted and the part passes; 1 alignment not trusted; 2 bad input; 3 alignment trusted, but
    the part fails or is undecided.
    """
    goals = {name: options.pop(name) for name in GOALS}
    taken = {name: options.pop(name) for name in ("reach", "exclude", "keep")}
    head = read_head(options.pop("head"))
    if suggest is not None:
        return _suggest(suggest, scan, options)
    if scan is None or part is None or (plan is None and tolerance is None):
        raise InputError(
            "give SCAN, PART, and --tolerance LENGTH or --plan FILE; dqreg inspect --suggest PART writes a first plan"
        )
    from dqreg.inspection import read_plan
    from dqreg.inspection.tolerances import share_of_percent, tolerance_of
    from dqreg.registration.result.display_unit import shown_target
    from dqreg.registration.result.part_inspection import expected_deviation_of, inspect_registration

    check_goals(goals, (scan, part, plan))
    allowed = None if tolerance is None else tolerance_of(tolerance, "--tolerance")
    require_below_reach(allowed, taken["reach"])
    share = None if required is None else share_of_percent(required, "--required")
    asked = None if plan is None else read_plan(plan)
    if goals["sections"] is not None and (asked is None or not asked.sections):
        raise InputError("--sections: there is no plan with a [[section]], so there is nothing to write")
    wanted = options.pop("display_units")
    unit = shown_target(part, options["target_units"], wanted, None if asked is None else asked.units)
    planned = None if asked is None else unit.planned(asked)
    options["expected_deviation"] = expected_deviation_of(planned, allowed, unit.units, options["expected_deviation"])
    to_screen = goals["as_json"] == Path("-")
    console, shown = consoles(quiet=quiet, as_json=to_screen, apart=True, width=PIPE_COLUMNS)
    result = _registered(scan, part, unit, shown, options)
    refuse_swapped(result, scan, part)
    if result.verdict.level == "failed":
        head = {**({} if asked is None else asked.head), **head}
        record = record_without_pose(result, head)
        tell_failed(console, result)
        write_failed(goals, result, record, head, console, unit.native)
    else:
        found = inspect_registration(result, planned, allowed, required_share=share, **taken)
        record = record_of(found, head)
        tell(console, found)
        write(goals, found, record, head, console, unit.native)
        result = found.registration
    if to_screen:
        print_json(record)
    return code_of([result.verdict.level], [record["outcome"]])


def _registered(scan: Path, part: Path, unit: ShownTarget, shown: Console, options: dict[str, Any]) -> Registration:
    """The scan on the part, in the unit that was asked for, with the digests of both files as they are read."""
    from dqreg._open3d import load_open3d
    from dqreg.files.poses import read_start
    from dqreg.files.side_digests import digests_of_sides
    from dqreg.report import make_progress

    digests = digests_of_sides({"source": scan, "target": part})
    began = unit.start(read_start(options.pop("start")))
    options["viewpoint"] = places_of(options["viewpoint"])
    options["target_units"] = unit.units
    shows = make_progress(shown, quiet=shown.quiet, unit=unit.units, searching=began is None)
    with shows as progress:
        if scan.exists():
            load_open3d()
        options |= {"observe": progress, "observe_search": progress.search}
        with unit.source_units(scan, options["source_units"]) as options["source_units"]:
            return unit.named(register_files(scan, unit.geometry, began, shown, **options), part, digests)


def _suggest(part: Path, scan: Path | None, options: dict[str, Any]) -> int:
    from dqreg.inspection.plan.suggested_plan import suggested_plan
    from dqreg.registration.result.display_unit import shown_target

    wanted = options.pop("display_units")
    mesh, _ = read_part_in(part, options["target_units"], wanted)
    if scan is None:
        click.echo(suggested_plan(mesh, units=mesh.units))
        return 0
    from dqreg.inspection.scanned_part.scanned_part import ScannedPart

    unit = shown_target(part, options["target_units"], wanted)
    result = _registered(scan, part, unit, consoles(quiet=True, as_json=True)[1], options)
    scanned = ScannedPart.of(result.deviations())
    shares = dict(enumerate(scanned.coverage().tolist()))
    click.echo(suggested_plan(mesh, shares, units=mesh.units, noise=scanned.noise))
    return code_of([result.verdict.level])
