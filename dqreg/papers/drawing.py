"""Figures as PNG, drawn without any global state."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from dqreg.papers.document import Figure, Panel
from dqreg.report.figure import PALETTE, encode, stacked

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_INCHES = (6.4, 3.6)
LEGEND_ROW_INCHES = 0.22
LEGEND_COLUMNS = 2
DOTS_PER_INCH = 160


def draw_png(figure: Figure) -> bytes:
    """Draw a figure as a PNG file, panels below each other, each with its legend below it, where it hides no curve."""
    width, height = PANEL_INCHES
    heights = [height + LEGEND_ROW_INCHES * _legend_rows(panel) for panel in figure.panels]
    canvas, rows = stacked([_painter(panel) for panel in figure.panels], width, heights, DOTS_PER_INCH)
    for axes, panel in zip(rows, figure.panels, strict=True):
        if _legend_rows(panel):
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=LEGEND_COLUMNS, fontsize="small",
                        frameon=False, handlelength=3.2)  # fmt: skip
    return encode(canvas)


def _painter(panel: Panel) -> Callable[[Axes], None]:
    def paint(axes: Axes) -> None:
        for curve in panel.curves:
            axes.errorbar(
                curve.x,
                curve.y,
                yerr=curve.errors or None,
                label=curve.label or None,
                color=PALETTE[curve.colour % len(PALETTE)],
                linestyle=curve.line or "none",
                marker=curve.marker or None,
                markersize=5,
                linewidth=1.6,
                capsize=2,
            )
        axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
        axes.set_title(panel.title, fontsize="medium", loc="left")
        if panel.log_x:
            axes.set_xscale("log")
        if panel.log_y:
            axes.set_yscale("log")
        if panel.y_limits is not None:
            axes.set_ylim(*panel.y_limits)

    return paint


def _legend_rows(panel: Panel) -> int:
    return -(-sum(bool(curve.label) for curve in panel.curves) // LEGEND_COLUMNS)
