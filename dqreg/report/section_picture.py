"""The picture of a section: the part's outline with the scan's deviations drawn beside it, enlarged and coloured."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.scanned_part.sections import Section
from dqreg.report.colours import Scale
from dqreg.report.text import text_of, unit_words

# Canvas in CSS pixels, and its margin.
PICTURE_WIDTH, MARGIN_PIXELS = 760.0, 40.0
# How far the largest deviation stands off the outline, in sizes of the picture.
LARGEST_DEVIATION_SHARE = 0.06
# Height of the two lines of the caption, and of one.
CAPTION_HEIGHT, LINE_HEIGHT = 44.0, 20.0
# Cosine from which on a direction is told as an axis.
ALONG_AXIS_COS = 0.9999


def section_picture(section: Section, unit: str, tolerance: float | None = None, *, signed: bool = True) -> str:
    """SVG of a section: outline in grey, deviations as whiskers times the factor that the caption tells.

    ``signed`` is whether the part has an outside; else the caption says what the signs are.
    """
    across, up = _axes(section.normal)
    flat = [np.column_stack([curve @ across, curve @ up]) for curve in section.curves]
    corners = np.concatenate(flat)
    low, size = corners.min(axis=0), np.maximum(np.ptp(corners, axis=0), 1e-300)
    known = np.isfinite(section.values)
    largest = (float(np.abs(section.values[known]).max()) if known.any() else 0.0) or 1.0
    limit = tolerance or largest
    # Never less than it is: a deviation larger than that is seen anyway.
    factor = max(_round(LARGEST_DEVIATION_SHARE * float(size.max()) / largest), 1.0)
    pixels = (PICTURE_WIDTH - 2.0 * MARGIN_PIXELS) / float(max(size[0], 1.2 * size[1]))
    height = size[1] * pixels + 2.0 * MARGIN_PIXELS + CAPTION_HEIGHT

    def placed(points: FloatArray) -> FloatArray:
        shifted = (points - low) * pixels + MARGIN_PIXELS
        return np.column_stack([shifted[:, 0], height - CAPTION_HEIGHT - shifted[:, 1]])

    lines = [
        f'<polyline class="outline" fill="none" stroke="#7d8590" stroke-width="1.5" points="{_path(placed(curve))}"/>'
        for curve in flat
    ]
    feet = np.column_stack([section.positions @ across, section.positions @ up])
    outward = np.column_stack([section.outward @ across, section.outward @ up])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    shown = np.where(known, section.values, 0.0)
    tips = placed(feet + factor * shown[:, None] * outward)
    lines += _whiskers(placed(feet)[known], tips[known], shown[known], Scale(limit, signed=True), unit)
    for number in range(len(flat)):
        own = np.flatnonzero(known & (section.curve == number))
        lines += [
            f'<polyline fill="none" stroke="#33383f" stroke-width="1" points="{_path(tips[run])}"/>'
            for run in np.split(own, 1 + np.flatnonzero(np.diff(own) > 1))
        ]
    captions = _captions(section, factor, (across, up), f"{text_of(float(size[0]), 4)}{unit_words(unit)}")
    if not signed:
        captions = captions[0], f"{captions[1]}; the mesh has no outside: signs are along the normals of its faces"
    return _svg([*lines, *_below(captions, height)], height, "; ".join(captions))


def _whiskers(feet: FloatArray, tips: FloatArray, values: FloatArray, scale: Scale, unit: str) -> list[str]:
    """Deviations as lines off the outline, each with its value for the pointer."""
    colours = scale.table()[scale.codes(values)]
    return [
        f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" stroke-width="2" '
        f'stroke="#{colour[0]:02x}{colour[1]:02x}{colour[2]:02x}"><title>{value:+.4g} {escape(unit)}</title></line>'
        for start, end, colour, value in zip(feet, tips, colours, values, strict=True)
    ]


def _svg(lines: Sequence[str], height: float, title: str) -> str:
    return (
        f'<svg viewBox="0 0 {PICTURE_WIDTH:g} {height:.0f}" role="img" aria-label="{escape(title)}" '
        f'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif">{"".join(lines)}</svg>'
    )


def _below(captions: Sequence[str], height: float) -> list[str]:
    """Lines of text at the foot of the picture."""
    rows = [height - 8.0 - LINE_HEIGHT * (len(captions) - 1 - k) for k in range(len(captions))]
    return [
        f'<text x="{MARGIN_PIXELS:g}" y="{y:.1f}" font-size="13" fill="currentColor">{escape(words)}</text>'
        for y, words in zip(rows, captions, strict=True)
    ]


def _captions(section: Section, factor: float, axes: tuple[FloatArray, FloatArray], width: str) -> tuple[str, str]:
    """How to read the picture: where its axes point in the part and how wide it is; what is enlarged."""
    across, up = (direction_text(axis) for axis in axes)
    scanned = f"{100.0 * section.coverage:.0f} % of the outline was scanned"
    return (
        f"{across} to the right, {up} upward; the outline is {width} wide",
        f"deviations {factor:g} times enlarged; {scanned}",
    )


def direction_text(direction: FloatArray) -> str:
    """A direction in words: an axis, or three numbers.

    >>> direction_text(np.array([0.0, -1.0, 0.0])), direction_text(np.array([0.6, 0.0, 0.8]))
    ('−y', '(0.60, 0.00, 0.80)')
    """
    largest = int(np.argmax(np.abs(direction)))
    if abs(direction[largest]) > ALONG_AXIS_COS:
        return ("−" if direction[largest] < 0.0 else "+") + "xyz"[largest]
    return "(" + ", ".join(f"{x + 0.0:.2f}".replace("-", "−") for x in direction) + ")"


def _axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions of the picture: upward is z where the cut is upright, else y."""
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    return np.cross(up, normal), up


def _round(factor: float) -> float:
    """1, 2 or 5 times a power of ten, at most the factor."""
    power = 10.0 ** np.floor(np.log10(max(factor, 1e-300)))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= factor * (1.0 + 1e-9)))


def _path(points: FloatArray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
