"""Trends over the parts of a batch: each measured value with its mean, spread, capability and control chart."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg.files.csv_text import csv_text
from dqreg.inspection.plan.characteristics import ZONES
from dqreg.registration.batch.excluded_parts import LeftOut, left_out_of, withheld_words
from dqreg.registration.batch.trend_values import drawing_words, followed, key_of, unit_of, values_of
from dqreg.report.control_chart import Sample, control_chart
from dqreg.report.text import decimals_of

if TYPE_CHECKING:
    from dqreg.registration.batch.line import Line
    from dqreg.registration.batch.trend_values import Row

# Moving range of two normal values: 1.128 sigma on average; control limits are three sigma.
MOVING = 3.0 / 1.128
VALUE_NUMBERS = ("nominal", "low", "high", "value", "uncertainty")
VALUE_COLUMNS = ("row", "verdict", "part", "number", "name", "kind", "unit", *VALUE_NUMBERS, "outcome", "remark")
TREND_COLUMNS = ("number", "name", "unit", "low", "high", "parts", "mean", "spread", "smallest", "largest", "cp", "cpk",
                 "control_low", "control_high", "pass", "undecided", "fail",
                 "unmeasured", "left_out", "left_out_parts", "remark", "target")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Trend:
    """One measured value over the parts of a batch, in the order of the manifest."""

    number: int  # Its place among the values of a part, from 1
    name: str
    unit: str
    # low, high: Limits of the value; NaN where there is none
    low: float
    high: float
    is_zone: bool  # Whether only the upper limit can be violated
    samples: tuple[Sample, ...]
    unmeasured: int  # Parts on which it could not be measured
    left_out: tuple[LeftOut, ...] = ()  # Parts whose value is not counted
    target: str = ""  # What its drawing is called; "" where a batch has one

    @property
    def parts(self) -> int:
        """All parts that were to be measured."""
        return len(self.samples) + self.unmeasured + len(self.left_out)

    @property
    def withheld(self) -> str:
        """Why there are no capability indices and control limits; "" where there are."""
        return withheld_words(self.left_out, self.parts)

    @property
    def values(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """The values alone."""
        return np.array([sample.value for sample in self.samples])

    @property
    def mean(self) -> float:
        """Mean over the parts."""
        return float(self.values.mean()) if self.samples else math.nan

    @property
    def spread(self) -> float:
        """Standard deviation over the parts."""
        return float(self.values.std(ddof=1)) if len(self.samples) > 1 else math.nan

    @property
    def control(self) -> tuple[float, float]:
        """Limits of an individuals chart: mean and 2.66 mean moving ranges."""
        told = len(self.samples) > 1 and not self.withheld
        room = MOVING * float(np.abs(np.diff(self.values)).mean()) if told else math.nan
        return self.mean - room, self.mean + room

    @property
    def cp(self) -> float:
        """Width of the tolerance in six standard deviations; NaN for a value with one limit, and where withheld."""
        return math.nan if self.is_zone or self.withheld else _ratio(self.high - self.low, 6.0 * self.spread)

    @property
    def cpk(self) -> float:
        """Distance of the mean from the nearer limit in three standard deviations; NaN where withheld."""
        gaps = [self.high - self.mean, *([] if self.is_zone else [self.mean - self.low])]
        known = [gap for gap in gaps if math.isfinite(gap)]
        return _ratio(min(known), 3.0 * self.spread) if known and not self.withheld else math.nan


def _ratio(gap: float, width: float) -> float:
    if not (math.isfinite(gap) and math.isfinite(width)):
        return math.nan
    return gap / width if width > 0.0 else math.copysign(math.inf, gap)


def trends_of(lines: Sequence[Line]) -> tuple[Trend, ...]:
    """A trend for every value that two parts or more have in common: the same of one drawing, unit and limits.

    Parts whose alignment is not trusted are left out, for their values may be of another pose, and named; so is what is
    no number in a kept file.
    """
    asked = [line for line in lines if line.row.asked.inspects]
    silent = [line for line in asked if not (line.inspection or {}).get("values")]
    found: dict[tuple[object, ...], list[Row]] = {}
    for row in values_of(asked):
        found.setdefault(key_of(row), []).append(row)
    order, drawings = {id(line): k for k, line in enumerate(lines)}, drawing_words(asked)
    trends: dict[object, list[Trend]] = {drawing: [] for drawing in drawings}
    for rows in map(followed, found.values()):
        if len(rows) > 1:
            kinds, drawing = {_asked(line) for line, _, _ in rows}, rows[0][0].drawing
            missing = [(line, 0, None) for line in silent if _asked(line) in kinds]
            trend = _trend(sorted([*rows, *missing], key=lambda row: order[id(row[0])]), rows[0])
            trends[drawing].append(dataclasses.replace(trend, target=drawings[drawing]))
    return tuple(trend for each in trends.values() for trend in sorted(each, key=lambda trend: trend.number))


def _asked(line: Line) -> tuple[object, ...]:
    return *line.drawing, line.row.asked.tolerance


def _trend(rows: Sequence[tuple[Line, int, dict[str, Any] | None]], measured: Row) -> Trend:
    """The trend of all parts that were to be measured, the first that was among them."""
    samples: list[Sample] = []
    left_out: list[LeftOut] = []
    for line, _, value in rows:
        if value is None or line.verdict != "accepted" or not math.isnan(line.scale):
            left_out.append(left_out_of(line, len(samples), value))
        elif value["value"] is not None:
            numbers = float(value["value"]), _number(value["uncertainty"])
            samples.append(Sample(line.row.shown, line.link, *numbers, str(value["outcome"])))
    line, number, first = measured
    return Trend(
        number,
        str(first["name"]),
        unit_of(line, first),
        _number(first["low"]),
        _number(first["high"]),
        first["kind"] in ZONES,
        tuple(samples),
        len(rows) - len(samples) - len(left_out),
        tuple(left_out),
    )


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def values_csv(lines: Sequence[Line]) -> str:
    """Every value of every part as CSV, one a line."""
    rows = (
        (
            *(line.row.shown, line.verdict, line.part, number, value["name"], value["kind"], unit_of(line, value)),
            *("" if value[name] is None else value[name] for name in VALUE_NUMBERS),
            *(value["outcome"], value["remark"]),
        )
        for line, number, value in values_of(lines)
    )
    return csv_text(VALUE_COLUMNS, rows)


def trends_csv(trends: Sequence[Trend]) -> str:
    """The trends as CSV, one a line."""
    return csv_text(TREND_COLUMNS, map(_row, trends))


def _row(trend: Trend) -> list[object]:
    values = trend.values
    ends = (float(values.min()), float(values.max())) if len(values) else (math.nan, math.nan)
    counts = [sum(sample.outcome == outcome for sample in trend.samples) for outcome in ("pass", "undecided", "fail")]
    numbers = (trend.mean, trend.spread, *ends, trend.cp, trend.cpk, *trend.control)
    limits = ("" if math.isnan(x) else x for x in (trend.low, trend.high))
    shown = ("" if math.isnan(x) else repr(x) for x in numbers)
    left_out = "; ".join(each.words for each in trend.left_out)
    missing = (trend.unmeasured, len(trend.left_out), left_out, trend.withheld, trend.target)
    return [trend.number, trend.name, trend.unit, *limits, len(values), *shown, *counts, *missing]


def trend_records(trends: Sequence[Trend]) -> list[dict[str, Any]]:
    """The trends as plain values, with the parts that each leaves out."""
    names = (
        "number",
        "name",
        "target",
        "unit",
        "low",
        "high",
        "parts",
        "mean",
        "spread",
        "cp",
        "cpk",
        "control",
        "unmeasured",
    )
    return [
        {
            **{name: getattr(trend, name) for name in names},
            "measured": len(trend.samples),
            "withheld": trend.withheld or None,
            "left_out": [
                {**dataclasses.asdict(each), "may_be_its_shape": each.may_be_its_shape} for each in trend.left_out
            ],
        }
        for trend in trends
    ]


def trends_on_page(trends: Sequence[Trend]) -> list[dict[str, Any]]:
    """The trends for the page's template: figures as text, and a chart."""
    return [
        {
            "number": trend.number,
            "name": trend.name,
            "target": trend.target,
            "unit": trend.unit,
            "parts": len(trend.samples),
            "all": trend.parts,
            "unmeasured": trend.unmeasured,
            "left_out": trend.left_out,
            "withheld": trend.withheld,
            "figures": _figures(trend),
            "out": sum(sample.outcome == "fail" for sample in trend.samples),
            "out_left_out": sum(each.outcome == "fail" for each in trend.left_out),
            "chart": _chart(trend),
        }
        for trend in trends
    ]


def _chart(trend: Trend) -> str:
    from markupsafe import Markup

    if not trend.samples:
        return ""
    limits, gaps = (trend.low, trend.high), [(each.before, each.words, each.link) for each in trend.left_out]
    # Of numbers and escaped words.
    return Markup(control_chart(trend.name, trend.unit, trend.samples, trend.mean, trend.control, limits, gaps))


def _figures(trend: Trend) -> list[str]:
    """Limits, mean, spread, Cp and Cpk as text; the mean with the digits that its spread and uncertainty leave it."""
    known = [sample.uncertainty for sample in trend.samples if math.isfinite(sample.uncertainty)]
    decimals = decimals_of(max([*known, trend.spread if math.isfinite(trend.spread) else 0.0], default=0.0))
    values = [_text(x) if math.isnan(x) else f"{x:.{decimals}f}".replace("-", "−") for x in (trend.mean, trend.spread)]
    return [_text(trend.low), _text(trend.high), *values, _index(trend.cp), _index(trend.cpk)]


def _index(value: float) -> str:
    if not math.isfinite(value):
        return "–"
    return "> 100" if value > 100.0 else f"{value:.2f}".replace("-", "−")


def _text(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.6g}".replace("-", "−")
