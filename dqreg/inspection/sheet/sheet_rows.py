"""Rows of a sheet: characteristics of the drawing, and what of a plan could not be carried out."""

from __future__ import annotations

import dataclasses
import math

from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.drawing.characteristics import Measured
from dqreg.inspection.plan.characteristics import ZONES, PlannedCharacteristic


@dataclasses.dataclass(frozen=True)
class Characteristic:
    """One measured line of the drawing.

    Attributes
    ----------
    name, kind : str
        As in the plan.
    faces : tuple of int
        Numbers of its faces.
    nominal : float
        From the plan or the part; 0 for zones.
    low, high : float
        Limits of the value.
    value, uncertainty : float
        Measured, and expanded (k = 2): a length, or degrees for angles; NaN where it could not be measured.
    outcome : {"pass", "fail", "undecided"}
        By ISO 14253-1; undecided where it could not be measured.
    points : int
        Scan points that it rests on.
    coverage : float
        Share of its faces' area that was scanned, in the least of them; NaN where it is not of this part.
    position : tuple of three float
        Where it is on the part, in the caller's target frame: for a label.
    remark : str
        Why it could not be measured; empty where it was.
    fit : {"gauss", "minimum-zone", "inscribed", "circumscribed"}
        How its features were fitted.
    """

    name: str
    kind: str
    faces: tuple[int, ...]
    nominal: float
    low: float
    high: float
    value: float
    uncertainty: float
    outcome: Outcome
    points: int
    coverage: float
    position: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    remark: str = ""
    fit: str = "gauss"

    @property
    def measured(self) -> bool:
        """Whether there is a value."""
        return not self.remark


def refused_row(name: str, kind: str, error: Exception | str) -> Characteristic:
    """What could not be measured, and why: it is undecided, and costs no other row of the sheet."""
    remark = str(error.__cause__ or error) if isinstance(error, Exception) else error
    return Characteristic(
        name=name,
        kind=kind,
        faces=(),
        nominal=math.nan,
        low=math.nan,
        high=math.nan,
        value=math.nan,
        uncertainty=math.nan,
        outcome="undecided",
        points=0,
        coverage=math.nan,
        remark=remark,
    )


def refused_characteristic(row: PlannedCharacteristic, error: Exception) -> Characteristic:
    """The same of a characteristic, with the limits that the plan gives it."""
    nominal = math.nan if row.nominal is None else row.nominal
    low, high = limits_of(row, nominal)
    found = refused_row(row.name, row.kind, error)
    return dataclasses.replace(found, nominal=nominal, low=low, high=high, fit=row.fit)


def limits_of(row: PlannedCharacteristic, nominal: float) -> tuple[float, float]:
    """Limits of the value of a characteristic."""
    return (0.0, row.plus) if row.kind in ZONES else (nominal - row.minus, nominal + row.plus)


def outcome_of(row: PlannedCharacteristic, found: Measured, nominal: float, *, scaled: bool) -> Outcome:
    """The decision on a measured value; of a scan that was scaled to fit, no length can pass."""
    low, high = limits_of(row, nominal)
    # A zone's width is never below zero: its lower limit cannot be violated.
    outcome: Outcome = found.decide(-math.inf if row.kind in ZONES else low, high)
    return "undecided" if scaled and row.kind != "angle" and outcome == "pass" else outcome
