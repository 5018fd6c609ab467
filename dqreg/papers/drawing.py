"""Figures as PNG, drawn without any global state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dqreg.papers.document import Figure, Panel
from dqreg.report.figure import PALETTE, encode, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_INCHES = (6.4, 3.6)
LEGEND_ROW_INCHES = 0.22
LEGEND_COLUMNS = 2
DOTS_PER_INCH = 160


def draw_png(figure: Figure) -> bytes:
    """Draw a figure as a PNG file, panels below each other."""
    width, height = PANEL_INCHES
    heights = [height + LEGEND_ROW_INCHES * _legend_rows(panel) for panel in figure.panels]
    canvas = new_figure(width, sum(heights), DOTS_PER_INCH)
    rows = canvas.subplots(len(figure.panels), 1, squeeze=False, height_ratios=heights)
    for axes, panel in zip(rows[:, 0], figure.panels, strict=True):
        _draw_panel(axes, panel)
    return encode(canvas)


def _draw_panel(axes: Axes, panel: Panel) -> None:
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
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title, fontsize="medium", loc="left")
    style_axes(axes)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.log_y:
        axes.set_yscale("log")
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
    if _legend_rows(panel):
        # Below the axes, where it hides no curve.
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.16),
            ncols=LEGEND_COLUMNS,
            fontsize="small",
            frameon=False,
            handlelength=3.2,
        )


def _legend_rows(panel: Panel) -> int:
    return -(-sum(bool(curve.label) for curve in panel.curves) // LEGEND_COLUMNS)
