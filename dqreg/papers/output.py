"""A report on the screen and in files, whose places are checked before the work and written after all of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqreg.files.atomic import require_folder, require_writable, write_atomically
from dqreg.files.strict_json import plain
from dqreg.papers.document import Figure, Panel, Report, Section
from dqreg.report.figure import PALETTE, encode, stacked
from dqreg.report.html import data_uri, render
from dqreg.report.table import print_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

RESULTS, PAGE = "results.json", "report.html"
PANEL_INCHES = (6.4, 3.6)
LEGEND_ROW_INCHES = 0.22
LEGEND_COLUMNS = 2
DOTS_PER_INCH = 160


def prepare_folder(folder: Path, figure_keys: Sequence[str]) -> None:
    """Make the folder and check that every file can be written in it."""
    require_folder(folder)
    for name in (RESULTS, PAGE, *(picture_name(key) for key in figure_keys)):
        require_writable(folder / name)


def write_report(report: Report, folder: Path) -> list[Path]:
    """Write the numbers, the figures and the page."""
    pictures = {figure.key: draw_png(figure) for figure in report.figures}
    contents: dict[str, bytes | str] = {RESULTS: to_json(report)}
    contents |= {picture_name(key): png for key, png in pictures.items()}
    contents[PAGE] = to_html(report, pictures)
    paths = [folder / name for name in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        write_atomically(path, content)
    return paths


def to_html(report: Report, pictures: Mapping[str, bytes]) -> str:
    """Page of a report, with its figures inside."""
    return render("papers.html", report=report, pictures={key: data_uri(png) for key, png in pictures.items()})


def print_section(console: Console, section: Section) -> None:
    """Print the finding, then the tables."""
    from rich.text import Text

    console.print()
    console.print(Text(section.title, style="bold"))
    console.print(Text(section.finding))
    print_tables(console, section.tables)


def to_json(report: Report) -> str:
    """Whole report as strict JSON, every number at full precision."""
    return json.dumps(plain(report), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def picture_name(key: str) -> str:
    """File name of a figure."""
    return f"figure-{key}.png"


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
