"""What stands on a picture besides part and scan: legend, scale bar, words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqreg.report.charts import ticks
from dqreg.report.colours import nice_above, rgb
from dqreg.report.raster import Frame
from dqreg.report.report_data import ReportData

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PER_INCH = 100
INK, PENCIL = "#1a1c20", "#5a5f68"


def draw_legend(figure: Figure, story: ReportData, width: int) -> None:
    """Draw the bar of colours with numbers and unit at the bottom of a picture."""
    assert story.scale is not None
    scale, length, thickness, bottom = story.scale, max(80, min(520, width - 180)), 16, 44
    left = (width - length) // 2
    table = scale.table()
    bar = np.repeat(table[np.rint(np.linspace(1, 254, length)).astype(int)][None], thickness, axis=0)
    figure.figimage(bar, left, bottom)
    for code, x, words in ((0, left - 34, "below"), (255, left + length + 6, "beyond")):
        if code or scale.signed:
            figure.figimage(np.tile(table[code], (thickness, 28, 1)), x, bottom)
            draw_text(figure, x + 14, bottom + thickness + 9, words, size=9)
    for value in ticks(scale.low, scale.limit, 6):
        x = left + (value - scale.low) / (scale.limit - scale.low) * length
        signed = f"{value:+g}" if scale.signed and value else f"{value:g}"
        draw_text(figure, x, bottom - 13, signed, size=10)
    meaning = "deviation, + outside the part" if scale.signed else "distance"
    tolerance = "" if story.tolerance is None else f"; the scale ends at the tolerance, ±{story.tolerance:g}"
    draw_text(figure, left + 0.5 * length, 9, f"{meaning} [{story.unit}]{tolerance}", size=10)


def draw_scale_bar(figure: Figure, story: ReportData, frame: Frame, left: int, bottom: int) -> None:
    """Draw a bar of a round length with that length."""
    per_pixel = frame.pixel * story.size
    goal = nice_above(0.12 * frame.width * per_pixel)
    length = round(goal / per_pixel)
    figure.figimage(np.full((4, length, 3), rgb("#5a5f68"), dtype=np.uint8), left, bottom)
    draw_text(figure, left, bottom + 16, f"{goal:g} {story.unit}", size=10, align="left", colour="#5a5f68")


def draw_text(
    figure: Figure, x: float, y: float, text: str, *, size: float, colour: str = INK, align: str = "center"
) -> None:
    """Draw a word at a pixel."""
    width, height = figure.get_size_inches() * PER_INCH
    # A dollar sign would begin a formula.
    safe = text.replace("$", r"\$")
    figure.text(x / width, y / height, safe, fontsize=size * 0.92, color=colour, ha=align, va="center")
