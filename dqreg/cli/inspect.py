"""`dqreg inspect SCAN PART --plan FILE`: a first-article inspection, from files to a sheet."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.lazy_group import Choice
from dqreg.cli.outputs import as_json_option, consoles, print_json, say
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.inspection import Inspection
    from dqreg.registration.result import Registration

UNITS = Choice(["mm", "cm", "m", "inch", "ft"])
FILE = click.Path(path_type=Path)


@click.command("inspect")
@click.argument("scan", type=FILE, required=False)
@click.argument("part", type=FILE, required=False)
@click.option("--plan", type=FILE, help="The inspection plan (TOML): datums, alignment, characteristics.")
@click.option("--suggest", type=FILE, metavar="PART", help="Print a first plan for this part, and nothing else.")
@click.option("--start", default="none", show_default=True, metavar="none|identity|FILE", help="Initial pose, as in "
              "dqreg register.")  # fmt: skip
@click.option("--report", type=FILE, help="One HTML page: head, characteristics, view, deviations.")
@click.option("--csv", "table", type=FILE, help="The characteristics as a table.")
@click.option("--source-units", type=UNITS, help="Length unit of SCAN, where its file does not say.")
@click.option("--target-units", type=UNITS, help="Length unit of PART, where its file does not say.")
@click.option("--seed", type=int, metavar="N", default=0, show_default=True, help="Seed of all random draws.")
@as_json_option
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def inspect_command(
    scan: Path | None,
    part: Path | None,
    plan: Path | None,
    suggest: Path | None,
    start: str,
    report: Path | None,
    table: Path | None,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> int:
    """Inspect SCAN against PART by a plan: register it, fit features, align to datums, measure every characteristic.

    \b
    dqreg inspect --suggest part.stl > plan.toml
    dqreg inspect scan.ply part.stl --plan plan.toml
    dqreg inspect scan.ply part.stl --plan plan.toml --report sheet.html --csv sheet.csv

    Exit codes: 0 alignment trusted and all characteristics pass; 1 alignment not trusted; 2 bad input; 3 alignment
    trusted, but a characteristic fails or is undecided.
    """
    if suggest is not None:
        return _suggest(suggest)
    if scan is None or part is None or plan is None:
        raise InputError("give SCAN, PART and --plan FILE; dqreg inspect --suggest PART writes a first plan")
    from dqreg.files.atomic import require_writable, write_atomically
    from dqreg.files.poses import read_start
    from dqreg.inspection import inspect, read_plan
    from dqreg.registration.register import register
    from dqreg.report.inspection_table import characteristics_table, tell_inspection
    from dqreg.report.table import to_csv

    for path in (report, table):
        if path is not None:
            require_writable(path)
    asked = read_plan(plan)
    console, _ = consoles(quiet=quiet, as_json=as_json)
    result = register(scan, part, read_start(start), **options)
    found = inspect(result.deviations(), asked)
    unit = str(result.settings.get("target_units") or "")
    tell_inspection(console, result, found, unit)
    shown = aligned_to(result, found)
    if table is not None:
        rows = characteristics_table(found, unit)
        write_atomically(table, to_csv(rows.head, rows.rows))
        say(console, f"wrote {table}")
    if report is not None:
        from dqreg.report.page import write_report

        write_report(shown, report, inspection=found)
        say(console, f"wrote {report}")
    if as_json:
        print_json(_record(result, shown, found))
    if result.verdict.level != "accepted":
        return 1
    return 0 if found.outcome == "pass" else 3


def aligned_to(result: Registration, found: Inspection) -> Registration:
    """The registration under the pose of the datums; unchanged for the best fit."""
    if found.alignment is None:
        return result
    return dataclasses.replace(result, T_target_source=found.alignment.T_target_source @ result.T_target_source)


def _suggest(part: Path) -> int:
    from dqreg.cli.faces import read_part
    from dqreg.inspection.suggested_plan import suggested_plan

    click.echo(suggested_plan(read_part(part)))
    return 0


def _record(result: Registration, shown: Registration, found: Inspection) -> dict[str, Any]:
    return {
        "verdict": result.verdict,
        "outcome": found.outcome,
        "units": result.settings.get("target_units"),
        "T_target_source": shown.T_target_source,
        "alignment": None if found.alignment is None else dataclasses.asdict(found.alignment),
        "head": found.plan.head,
        "characteristics": [dataclasses.asdict(row) for row in found.characteristics],
    }
