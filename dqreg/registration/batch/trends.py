"""Trends over the parts of a batch: each measured value with its mean, spread, capability and control chart."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg.report.control_chart import Sample, control_chart
from dqreg.report.table import to_csv
from dqreg.report.text import decimals_of

if TYPE_CHECKING:
    from dqreg.registration.batch.line import Line

# Moving range of two normal values: 1.128 sigma on average; control limits are three sigma.
MOVING = 3.0 / 1.128
VALUE_NUMBERS = ("nominal", "low", "high", "value", "uncertainty")
VALUE_COLUMNS = ("row", "verdict", "part", "number", "name", "kind", "unit", *VALUE_NUMBERS, "outcome", "remark")
TREND_COLUMNS = ("number", "name", "unit", "low", "high", "parts", "mean", "spread", "smallest", "largest", "cp", "cpk",
                 "control_low", "control_high", "pass", "undecided", "fail")  # fmt: skip


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
        room = MOVING * float(np.abs(np.diff(self.values)).mean()) if len(self.samples) > 1 else math.nan
        return self.mean - room, self.mean + room

    @property
    def cp(self) -> float:
        """Width of the tolerance in six standard deviations; NaN for a value with one limit."""
        return _ratio(self.high - self.low, 6.0 * self.spread) if not self.is_zone else math.nan

    @property
    def cpk(self) -> float:
        """Distance of the mean from the nearer limit in three standard deviations."""
        gaps = [self.high - self.mean, *([] if self.is_zone else [self.mean - self.low])]
        known = [gap for gap in gaps if math.isfinite(gap)]
        return _ratio(min(known), 3.0 * self.spread) if known else math.nan


def _ratio(gap: float, width: float) -> float:
    if not (math.isfinite(gap) and math.isfinite(width)):
        return math.nan
    return gap / width if width > 0.0 else math.copysign(math.inf, gap)


def trends_of(lines: Sequence[Line]) -> tuple[Trend, ...]:
    """A trend for every value that two parts or more have in common: the same name and limits.

    Parts whose alignment is not trusted are left out, for their values may be of another pose; so is what is no number
    in a kept file.
    """
    found: dict[tuple[Any, ...], list[tuple[int, Line, dict[str, Any]]]] = {}
    for line, number, value in _values([line for line in lines if line.verdict == "accepted"]):
        key = (str(value["name"]), str(value["kind"]), value["low"], value["high"])
        found.setdefault(key, []).append((number, line, value))
    trends = [_trend(rows) for rows in found.values() if len(rows) > 1]
    return tuple(sorted(trends, key=lambda trend: trend.number))


def _trend(rows: list[tuple[int, Line, dict[str, Any]]]) -> Trend:
    number, line, first = rows[0]
    samples = tuple(
        Sample(line.row.shown, line.link, float(value["value"]), _number(value["uncertainty"]), str(value["outcome"]))
        for _, line, value in rows
        if value["value"] is not None
    )
    unit = _unit(line, first)
    zone = first["kind"] != "deviation" and first["low"] == 0.0 and first["nominal"] == 0.0
    missing = len(rows) - len(samples)
    return Trend(
        number, str(first["name"]), unit, _number(first["low"]), _number(first["high"]), zone, samples, missing
    )


def _values(lines: Sequence[Line]) -> Iterator[tuple[Line, int, dict[str, Any]]]:
    for line in lines:
        if line.inspection is not None:
            for number, value in enumerate(line.inspection["values"], 1):
                yield line, number, value


def _unit(line: Line, value: dict[str, Any]) -> str:
    assert line.inspection is not None
    return {"angle": "degree", "share": "%"}.get(str(value["kind"]), str(line.inspection["units"] or ""))


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def values_csv(lines: Sequence[Line]) -> str:
    """Every value of every part as CSV, one a line."""
    rows = (
        (
            *(line.row.shown, line.verdict, line.part, number, value["name"], value["kind"], _unit(line, value)),
            *("" if value[name] is None else value[name] for name in VALUE_NUMBERS),
            *(value["outcome"], value["remark"]),
        )
        for line, number, value in _values(lines)
    )
    return to_csv(VALUE_COLUMNS, rows)


def trends_csv(trends: Sequence[Trend]) -> str:
    """The trends as CSV, one a line."""
    return to_csv(TREND_COLUMNS, map(_row, trends))


def _row(trend: Trend) -> list[object]:
    values = trend.values
    ends = (float(values.min()), float(values.max())) if len(values) else (math.nan, math.nan)
    counts = [sum(sample.outcome == outcome for sample in trend.samples) for outcome in ("pass", "undecided", "fail")]
    numbers = (trend.mean, trend.spread, *ends, trend.cp, trend.cpk, *trend.control)
    limits = ("" if math.isnan(x) else x for x in (trend.low, trend.high))
    shown = ("" if math.isnan(x) else repr(x) for x in numbers)
    return [trend.number, trend.name, trend.unit, *limits, len(values), *shown, *counts]


def trends_on_page(trends: Sequence[Trend]) -> list[dict[str, Any]]:
    """The trends for the page's template: figures as text, and a chart."""
    from markupsafe import Markup

    return [
        {
            "number": trend.number,
            "name": trend.name,
            "unit": trend.unit,
            "parts": len(trend.samples),
            "unmeasured": trend.unmeasured,
            "figures": _figures(trend),
            "out": sum(sample.outcome == "fail" for sample in trend.samples),
            # Of numbers and escaped words.
            "chart": Markup(
                control_chart(trend.name, trend.unit, trend.samples, trend.mean, trend.control, (trend.low, trend.high))
            ),
        }
        for trend in trends
    ]


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
