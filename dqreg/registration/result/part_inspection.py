"""A registration inspected: its plan carried out, its tolerance decided, and both as plain values for files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from dqreg.inspection import Characteristic, Decision, Deviations, Inspection, Plan, decide, inspect
from dqreg.inspection.decision.decision import worst_of
from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.plan.in_unit import plan_in
from dqreg.inspection.tolerances import REQUIRED_SHARE, Tolerance, limits_at, tolerance_of
from dqreg.registration.result.result import Registration
from dqreg.report.decision_rows import DecisionRow, decision_rows

# Fields of one measured value in a file.
WORDS, NUMBERS = ("name", "kind", "outcome", "remark"), ("nominal", "low", "high", "value", "uncertainty")


# A part that is out of tolerance by as much again as it allows is that part still.
EXPECTED_TOLERANCES = 2.0


def expected_deviation_of(
    plan: Plan | None, tolerance: float | Tolerance | None, unit: str | None, given: float | None = None
) -> float | None:
    """Deviation of the part to expect where a plan, and a tolerance in a unit, allow some; None where nothing is said.

    What a caller gives wins, then what the plan says; else it is twice the largest deviation that is allowed anywhere.
    """
    if given is not None:
        return given
    planned = None if plan is None else plan_in(plan, unit)
    if planned is not None and planned.expected_deviation is not None:
        return planned.expected_deviation
    most = 0.0 if tolerance is None else tolerance_of(tolerance).size
    if planned is not None:
        most = max(most, planned.largest_deviation)
    return EXPECTED_TOLERANCES * most or None


@dataclasses.dataclass(frozen=True, eq=False)
class Inspected:
    """What a registered scan says of its part."""

    registration: Registration  # Under the pose that the values are of: the datums' where a plan asks for them
    deviations: Deviations  # Under that pose
    sheet: Inspection | None  # The plan carried out; None without one
    decision: Decision | None  # On the tolerance; None without one

    @property
    def outcome(self) -> Outcome:
        """The worst of the plan and the tolerance."""
        return worst_of([part.outcome for part in (self.sheet, self.decision) if part is not None])

    def record(self) -> dict[str, Any]:
        """The same for a file: outcome, and every measured value with its limits."""
        values = [] if self.sheet is None else [_of_characteristic(row) for row in self.sheet.characteristics]
        if self.decision is not None:
            values += _of_decision(self.decision)
        return {
            "outcome": self.outcome,
            "units": self.registration.settings.get("target_units"),
            "values": values,
            "figures": self._figures(),
        }

    def _figures(self) -> dict[str, float | None]:
        """What a line of a summary has room for: a length, and two shares of a decision."""
        found = self.decision if self.sheet is None else self.sheet.decision
        numbers = {
            "p95": self.deviations.summary().p95,
            "share_within": math.nan if found is None else found.share_within,
            "scanned": math.nan if found is None else found.scanned,
        }
        return {name: _plain(number) for name, number in numbers.items()}


def inspect_registration(
    result: Registration,
    plan: Plan | None = None,
    tolerance: float | Tolerance | None = None,
    *,
    required_share: float | None = None,
    reach: float | None = None,
    keep: bool = False,
    exclude: Sequence[Sequence[float]] = (),
) -> Inspected:
    """Measure a registered scan by a plan, against a tolerance (it wins over the plan's), or both."""
    allowed = None if tolerance is None else tolerance_of(tolerance)
    deviations = deviations_within(result, allowed, reach=reach, keep=keep, exclude=exclude)
    if plan is None:
        decision = None if allowed is None else decide(deviations, allowed, required_share or REQUIRED_SHARE)
        return Inspected(result, deviations, None, decision)
    sheet = inspect(deviations, _with(plan_in(plan, result.settings.get("target_units")), allowed, required_share))
    assert sheet.deviations is not None
    return Inspected(aligned_to(result, sheet), sheet.deviations, sheet, sheet.decision)


def deviations_within(result: Registration, tolerance: Tolerance | None, **options: Any) -> Deviations:
    """Deviations with the tolerance that they are held against; why there are no signs stands in them."""
    found = result._deviations(None if tolerance is None else tolerance.size, **options)
    if tolerance is None or tolerance.equal:
        return found
    limits = limits_at(np.zeros(len(found), dtype=np.int64), tolerance, {})
    return dataclasses.replace(found, allowed=limits)


def _with(plan: Plan, tolerance: Tolerance | None, required_share: float | None) -> Plan:
    """The plan with a tolerance or a required share of the caller."""
    whole = plan.tolerance if tolerance is None else tolerance
    if whole is not None and required_share is not None:
        whole = dataclasses.replace(whole, required_share=required_share)
    return dataclasses.replace(plan, tolerance=whole)


def aligned_to(result: Registration, sheet: Inspection | None) -> Registration:
    """The registration under the plan's alignment, with its covariance; unchanged for the best fit."""
    if sheet is None or sheet.alignment is None:
        return result
    return result.aligned(sheet.alignment, ", then ".join(step.name for step in sheet.steps))


def require_record(record: Any) -> None:
    """Raise `ValueError`, `KeyError` or `TypeError` unless a value from a file is what `Inspected.record` writes."""
    if record["outcome"] not in get_args(Outcome):
        raise ValueError("no outcome")
    for row in record["values"]:
        if not all(row[name] is None or isinstance(row[name], int | float) for name in NUMBERS):
            raise TypeError("no number")
        if not all(isinstance(row[name], str) for name in WORDS):
            raise TypeError("no word")
    # Files of old have none.
    figures = record.get("figures", {})
    if not isinstance(figures, dict) or not all(x is None or isinstance(x, int | float) for x in figures.values()):
        raise TypeError("no figures")


def _of_characteristic(row: Characteristic | DecisionRow) -> dict[str, Any]:
    return {name: _plain(getattr(row, name)) for name in (*WORDS, *NUMBERS)}


def _of_decision(found: Decision) -> list[dict[str, Any]]:
    """Share, and the median of each region: what a trend over many parts shows."""
    return [_of_characteristic(row) for row in decision_rows(found) if row.outcome]


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
