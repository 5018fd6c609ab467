"""The control chart of a value over many parts as SVG: each point is a link to its part."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from html import escape
from urllib.parse import quote

from dqreg.report.charts import LEFT_MARGIN, Axes, ticks
from dqreg.report.table import short_number

CHART_PIXELS = (760, 210)


@dataclasses.dataclass(frozen=True)
class Sample:
    """A value of one part."""

    name: str  # Of the part
    link: str  # Path of its page, from the chart's page
    value: float
    uncertainty: float  # Expanded; NaN where not known
    outcome: str


def control_chart(
    name: str,
    unit: str,
    samples: Sequence[Sample],
    mean: float,
    control: tuple[float, float],
    limits: tuple[float, float],
    gaps: Sequence[tuple[int, str, str]] = (),
) -> str:
    """Values in their order, with uncertainties, mean, control limits and tolerance limits.

    Each gap is a part without a value that counts: how many samples stand before it, words, and its page; in order.
    """
    lines = [("mid", mean, "mean"), *(("control", x, "control limit") for x in control)]
    lines += [("tolerance", x, "tolerance") for x in limits]
    lines = [line for line in lines if math.isfinite(line[1])]
    ends = [
        s.value + sign * (s.uncertainty if math.isfinite(s.uncertainty) else 0.0) for s in samples for sign in (-1, 1)
    ]
    low, high = min([*ends, *(x for _, x, _ in lines)]), max([*ends, *(x for _, x, _ in lines)])
    room = 0.06 * (high - low) or 0.5
    axes = Axes((0.0, len(samples) + len(gaps) + 1.0), (low - room, high + room), CHART_PIXELS)
    places = [k + 1 + sum(before <= k for before, _, _ in gaps) for k in range(len(samples))]
    body = [_grid(axes), *(_line(axes, *line) for line in lines)]
    path = " ".join(f"{axes.across(k):.1f},{axes.down(s.value):.1f}" for k, s in zip(places, samples, strict=True))
    body.append(f'<polyline class="run" points="{path}"/>')
    body += [_dot(axes, place, sample, unit) for place, sample in zip(places, samples, strict=True)]
    body += [_gap(axes, before + k, words, link) for k, (before, words, link) in enumerate(gaps, 1)]
    title = escape(f"{name} over the parts")
    return (
        f'<svg class="chart control" viewBox="0 0 {CHART_PIXELS[0]} {CHART_PIXELS[1]}" role="img" aria-label="{title}">'
        f"<title>{title}</title>{''.join(body)}</svg>"
    )


def _grid(axes: Axes) -> str:
    parts = []
    for value in ticks(*axes.y, about=4):
        y = axes.down(value)
        text = short_number(value, ".6g").replace("-", "−")
        parts.append(f'<line class="grid" x1="{LEFT_MARGIN}" x2="{axes.end}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="end" x="{LEFT_MARGIN - 7}" y="{y + 4:.1f}">{text}</text>')
    parts.append(
        f'<text class="mid" x="{(LEFT_MARGIN + axes.end) / 2:.0f}" y="{axes.base + 24}">'
        "parts, as in the manifest</text>"
    )
    return "".join(parts)


def _line(axes: Axes, kind: str, value: float, words: str) -> str:
    y = f"{axes.down(value):.1f}"
    title = f"<title>{words} {value:.6g}</title>"
    return f'<line class="{kind}" x1="{LEFT_MARGIN}" x2="{axes.end}" y1="{y}" y2="{y}">{title}</line>'


def _dot(axes: Axes, place: int, sample: Sample, unit: str) -> str:
    x, y = axes.across(float(place)), axes.down(sample.value)
    bar, room = "", ""
    if math.isfinite(sample.uncertainty):
        ends = [axes.down(sample.value + sign * sample.uncertainty) for sign in (-1.0, 1.0)]
        bar = f'<line class="bar" x1="{x:.1f}" x2="{x:.1f}" y1="{ends[0]:.1f}" y2="{ends[1]:.1f}"/>'
        room = f" ± {sample.uncertainty:.2g}"
    words = escape(f"{sample.name}: {sample.value:.6g}{room} {unit}".rstrip() + f", {sample.outcome}")
    dot = f'<circle class="{escape(sample.outcome)}" cx="{x:.1f}" cy="{y:.1f}" r="4"><title>{words}</title></circle>'
    return f'{bar}<a href="{escape(quote(sample.link))}">{dot}</a>'


def _gap(axes: Axes, place: int, words: str, link: str) -> str:
    """A cross on the axis: a value under a pose that may be wrong would stretch the scale."""
    x, y, r = axes.across(float(place)), axes.base - 6.0, 4.0
    title = f"<title>{escape(f'left out: {words}')}</title>"
    path = f"M{x - r:.1f} {y - r:.1f}l{2 * r:g} {2 * r:g}m0 {-2 * r:g}l{-2 * r:g} {2 * r:g}"
    cross = f'<path class="gap" d="{path}">{title}</path>'
    return f'<a href="{escape(quote(link))}">{cross}</a>' if link else cross
