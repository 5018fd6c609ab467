"""What is asked of the part of a row beside its pose: a plan, a tolerance, a report."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.files.file_digests import digest_of
from dqreg.inspection.tolerances import Tolerance

if TYPE_CHECKING:
    from dqreg.registration.result.display_unit import ShownTarget
    from dqreg.registration.result.part_inspection import Inspected
    from dqreg.registration.result.result import Registration


@dataclasses.dataclass(frozen=True)
class RowInspection:
    """How the part of a row is inspected."""

    plan: Path | None = None  # An inspection plan
    tolerance: float | Tolerance | None = None  # Largest deviation allowed, or two sides, target units
    required_share: float | None = None  # Share of the points that must be within it; None: the plan's, else 95 %
    report: bool = False  # Whether the row gets a page
    head: tuple[tuple[str, str], ...] = ()  # Fields of the head of that page
    display_units: str | None = None  # Length unit of values and reports; None: the plan's, else the part's

    def __post_init__(self) -> None:
        if isinstance(self.tolerance, (int, float)) and not 0.0 < self.tolerance < float("inf"):
            raise InputError(f"tolerance must be a length above 0, in target units; got {self.tolerance!r}")
        if self.required_share is not None and not 0.0 < self.required_share <= 1.0:
            raise InputError(f"required is a percentage above 0 and at most 100; got {100.0 * self.required_share:g}")

    @property
    def inspects(self) -> bool:
        """Whether the part is inspected at all."""
        return self.plan is not None or self.tolerance is not None

    @property
    def plan_units(self) -> str | None:
        """Length unit that the plan names."""
        from dqreg.inspection import read_plan

        return None if self.plan is None else read_plan(self.plan).units

    def expected(self, shown: ShownTarget) -> dict[str, Any]:
        """Options of the registration that follow from it, in the unit that the target is shown in."""
        from dqreg.inspection import read_plan
        from dqreg.registration.result.part_inspection import expected_deviation_of

        plan = None if self.plan is None else shown.planned(read_plan(self.plan))
        return {"expected_deviation": expected_deviation_of(plan, self.tolerance, shown.units)}

    def mark(self) -> dict[str, Any]:
        """All that the inspection depends on, in plain JSON values."""
        return {
            "plan": None if self.plan is None else digest_of(self.plan),
            "tolerance": [both.low, both.high] if isinstance(both := self.tolerance, Tolerance) else both,
            "required_share": self.required_share,
            "report": self.report,
            "head": dict(self.head),
            **({} if self.display_units is None else {"display_units": self.display_units}),
        }


def inspect_row(
    result: Registration, asked: RowInspection, shown: ShownTarget
) -> tuple[dict[str, Any] | None, str | None]:
    """The record of an inspection and the page of the row; None where nothing of it was asked."""
    import numpy as np

    from dqreg.inspection import read_plan
    from dqreg.registration.result.part_inspection import inspect_registration

    record, found = None, None
    if asked.inspects and np.isfinite(result.T_target_source).all():
        plan = None if asked.plan is None else shown.planned(read_plan(asked.plan))
        try:
            found = inspect_registration(result, plan, asked.tolerance, required_share=asked.required_share)
            record = found.record()
        except DegenerateGeometryError as error:
            # The pose is kept: what could not be measured is said.
            record = {"outcome": "undecided", "units": None, "values": [], "error": str(error)}
    elif asked.inspects:
        record = {"outcome": "undecided", "units": None, "values": [], "error": "no pose was found"}
    if not asked.report:
        return record, None
    return record, _page(result, asked, found)


def _page(result: Registration, asked: RowInspection, found: Inspected | None) -> str:
    from dqreg.report.page import to_html
    from dqreg.report.report_data import collect

    if found is None:
        assert result.inputs is not None
        return to_html(result, collect(result, result.inputs), None, dict(asked.head))
    shown, sheet = found.registration, found.sheet
    assert shown.inputs is not None
    data = collect(shown, shown.inputs, deviations=found.deviations, decision=found.decision, inspection=sheet)
    return to_html(shown, data, sheet, dict(asked.head))
