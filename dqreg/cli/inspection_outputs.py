"""What `dqreg inspect` leaves behind: on the screen, in tables, pages and JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.outputs import say, tell_decision
from dqreg.cli.overwriting import require_apart, require_ending
from dqreg.errors import InputError, printable

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.registration.result.part_inspection import Inspected
    from dqreg.registration.result.result import Registration

Goals = Mapping[str, Path | None]
# Options that are not called as what they ask for.
OPTIONS = {"table": "--csv", "as_json": "--json"}
# JSON on the standard output.
SCREEN = Path("-")
# What is made of measurements alone.
OF_MEASUREMENTS = ("table", "deviations", "sections")


def check_goals(goals: Goals, read: Iterable[Path | None]) -> None:
    """Refuse, before the work, what cannot be written, and what would take the place of a file that is read."""
    from dqreg.files.atomic import require_writable
    from dqreg.inspection.deviations.files import require_suffix
    from dqreg.report.page_file import page_path

    named = {OPTIONS.get(name, f"--{name}"): path for name, path in goals.items() if path != SCREEN}
    require_apart(read, named)
    require_ending("--out", goals["out"], "the registration as JSON", (".json",))
    for name in ("--csv", "--sections"):
        require_ending(name, named.get(name), "a table of comma-separated values", (".csv", ".txt"))
    for name, path in goals.items():
        if path is not None:
            (page_path if name in ("report", "pdf") else require_writable)(path)
    if goals["pdf"] is not None and goals["pdf"].suffix.lower() != ".pdf":
        raise InputError(f"--pdf must end in .pdf; got {goals['pdf'].name!r}")
    if goals["deviations"] is not None:
        require_suffix(goals["deviations"])


def tell(console: Console, found: Inspected) -> None:
    """Print the alignment, the decision and the characteristics."""
    from dqreg.report.inspection_table import tell_alignment, tell_inspection

    result = found.registration
    tell_alignment(console, result)
    trusted = result.verdict.level == "accepted"
    if found.decision is not None:
        tell_decision(found.decision, found.deviations, console, result)
    if found.sheet is not None and found.sheet.characteristics:
        tell_inspection(console, found.sheet, str(result.settings.get("target_units") or ""), trusted=trusted)


def tell_failed(console: Console, result: Registration) -> None:
    """Print that there is no pose, and why."""
    from dqreg.report import print_summary

    print_summary(console, result)
    say(console, "not inspected: no pose was found")


def write(
    goals: Goals,
    found: Inspected,
    record: dict[str, Any],
    head: dict[str, str],
    console: Console,
    native: Callable[[Registration], Registration],
) -> None:
    """Write all files that were asked for; ``native`` brings a result to the unit of the part's file."""
    from dqreg.files.atomic import write_atomically
    from dqreg.inspection.scanned_part.sections import save_sections
    from dqreg.report.inspection_table import sheet_csv

    shown = found.registration
    unit = str(shown.settings.get("target_units") or "")
    if goals["table"] is not None:
        write_atomically(goals["table"], sheet_csv(found.sheet, found.decision, unit))
    if goals["deviations"] is not None:
        found.deviations.save(goals["deviations"])
    cuts = () if found.sheet is None else found.sheet.sections
    if goals["sections"] is not None and cuts:
        save_sections(goals["sections"], cuts, unit)
    _write_records(goals, shown, record, native)
    _write_pages(
        goals, shown, console, head, deviations=found.deviations, decision=found.decision, inspection=found.sheet
    )
    for name, goal in goals.items():
        if name == "sections" and goal is not None and not cuts:
            _tell_unwritten(goal, "none of the sections could be measured")
        elif goal is not None and goal.exists():
            say(console, f"wrote {goal}")


def write_failed(
    goals: Goals,
    result: Registration,
    record: dict[str, Any],
    head: dict[str, str],
    console: Console,
    native: Callable[[Registration], Registration],
) -> None:
    """Write what can be told of a scan without a pose, and name what cannot: an older file there looks new."""
    _write_records(goals, result, record, native)
    _write_pages(goals, result, console, head)
    for name, goal in goals.items():
        if goal is None or goal == SCREEN:
            continue
        if name not in OF_MEASUREMENTS:
            say(console, f"wrote {goal}")
            continue
        _tell_unwritten(goal, "no pose was found")


def _tell_unwritten(goal: Path, why: str) -> None:
    old = "; the file of that name is of an earlier run" if goal.exists() else ""
    click.echo(f"dqreg: not written: {printable(str(goal))} ({why}{old})", err=True)


def _write_records(
    goals: Goals, result: Registration, record: dict[str, Any], native: Callable[[Registration], Registration]
) -> None:
    """Write the result in the unit of the part's file, and what the screen would be told as JSON."""
    from dqreg.files.atomic import write_atomically

    if goals["out"] is not None:
        native(result).save(goals["out"])
    if goals["as_json"] is not None and goals["as_json"] != SCREEN:
        write_atomically(goals["as_json"], json_text(record))


def _write_pages(goals: Goals, shown: Registration, console: Console, head: dict[str, str], **measured: Any) -> None:
    from dqreg.report.page import to_html
    from dqreg.report.page_file import write_page
    from dqreg.report.report_data import collect

    pages = [path for path in (goals["report"], goals["pdf"]) if path is not None]
    if not pages:
        return
    assert shown.inputs is not None
    with console.status("writing the report"):
        html = to_html(shown, collect(shown, shown.inputs, **measured), measured.get("inspection"), head)
        for path in pages:
            write_page(path, html)


def json_text(record: dict[str, Any]) -> str:
    """A record as a JSON file."""
    import json

    from dqreg.files.strict_json import plain

    return json.dumps(plain(record), indent=1, allow_nan=False) + "\n"


def record_of(found: Inspected, head: dict[str, str]) -> dict[str, Any]:
    """The inspection as plain values."""
    from dqreg.inspection.decision.decision import decision_record

    sheet = found.sheet
    measured = {
        "outcome": found.outcome,
        "alignment": None if sheet is None or sheet.alignment is None else dataclasses.asdict(sheet.alignment),
        "characteristics": [] if sheet is None else [dataclasses.asdict(row) for row in sheet.characteristics],
        "faces": [] if sheet is None else [dataclasses.asdict(face) for face in sheet.faces],
        "decision": None if found.decision is None else decision_record(found.decision, found.deviations.origin),
        "counts": dataclasses.asdict(found.deviations.counts),
        "steps": [] if sheet is None else [dataclasses.asdict(step) for step in sheet.steps],
        "sections": []
        if sheet is None
        else [{"name": name, **dataclasses.asdict(cut)} for name, cut in sheet.sections],
    }
    return record_without_pose(found.registration, {**({} if sheet is None else sheet.plan.head), **head}) | measured


def record_without_pose(result: Registration, head: dict[str, str]) -> dict[str, Any]:
    """The same of a scan that no pose was found for: its verdict, and nothing measured."""
    from dqreg.files.side_digests import DIGESTS, known_digests
    from dqreg.registration.result.result_json import ANGLE_UNITS, CONVENTIONS

    return {
        "verdict": result.verdict,
        "outcome": "undecided",
        "alignment_trusted": result.verdict.level == "accepted",
        "units": result.settings.get("target_units"),
        "angle_units": ANGLE_UNITS,
        "conventions": {
            "T_target_source": CONVENTIONS["T_target_source"],
            "alignment": "covariance: rotation vector x, y, z, then translation x, y, z: of a left increment about its "
            "centre",
            "characteristics": "of the kind angle in degrees, all others lengths",
        },
        "T_target_source": result.T_target_source,
        "alignment": None,
        "head": head,
        "characteristics": [],
        "faces": [],
        "decision": None,
        "counts": None,
        "steps": [],
        "sections": [],
        DIGESTS: known_digests(result.settings),
    }
