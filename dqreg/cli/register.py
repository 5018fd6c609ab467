"""`dqreg register SCAN TARGET`: one registration, from files to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.attempts import refuse_swapped, register_files
from dqreg.cli.exit_codes import code_of
from dqreg.cli.lazy_group import Choice
from dqreg.cli.outputs import (
    consoles,
    deviation_record,
    print_json,
    quiet_option,
    require_below_reach,
    tell_decision,
    tell_deviations,
    tell_report,
    tell_result,
)
from dqreg.cli.overwriting import require_apart, require_ending
from dqreg.cli.registration_options import (
    dof_option,
    effort_option,
    exclude_option,
    keep_option,
    max_angle_option,
    max_distance_option,
    method_option,
    search_option,
    seed_option,
    start_option,
    time_limit_option,
    units_option,
    viewpoint_option,
)
from dqreg.cli.values import FILE, UNITS, PlaceCommand, ScaleType, ToleranceType, places_of
from dqreg.errors import InputError
from dqreg.kernels.compiling.second_process import start_where_nothing_is_kept

if TYPE_CHECKING:
    from dqreg.inspection import Tolerance
SECTIONS = {
    "Output": ("out", "report", "aligned", "deviations", "as_json"),
    "Initial pose": ("start", "search", "dof", "viewpoint", "clutter"),
    "Units": ("source_units", "target_units", "display_units", "units", "scale"),
    "Deviations of the part": ("tolerance", "required", "expected_deviation", "reach", "exclude", "keep"),
    "Registration": ("effort", "time_limit", "max_distance", "max_angle_deg", "method", "accelerate", "seed"),
}


@click.command("register", cls=PlaceCommand, sections=SECTIONS)
@click.argument("scan", type=FILE)
@click.argument("target", type=FILE)
@start_option
@search_option
@dof_option
@viewpoint_option
@click.option("--out", type=FILE, help="The result as JSON; its 4x4 matrix alone for .txt.")
@click.option(
    "--report", type=FILE, help="One page, HTML or PDF: verdict, view, deviations; with --tolerance, pass or fail."
)
@click.option("--aligned", type=FILE, help="The scan in the target's frame as PLY.")
@click.option("--deviations", type=FILE, help="Every point with its signed deviation: coloured .ply, .csv or .npy.")
@click.option("--json", "as_json", is_flag=True, help="The result as JSON on standard output, and nothing else there.")
@click.option("--tolerance", type=ToleranceType(), metavar="LENGTH", help="Largest deviation allowed, target units, or "
              "two sides as +0.2/-0.05: decide whether the part passes, and end the colour scale there.")  # fmt: skip
@click.option("--required", type=float, metavar="PERCENT", default=95.0, show_default=True, help="Points, of all and "
              "of each region, that must be within the tolerance. Single points outside are tolerated, groups of "
              "neighbours are not.")  # fmt: skip
@click.option("--reach", type=float, metavar="LENGTH", help="Points farther from the target than this are taken for "
              "other objects and left out, target units  [default: found in the scan].")  # fmt: skip
@click.option("--clutter", type=Choice(["allowed", "none"]), default="allowed", show_default=True, help="Whether SCAN "
              "may show other objects; with none, every point off TARGET speaks against the pose.")  # fmt: skip
@click.option("--expected-deviation", type=float, metavar="LENGTH", help="Deviation of the part from TARGET that does "
              "not speak against the pose, target units  [default: twice the tolerance, 0.0005 of the size at least]."
              )  # fmt: skip
@exclude_option
@keep_option
@effort_option()
@time_limit_option
@max_distance_option
@max_angle_option()
@method_option()
@click.option("--no-acceleration", "accelerate", flag_value=False, default=True, help="No Anderson acceleration.")
@seed_option()
@units_option("source", "SCAN, where its file does not say", "TARGET's")
@units_option("target", "TARGET, where its file does not say")
@click.option("--display-units", type=UNITS, help="Length unit of all that people read (screen, report, deviations), "
              "and of all lengths given here; --out and --aligned stay in TARGET's  [default: TARGET's].")  # fmt: skip
@click.option("--units", type=Choice(["check", "ignore"]), default="check", show_default=True, help="Whether scans "
              "and parts whose sizes differ as mm and inches do are refused.")  # fmt: skip
@click.option("--scale", type=ScaleType(), default="1", show_default=True, metavar="solve|FACTOR", help="Scale factor "
              "of SCAN besides its unit; solve estimates it with its uncertainty.")  # fmt: skip
@quiet_option
def register_command(
    scan: Path,
    target: Path,
    start: str,
    out: Path | None,
    aligned: Path | None,
    deviations: Path | None,
    report: Path | None,
    tolerance: float | Tolerance | None,
    required: float,
    reach: float | None,
    exclude: tuple[tuple[float, ...], ...],
    keep: bool,
    quiet: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Register SCAN to TARGET, a CAD mesh or another scan: find the pose of the scan in the target's frame.

    \b
    dqreg register scan.ply part.stl                                   no initial pose needed
    dqreg register scan.ply part.stl --report report.html --tolerance 0.05
    dqreg register scan.pcd part.stl --start nominal.txt --out result.json
    dqreg register moved.ply fixed.ply --start identity --aligned moved_on_fixed.ply
    dqreg register scan.ply part.stl --source-units m --target-units mm
    dqreg register scan.ply part.stl --start nominal.txt --dof "rz tx ty"
    dqreg register scan.ply part.stl --target-units m --display-units mm --report report.html
    dqreg register scan.ply part.stl --scale solve
    dqreg register scan.ply part.stl --viewpoint 0 0 0
    dqreg register scan.ply part.stl --json | jq .verdict.level

    Exit codes: 0 alignment trusted and, with --tolerance, the part passes; 1 alignment not trusted; 2 bad input (one
    line on standard error); 3 alignment trusted, but the part fails or is undecided.
    """
    if scan.exists() and target.exists():
        start_where_nothing_is_kept()
    from dqreg._open3d import load_open3d
    from dqreg.files.poses import read_start
    from dqreg.files.side_digests import digests_of_sides
    from dqreg.inspection.decision.decision import decide
    from dqreg.inspection.tolerances import share_of_percent, tolerance_of
    from dqreg.registration.result.display_unit import shown_target
    from dqreg.registration.result.part_inspection import expected_deviation_of
    from dqreg.report import make_progress

    # Asked before the work starts, so that no result is lost after it.
    require_apart((scan, target), {"--out": out, "--report": report, "--aligned": aligned, "--deviations": deviations})
    _check(out, aligned, deviations, report, {"--reach": reach, "--expected-deviation": options["expected_deviation"]})
    allowed = None if tolerance is None else tolerance_of(tolerance, "--tolerance")
    require_below_reach(allowed, reach)
    share = share_of_percent(required, "--required")
    options["expected_deviation"] = expected_deviation_of(None, allowed, None, options["expected_deviation"])
    console, shown = consoles(quiet=quiet, as_json=as_json, apart=True)
    digests = digests_of_sides({"source": scan, "target": target}) if out or report else None
    unit = shown_target(target, options["target_units"], options.pop("display_units"))
    options["target_units"], began = unit.units, unit.start(read_start(start))
    shows = make_progress(shown, quiet=shown.quiet, unit=unit.units, searching=began is None)
    options["viewpoint"] = places_of(options["viewpoint"])
    with shows as progress:
        # Its pictures need Open3D: said before the work. A mesh is registered to without it.
        if report is not None and scan.exists() and target.exists():
            load_open3d()
        options |= {"observe": progress, "observe_search": progress.search}
        with unit.source_units(scan, options["source_units"]) as options["source_units"]:
            result = register_files(scan, unit.geometry, began, console, **options)
    result = unit.named(result, target, digests)
    if allowed is not None:
        refuse_swapped(result, scan, target)
    tell_result(result, unit.native(result), out, aligned, console)
    measured = decision = None
    trusted = result.verdict.level == "accepted"
    if deviations is not None or allowed is not None:
        measured = tell_deviations(result, deviations, allowed, console, reach=reach, exclude=exclude, keep=keep)
    if measured is not None and allowed is not None:
        decision = decide(measured, allowed, share)
        tell_decision(decision, measured, console, result)
    if report is not None:
        tell_report(result, report, reach, began, console, measured, decision)
    if as_json:
        found = None if measured is None else deviation_record(measured, decision, trusted=trusted)
        print_json(result.to_dict() if found is None else result.to_dict() | {"deviations": found})
    return code_of([result.verdict.level], [decision.outcome] if decision else [])


def _check(
    out: Path | None,
    aligned: Path | None,
    deviations: Path | None,
    report: Path | None,
    lengths: dict[str, float | None],
) -> None:
    from dqreg.files.atomic import require_writable
    from dqreg.files.write import require_cloud_suffix
    from dqreg.inspection.deviations.files import require_suffix
    from dqreg.report.page_file import page_path

    require_ending("--out", out, "the result as JSON, or its matrix T_target_source alone", (".json", ".txt"))
    if aligned is not None:
        require_cloud_suffix(aligned)
    for path in (out, aligned, deviations):
        if path is not None:
            require_writable(path)
    if report is not None:
        page_path(report)
    if deviations is not None:
        require_suffix(deviations)
    for name, length in lengths.items():
        if length is not None and not length > 0.0:
            raise InputError(f"{name} must be a length above 0 in target units; got {length!r}")
