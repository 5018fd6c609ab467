"""The charts of a report as SVG text: sharp in print, coloured by the page's style sheet, a few kilobytes each.

Not Matplotlib's, whose SVG of the same histogram has five times the size (28 kB), takes 0.3 s or more instead of
0.01 s, and has its own colours, which a dark page cannot change.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from html import escape

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.icp.history import Iteration
from dqreg.report.colours import Scale
from dqreg.report.text import in_unit, percent, unit_words

# Canvases in CSS pixels: for a desk and paper, and for a phone. Text is never scaled down.
WIDE_CANVAS, NARROW_CANVAS = (760, 300), (380, 260)
LEFT_MARGIN, RIGHT_MARGIN = 66, 16
TOP_MARGIN, BOTTOM_MARGIN = 20, 52
BAR_COUNT = 80
# Widest digit of the pages' fonts.
DIGIT_WIDTH = 8.3


@dataclasses.dataclass(frozen=True)
class Axes:
    """Data coordinates on a canvas."""

    # x, y: Lowest and highest value shown
    x: tuple[float, float]
    y: tuple[float, float]
    size: tuple[int, int]  # Width and height of the canvas

    @property
    def end(self) -> int:
        """Right end of the x axis."""
        return self.size[0] - RIGHT_MARGIN

    @property
    def base(self) -> int:
        """Place of the x axis."""
        return self.size[1] - BOTTOM_MARGIN

    def across(self, value: float) -> float:
        """Place of an x value."""
        return LEFT_MARGIN + (value - self.x[0]) / (self.x[1] - self.x[0]) * (self.end - LEFT_MARGIN)

    def down(self, value: float) -> float:
        """Place of a y value."""
        return self.base - (value - self.y[0]) / (self.y[1] - self.y[0]) * (self.base - TOP_MARGIN)


def histogram(
    values: FloatArray,
    scale: Scale,
    unit: str,
    limits: tuple[float, float] | None,
    size: tuple[int, int] = WIDE_CANVAS,
) -> str:
    """Histogram of the deviations in the colours of the view; how many lie beyond its ends is written there.

    ``limits`` are the deviations allowed, where all faces have the same.
    """
    reach = scale.limit * (1.0 if limits is None else 1.6)
    low = -reach if scale.signed else 0.0
    edges = np.linspace(low, reach, BAR_COUNT + 1)
    counts, _ = np.histogram(values, edges)
    shares = 100.0 * counts / max(len(values), 1)
    below, above = (float(np.mean(far)) if len(values) else 0.0 for far in (values < low, values > reach))
    axes = Axes((low, reach), (0.0, max(float(shares.max()), 1e-9) * 1.08), size)
    table = scale.table()
    colours = table[scale.codes(0.5 * (edges[1:] + edges[:-1]))]
    body = [_band(axes, scale, limits)] if limits is not None else []
    for share, left, right, colour in zip(shares, edges, edges[1:], colours, strict=False):
        body.append(_bar(axes, left, right, share, colour))
    body.append(_x_axis(axes, in_unit("deviation" if scale.signed else "distance", unit)))
    body.append(_y_axis(axes, "fraction of the points [%]"))
    body.append(_beyond(axes, below, above, unit, scale.signed))
    return _svg("Histogram of the deviations", axes, body)


def convergence(history: Sequence[Iteration], unit: str, size: tuple[int, int] = WIDE_CANVAS) -> str:
    """Root mean square distance and kernel scale over the iterations, on a logarithmic scale."""
    rms = np.array([record.rms for record in history])
    width = np.array([record.kernel_scale for record in history])
    seen = np.concatenate([rms, width])
    seen = np.log10(seen[np.isfinite(seen) & (seen > 0.0)])
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (-1.0, 0.0)
    axes = Axes((0.5, len(history) + 0.5), (low - 0.15, max(high, low + 0.5) + 0.15), size)
    body = [_stages(axes, history), _curve(axes, width, "line two", "kernel"), _curve(axes, rms, "line one", "rms")]
    body += [_x_axis(axes, "iteration"), _log_axis(axes, in_unit("length", unit))]
    return _svg("Convergence: rms distance and kernel scale", axes, body)


def ticks(low: float, high: float, about: int = 6) -> FloatArray:
    """Round numbers from low to high."""
    raw = (high - low) / about
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min((1.0, 2.0, 5.0, 10.0), key=lambda factor: abs(factor * power - raw))
    numbers = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0) * step
    return np.array([float(f"{number:.10g}") + 0.0 for number in numbers])


def _bar(axes: Axes, left: float, right: float, share: float, colour: Sequence[int]) -> str:
    x, y = axes.across(left), axes.down(share)
    width, height = axes.across(right) - x, axes.down(0.0) - y
    if share <= 0.0:
        return ""
    red, green, blue = (int(c) for c in colour)
    return (
        f'<rect class="bar" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
        f'fill="rgb({red},{green},{blue})"/>'
    )


def _band(axes: Axes, scale: Scale, limits: tuple[float, float]) -> str:
    left, right = axes.across(limits[0] if scale.signed else 0.0), axes.across(limits[1])
    lines = "".join(
        f'<line class="limit" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP_MARGIN}" y2="{axes.base}"/>'
        for x in ([left, right] if scale.signed else [right])
    )
    middle = f'<text class="mid" x="{(left + right) / 2:.1f}" y="{TOP_MARGIN - 6}">within tolerance</text>'
    # On a phone there is no room between what lies beyond the ends.
    said = middle if axes.size == WIDE_CANVAS else ""
    return (
        f'<rect class="band" x="{left:.1f}" y="{TOP_MARGIN}" width="{right - left:.1f}" '
        f'height="{axes.base - TOP_MARGIN}"/>'
        f"{lines}{said}"
    )


def _beyond(axes: Axes, below: float, above: float, unit: str, signed: bool) -> str:
    # With the length they are beyond: the share out of tolerance is another one, and stands in the table.
    ends = [("end", axes.end, "above", axes.x[1], above), ("start", LEFT_MARGIN, "below", axes.x[0], below)]
    texts = []
    for place, x, word, limit, share in ends if signed else ends[:1]:
        length = f"{limit:.3g}".replace("-", "−") + unit_words(unit)
        words = escape(f"{word} {length}: {percent(share)} %")
        texts.append(f'<text class="{place}" x="{x}" y="{TOP_MARGIN - 6}">{words}</text>')
    return "".join(texts)


def _x_axis(axes: Axes, label: str) -> str:
    base = axes.base
    parts = [f'<line class="axis" x1="{LEFT_MARGIN}" x2="{axes.end}" y1="{base}" y2="{base}"/>']
    for value in ticks(*axes.x, about=6 if axes.size[0] > 500 else 4):
        x = axes.across(value)
        parts.append(f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" y1="{base}" y2="{base + 5}"/>')
        text = _tick(value)
        # Centred where there is room; at the rim it ends there.
        fits = x + 0.5 * DIGIT_WIDTH * len(text) <= axes.size[0]
        place, at = ("mid", x) if fits else ("end", float(axes.size[0]))
        parts.append(f'<text class="{place}" x="{at:.1f}" y="{base + 20}">{text}</text>')
    middle = (LEFT_MARGIN + axes.end) / 2
    parts.append(f'<text class="mid label" x="{middle:.0f}" y="{axes.size[1] - 8}">{escape(label)}</text>')
    return "".join(parts)


def _y_axis(axes: Axes, label: str) -> str:
    return _y_ticks(axes, [(axes.down(value), _tick(value)) for value in ticks(*axes.y, about=4)], label)


def _log_axis(axes: Axes, label: str) -> str:
    low, high = axes.y
    decades = np.arange(np.ceil(low), np.floor(high) + 1.0)
    factors = (1.0,) if len(decades) > 2 else (1.0, 2.0, 5.0)
    exponents = np.arange(np.floor(low), np.floor(high) + 1.0)
    numbers = [factor * 10.0**exponent for exponent in exponents for factor in factors]
    shown = [number for number in numbers if low <= np.log10(number) <= high]
    return _y_ticks(axes, [(axes.down(float(np.log10(number))), f"{number:.4g}") for number in shown], label)


def _y_ticks(axes: Axes, places: Sequence[tuple[float, str]], label: str) -> str:
    parts = []
    for y, text in places:
        parts.append(f'<line class="grid" x1="{LEFT_MARGIN}" x2="{axes.end}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="end" x="{LEFT_MARGIN - 7}" y="{y + 4:.1f}">{text}</text>')
    middle = (TOP_MARGIN + axes.base) / 2
    parts.append(f'<text class="mid label" transform="translate(13 {middle:.0f}) rotate(-90)">{escape(label)}</text>')
    return "".join(parts)


def _stages(axes: Axes, history: Sequence[Iteration]) -> str:
    names = [record.stage for record in history]
    starts = [k for k, name in enumerate(names) if k == 0 or name != names[k - 1]]
    parts = []
    for k in starts:
        x = axes.across(k + 0.5)
        if k:
            parts.append(f'<line class="limit" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP_MARGIN}" y2="{axes.base}"/>')
        parts.append(f'<text class="start" x="{x + 5:.1f}" y="{TOP_MARGIN + 8}">{escape(names[k])}</text>')
    return "".join(parts)


def _curve(axes: Axes, values: FloatArray, style: str, name: str) -> str:
    shown = [(axes.across(k + 1.0), axes.down(float(np.log10(v)))) for k, v in enumerate(values) if 0.0 < v < np.inf]
    if not shown:
        return ""
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in shown)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4"/>' for x, y in shown) if len(shown) < 120 else ""
    return f'<g class="{style}"><title>{escape(name)}</title><polyline points="{line}"/>{dots}</g>'


def _tick(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _svg(title: str, axes: Axes, body: Sequence[str]) -> str:
    width, height = axes.size
    kind = "wide" if axes.size == WIDE_CANVAS else "narrow"
    return (
        f'<svg class="chart {kind}" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">'
        f"<title>{escape(title)}</title>{''.join(body)}</svg>"
    )
