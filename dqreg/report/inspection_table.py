"""The characteristics of an inspection as a table, on the screen and on the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from dqreg.inspection import DatumAlignment, Inspection
from dqreg.report.summary import ALIGNMENT, COLOURS
from dqreg.report.table import Column, Table, print_tables

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
            row.outcome if row.measured else "not measured",
            row.points,
            100.0 * row.coverage,
        )
        for k, row in enumerate(found.characteristics)
    )
    missing = [f"{k + 1} {row.name}: {row.remark}" for k, row in enumerate(found.characteristics) if row.remark]
    note = f"Lengths in {unit or 'units of the part'}, angles in degrees; aligned to: {frame_words(found)}."
    note = "\n".join([note, *missing])
    return Table("characteristics", "Characteristics", columns, rows, note)


def frame_words(found: Inspection) -> str:
    """What the values are aligned to."""
    if found.alignment is None:
        return FRAMES["best-fit"]
    if len(found.steps) > 1 or not isinstance(found.alignment, DatumAlignment):
        return ", then ".join(step.name for step in found.steps)
    return "datums " + " | ".join(found.alignment.constrained)


def tell_alignment(console: Console, result: RegistrationResult) -> None:
    """Print whether the alignment can be trusted, and why."""
    level = result.verdict.level
    console.print(f"[bold {COLOURS[level]}]{level.upper()}[/]: alignment {ALIGNMENT[level]}", highlight=False)
    for reason in result.verdict.reasons:
        console.print(f"  {reason}", highlight=False, markup=False, soft_wrap=True)


def tell_inspection(console: Console, found: Inspection, unit: str) -> None:
    """Print the decision and the table."""
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
