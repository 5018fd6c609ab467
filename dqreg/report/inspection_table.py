"""The characteristics of an inspection as a table, on the screen and on the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dqreg.files.csv_text import csv_text
from dqreg.inspection import Characteristic, DatumAlignment, Decision, Inspection
from dqreg.inspection.decision.places import COVERAGE_FACTOR, PLACE_POINTS
from dqreg.report.decision_rows import SCALE_WORDS, Cause, decision_rows, shown_outcome
from dqreg.report.hints import hints_of
from dqreg.report.summary import ALIGNMENT, COLOURS
from dqreg.report.table import EMPTY, Column, Table, print_tables
from dqreg.report.text import measured_text

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.report.result_protocol import RegistrationResult

OUTCOME_COLOURS = {"pass": "green", "conditional": "yellow", "undecided": "yellow", "fail": "red"}
BEST_FIT = "best fit of the scan"


def characteristics_table(found: Inspection, unit: str) -> Table:
    """One row a characteristic; angles are in degrees, all else in the part's unit."""
    columns = (
        Column("no."),
        Column("characteristic"),
        Column("kind"),
        Column("nominal", spec=".6g"),
        Column("low", spec=".6g"),
        Column("high", spec=".6g"),
        Column("measured", align="right"),
        Column("U (k=2)", align="right"),
        Column("decision"),
        Column("points"),
        Column("scanned", "%", ".3g"),
    )
    rows = tuple(
        (
            str(k + 1),
            row.name,
            kind_words(row),
            row.nominal,
            row.low,
            row.high,
            *(text.replace("−", "-").replace("–", EMPTY) for text in measured_text(row.value, row.uncertainty)),
            row.outcome if row.measured else "not measured",
            row.points,
            100.0 * row.coverage,
        )
        for k, row in enumerate(found.characteristics)
    )
    missing = [f"{k + 1} {row.name}: {row.remark}" for k, row in enumerate(found.characteristics) if row.remark]
    note = f"Lengths in {unit or 'units of the part'}, angles in degrees; aligned to: {frame_words(found)}."
    note = "\n".join([note, *scale_words(found), *missing])
    return Table("characteristics", "Characteristics", columns, rows, note)


def scale_words(found: Inspection) -> list[str]:
    """Why no length passes, of a scan that was scaled to fit."""
    return [SCALE_WORDS] if found.deviations is not None and found.deviations.scale_solved else []


def kind_words(row: Characteristic) -> str:
    """The kind of a characteristic, and how its features are fitted where that is not by least squares."""
    return row.kind if row.fit == "gauss" else f"{row.kind} ({row.fit})"


def sheet_csv(found: Inspection | None, decision: Decision | None, unit: str) -> str:
    """What was measured as CSV, one line each: characteristics, then the deviations of the part and of its regions."""
    columns = ("no.", "characteristic", "kind", "unit", "nominal", "low", "high", "measured", "U (k=2)", "decision",
               "points", "scanned [%]", "remark", "decided by", "deciding value", "deciding low",
               "deciding high")  # fmt: skip
    rows: list[tuple[object, ...]] = []
    for k, row in enumerate([] if found is None else found.characteristics):
        of = "degree" if row.kind == "angle" else unit
        outcome = row.outcome if row.measured else "not measured"
        cells = _cells(row.nominal, row.low, row.high, row.value, row.uncertainty)
        scanned_share = "" if math.isnan(row.coverage) else f"{100.0 * row.coverage:.3g}"
        rows.append((k + 1, row.name, kind_words(row), of, *cells, outcome, row.points, scanned_share, row.remark))
    for name, cut in [] if found is None else found.sections:
        scanned = np.flatnonzero(np.isfinite(cut.values))
        order = scanned[np.argsort(cut.values[scanned])]
        for words, extreme in (("smallest", order[:1]), ("largest", order[-1:])):
            for at in extreme.tolist():
                cells = _cells(0.0, math.nan, math.nan, float(cut.values[at]), COVERAGE_FACTOR * float(cut.sigma[at]))
                label = f"section {name}: {words} deviation"
                rows.append((len(rows) + 1, label, "section", unit, *cells, "", int(cut.points[at]),
                             f"{100.0 * cut.coverage:.3g}", ""))  # fmt: skip
    if decision is not None:
        for value in decision_rows(decision):
            cells = _cells(value.nominal, value.low, value.high, value.value, value.uncertainty)
            of = "%" if value.kind == "share" else unit
            points = "" if value.points is None else value.points
            # The share is of all that was scanned: how much of the part that is.
            seen = f"{100.0 * decision.scanned:.3g}" if value.kind == "share" and decision.scanned >= 0.0 else ""
            last = (value.outcome, points, seen, value.remark, *_cause_cells(value.cause))
            rows.append((len(rows) + 1, value.name, value.kind, of, *cells, *last))
        ends = {region.number: (region.low, region.high) for region in decision.regions}
        for place in decision.places:
            name = "place at " + " ".join(f"{x:.7g}" for x in place.position)
            cells = _cells(0.0, *ends.get(place.region, (decision.low, decision.high)), place.value, place.uncertainty)
            rows.append((len(rows) + 1, name, "deviation", unit, *cells, place.outcome, PLACE_POINTS, "", ""))
    return csv_text(columns, (row + ("",) * (len(columns) - len(row)) for row in rows))


def _cause_cells(cause: Cause | None) -> list[str]:
    return [] if cause is None else [cause.name, *_cells(cause.value, cause.low, cause.high)]


def _cells(*numbers: float) -> list[str]:
    return [f"{number + 0.0:.7g}" if math.isfinite(number) else "" for number in numbers]


def frame_words(found: Inspection) -> str:
    """What the values are aligned to."""
    if found.alignment is None:
        asked = found.plan.alignment != "best-fit"
        return f"{BEST_FIT}: the alignment of the plan was not measured" if asked else BEST_FIT
    if len(found.steps) > 1 or not isinstance(found.alignment, DatumAlignment):
        return ", then ".join(step.name for step in found.steps)
    return "datums " + " | ".join(found.alignment.constrained)


def tell_alignment(console: Console, result: RegistrationResult) -> None:
    """Print whether the alignment can be trusted, why, and what to try."""
    level = result.verdict.level
    console.print(f"[bold {COLOURS[level]}]{level.upper()}[/]: alignment {ALIGNMENT[level]}", highlight=False)
    for reason in result.verdict.reasons:
        console.print(f"  {reason}", highlight=False, markup=False, soft_wrap=True)
    for hint in hints_of(result):
        console.print(f"  try: {hint}", highlight=False, markup=False, soft_wrap=True)


def outcome_markup(outcome: str, *, trusted: bool) -> str:
    """An outcome in its colour for the screen.

    >>> outcome_markup("pass", trusted=False)
    '[bold yellow]PASS, IF THE ALIGNMENT HOLDS[/]'
    """
    shown = shown_outcome(outcome, trusted=trusted)
    return f"[bold {OUTCOME_COLOURS[shown['kind']]}]{shown['said'].upper()}[/]"


def tell_inspection(console: Console, found: Inspection, unit: str, *, trusted: bool) -> None:
    """Print the decision and the table."""
    console.print(f"{outcome_markup(found.outcome, trusted=trusted)}: part by its plan", highlight=False)
    if found.characteristics:
        print_tables(console, [characteristics_table(found, unit)])
