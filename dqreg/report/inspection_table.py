"""The characteristics of an inspection as a table, on the screen and on the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from dqreg.inspection import Inspection
from dqreg.report.summary import ALIGNMENT, COLOURS
from dqreg.report.table import Column, Table, print_tables
from dqreg.report.text import percent, text_of

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.report.result_protocol import RegistrationResult

OUTCOME_COLOURS = {"pass": "green", "undecided": "yellow", "fail": "red"}
FRAMES = {"best-fit": "best fit of the scan", "datums": "datums"}


def characteristics_table(found: Inspection, unit: str) -> Table:
    """One row a characteristic; angles are in degrees, all else in the part's unit."""
    columns = (
        Column("no."),
        Column("characteristic"),
        Column("kind"),
        Column("nominal", spec=".6g"),
        Column("low", spec=".6g"),
        Column("high", spec=".6g"),
        Column("measured", spec=".6g"),
        Column("U (k=2)", spec=".2g"),
        Column("decision"),
        Column("points"),
        Column("scanned", "%", ".3g"),
    )
    rows = tuple(
        (
            str(k + 1),
            row.name,
            row.kind,
            row.nominal,
            row.low,
            row.high,
            row.value,
            row.uncertainty,
            row.outcome,
            row.points,
            100.0 * row.coverage,
        )
        for k, row in enumerate(found.characteristics)
    )
    note = f"Lengths in {unit or 'units of the part'}, angles in degrees; aligned to: {frame_words(found)}."
    return Table("characteristics", "Characteristics", columns, rows, note)


def frame_words(found: Inspection) -> str:
    """What the values are aligned to."""
    if found.alignment is None:
        return FRAMES["best-fit"]
    return "datums " + " | ".join(found.alignment.constrained)


def tell_inspection(console: Console, result: RegistrationResult, found: Inspection, unit: str) -> None:
    """Print both lines and the table."""
    level = result.verdict.level
    console.print(f"[bold {COLOURS[level]}]{level.upper()}[/]: alignment {ALIGNMENT[level]}", highlight=False)
    for reason in result.verdict.reasons:
        console.print(f"  {reason}", highlight=False, markup=False, soft_wrap=True)
    colour = OUTCOME_COLOURS[found.outcome]
    console.print(f"[bold {colour}]{found.outcome.upper()}[/]: part by its plan", highlight=False)
    print_tables(console, [characteristics_table(found, unit)])


def decimals_of(uncertainty: float) -> int:
    """Decimals that a value of that uncertainty has: down to its second digit.

    >>> decimals_of(0.0123), decimals_of(0.9), decimals_of(0.0)
    (3, 2, 6)
    """
    if not 0.0 < uncertainty < math.inf:
        return 6
    return max(0, 1 - math.floor(math.log10(uncertainty)))


def inspection_of(found: Inspection | None, unit: str) -> dict[str, Any] | None:
    """The same for the page's template."""
    if found is None:
        return None
    signs = {"pass": "✓", "undecided": "?", "fail": "✗"}
    rows = [
        {
            "cells": [str(k + 1), row.name, row.kind],
            "numbers": [
                *(text_of(x, 6) for x in (row.nominal, row.low, row.high)),
                f"{row.value:.{decimals_of(row.uncertainty)}f}".replace("-", "−"),
                text_of(row.uncertainty, 2),
                percent(row.coverage),
            ],
            "outcome": row.outcome,
            "sign": signs[row.outcome],
        }
        for k, row in enumerate(found.characteristics)
    ]
    heads = [("No.", "", False), ("Characteristic", "", False), ("Kind", "", False), ("Nominal", "", True),
             ("Low", "", True), ("High", "", True), ("Measured", "", True), ("U", "k = 2", True),
             ("Scanned", "%", True), ("Decision", "", False)]  # fmt: skip
    count = sum(row.outcome == "pass" for row in found.characteristics)
    return {
        "outcome": found.outcome,
        "sign": signs[found.outcome],
        "words": f"{count} of {len(found.characteristics)} characteristics pass; aligned to {frame_words(found)}.",
        "columns": heads,
        "rows": rows,
        "head": [(key, value) for key, value in found.plan.head.items() if value],
        "unit": unit,
    }
