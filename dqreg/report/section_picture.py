"""The picture of a section: the part's outline with the scan's deviations drawn beside it, enlarged and coloured."""

from __future__ import annotations

from html import escape

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.sections import Section
from dqreg.report.colours import Scale

# Canvas in CSS pixels, its margin, and how far the largest deviation stands off the outline, in sizes of the picture.
WIDE, MARGIN, LIFT = 760.0, 40.0, 0.06


def section_picture(section: Section, unit: str, tolerance: float | None = None) -> str:
    """SVG of a section: outline in grey, deviations as whiskers times the factor that the caption tells."""
    across, up = _axes(section.normal)
    flat = [np.column_stack([curve @ across, curve @ up]) for curve in section.curves]
    corners = np.concatenate(flat)
    low, size = corners.min(axis=0), np.maximum(np.ptp(corners, axis=0), 1e-300)
    known = np.isfinite(section.values)
    largest = (float(np.abs(section.values[known]).max()) if known.any() else 0.0) or 1.0
    limit = tolerance or largest
    # Never less than it is: a deviation larger than that is seen anyway.
    factor = max(_round(LIFT * float(size.max()) / largest), 1.0)
    pixels = (WIDE - 2.0 * MARGIN) / float(max(size[0], 1.2 * size[1]))
    height = size[1] * pixels + 2.0 * MARGIN + 24.0

    def placed(points: FloatArray) -> FloatArray:
        shifted = (points - low) * pixels + MARGIN
        return np.column_stack([shifted[:, 0], height - 24.0 - shifted[:, 1]])

    lines = [
        f'<polyline class="outline" fill="none" stroke="#7d8590" stroke-width="1.5" points="{_path(placed(curve))}"/>'
        for curve in flat
    ]
    feet = np.column_stack([section.positions @ across, section.positions @ up])
    outward = np.column_stack([section.outward @ across, section.outward @ up])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    shown = np.where(known, section.values, 0.0)
    tips = placed(feet + factor * shown[:, None] * outward)
    scale = Scale(limit, signed=True)
    colours = scale.table()[scale.codes(shown)]
    for start, end, colour, value in zip(placed(feet)[known], tips[known], colours[known], shown[known], strict=True):
        lines.append(
            f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" stroke-width="2" '
            f'stroke="#{colour[0]:02x}{colour[1]:02x}{colour[2]:02x}"><title>{value:+.4g} {escape(unit)}</title></line>'
        )
    for number in range(len(flat)):
        own = np.flatnonzero(known & (section.curve == number))
        lines += [
            f'<polyline fill="none" stroke="#33383f" stroke-width="1" points="{_path(tips[run])}"/>'
            for run in np.split(own, 1 + np.flatnonzero(np.diff(own) > 1))
        ]
    words = f"deviations {factor:g} times enlarged; {100.0 * section.coverage:.0f} % of the outline was scanned"
    lines.append(f'<text x="{MARGIN:g}" y="{height - 8.0:.1f}" font-size="13" fill="currentColor">{words}</text>')
    return (
        f'<svg viewBox="0 0 {WIDE:g} {height:.0f}" role="img" aria-label="{escape(words)}" '
        f'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif">{"".join(lines)}</svg>'
    )


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
