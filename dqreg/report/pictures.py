"""Pictures of a result without a display: views of part and scan, with a legend in units and a scale bar."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.atomic import require_writable, write_atomically
from dqreg.geometry import Mesh
from dqreg.report.cameras import BEST, angles_of, require_view
from dqreg.report.charts import ticks
from dqreg.report.colours import ALIGNED, OFF_PART, SOURCE, TARGET, ByteArray, nice_above, rgb
from dqreg.report.figure import encode, new_figure
from dqreg.report.raster import Dots, PartScene, ViewFrame, frame_of
from dqreg.report.report_data import ReportData
from dqreg.report.text import in_unit, scale_end, unit_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATES = ("deviation", "before", "after")
# What is drawn at most; more only hides itself.
MOST_POINTS = 400_000
# Pixels of an inch, and the colours of paper and words.
PER_INCH = 100
# Of a panel of a picture that is saved.
PANEL_WIDTH, PANEL_HEIGHT = 900, 640
PAPER, INK, PENCIL = "#ffffff", "#1a1c20", "#5a5f68"
MARGIN_PIXELS = 14
TITLE_HEIGHT, LEGEND_HEIGHT = 44, 86
# Numbers: their distance from what they mark, how deep in a hole that may lie (sizes), and colours by outcome.
LEADER_PIXELS, MAX_DEPTH_DIAGONALS = 30.0, 0.05
LABELS = {"pass": "#00795a", "undecided": "#8a5a00", "fail": "#b23c00"}


@dataclasses.dataclass(frozen=True)
class PicturePanel:
    """One part of a picture."""

    state: str  # The scan in the colours of its deviations, at the start in orange, or in place in blue
    view: str  # See `dqreg.report.cameras.angles_of`, or "best"


def parse_panels(text: str) -> tuple[PicturePanel, ...]:
    """Panels of a list such as ``before:iso,iso,top``."""
    panels = []
    for word in text.split(","):
        state, _, view = word.strip().rpartition(":")
        if state and state not in STATES:
            raise InputError(f"unknown state {state!r} in {word.strip()!r}; known are {', '.join(STATES)}")
        panels.append(PicturePanel(state or "deviation", require_view(view)))
    return tuple(panels)


def draw(
    data: ReportData,
    panels: Sequence[PicturePanel],
    width: int = PANEL_WIDTH,
    height: int = PANEL_HEIGHT,
    columns: int = 2,
) -> Figure:
    """A picture of several panels."""
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    coloured = data.scale is not None and any(panel.state == "deviation" for panel in panels)
    below = LEGEND_HEIGHT if coloured else MARGIN_PIXELS
    full = (columns * width + 2 * MARGIN_PIXELS, rows * (height + TITLE_HEIGHT) + below)
    figure = new_figure(full[0] / PER_INCH, full[1] / PER_INCH, PER_INCH, layout=None)
    figure.set_facecolor(PAPER)
    geometry = data.inputs.target.geometry
    scene = PartScene(geometry if isinstance(geometry, Mesh) else None, data.size)
    for number, panel in enumerate(panels):
        left = MARGIN_PIXELS + (number % columns) * width
        bottom = full[1] - (number // columns + 1) * (height + TITLE_HEIGHT)
        _panel(figure, data, scene, panel, (left, bottom, width, height))
    if coloured:
        _draw_legend(figure, data, full[0])
    return figure


def save_picture(data: ReportData, path: str | Path, panels: Sequence[PicturePanel]) -> None:
    """Write a picture, whole or not at all."""
    goal = picture_path(path)
    figure = draw(data, panels)
    write_atomically(goal, encode(figure, "png" if goal.suffix.lower() == ".png" else "jpeg"))


def picture_path(path: str | Path) -> Path:
    """Path of a picture that can be written; asked before the work."""
    goal = require_writable(path)
    if goal.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InputError(f"cannot write {goal}: a picture is .png, .jpg or .jpeg; got {goal.suffix or 'no ending'!r}")
    return goal


def _panel(
    figure: Figure, data: ReportData, scene: PartScene, panel: PicturePanel, place: tuple[int, int, int, int]
) -> None:
    left, bottom, width, height = place
    angles = angles_of(data.view if panel.view == BEST else panel.view)
    layers = _layers(data, panel.state)
    corners = _corners(data.inputs.target.surface.diagonal, data)
    # Clutter does not decide what is shown; where the scan was before does, but for strays.
    held = corners if panel.state != "before" else np.vstack([corners, _bulk(layers[-1].points)])
    frame = frame_of(held, angles, width, height)
    image = scene.render(frame, TARGET, PAPER, layers)
    figure.figimage(image, left, bottom, origin="upper")
    title, colour = _title(data, panel)
    x, y = (left + 0.5 * width), bottom + height + 0.45 * TITLE_HEIGHT
    _draw_text(figure, x, y, title, colour=colour, size=13)
    if panel.state == "deviation" and data.labels:
        _draw_labels(figure, data, scene, frame, (left, bottom))
    _draw_scale_bar(figure, data, frame, left + 18, bottom + 14)


def _layers(data: ReportData, state: str) -> list[Dots]:
    points = data.points / data.size
    # Discs that just cover the gaps between them.
    radius = 0.62 * float(data.result.settings.get("source_spacing") or 0.0) / data.size
    layers = _target_cloud(data)
    deviations, scale = data.deviations, data.scale
    if deviations is None or scale is None or state == "before":
        moved = _at_start(data, points)
        rows = _some(np.arange(len(moved)))
        return [*layers, Dots(moved[rows], _colour(SOURCE), radius * _thinner(len(moved)))]
    on, off = _some(np.flatnonzero(deviations.counted)), _some(np.flatnonzero(~deviations.counted))
    colours = _colour(ALIGNED) if state == "after" else scale.table()[data.colour_codes(on)]
    return [
        *layers,
        Dots(points[off], _colour(OFF_PART), 0.5 * radius),
        Dots(points[on], colours, radius * _thinner(int(deviations.counted.sum()))),
    ]


def _target_cloud(data: ReportData) -> list[Dots]:
    geometry = data.inputs.target.geometry
    if isinstance(geometry, Mesh):
        return []
    return [Dots(geometry.points[_some(np.arange(len(geometry.points)))] / data.size, _colour(TARGET), 0.0)]


def _at_start(data: ReportData, points: FloatArray) -> FloatArray:
    if not data.found or data.T_before is None:
        return points
    return data.inputs.placed(data.T_before) / data.size


def _bulk(points: FloatArray) -> FloatArray:
    low, high = np.quantile(points, [0.005, 0.995], axis=0)
    kept: FloatArray = points[((points >= low) & (points <= high)).all(axis=1)]
    return kept


def _corners(size: float, data: ReportData) -> FloatArray:
    geometry = data.inputs.target.geometry
    points = geometry.vertices if isinstance(geometry, Mesh) else geometry.points
    shown: FloatArray = points / size
    return shown


def _title(data: ReportData, panel: PicturePanel) -> tuple[str, str]:
    before = ", ".join(data.before_words).lower() or "scan as it came"
    count = f"{len(data.points):,} points"
    if panel.state == "before" or not data.found:
        return f"{before}: {count}", SOURCE
    if panel.state == "after":
        return f"scan in place: {count}", ALIGNED
    view = data.view if panel.view == BEST else panel.view
    noun = "part" if isinstance(data.inputs.target.geometry, Mesh) else "target"
    return f"deviation of the scan from the {noun}, {view} view", INK


def _some(rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return rows[:: -(-len(rows) // MOST_POINTS)] if len(rows) else rows


def _thinner(count: int) -> float:
    return float(np.sqrt(-(-count // MOST_POINTS))) if count else 1.0


def _colour(text: str) -> ByteArray:
    return np.array(rgb(text), dtype=np.uint8)


def _draw_legend(figure: Figure, data: ReportData, width: int) -> None:
    """Draw the bar of colours with numbers and unit at the bottom of a picture."""
    assert data.scale is not None
    scale, length, thickness, bottom = data.scale, max(80, min(520, width - 180)), 16, 44
    left = (width - length) // 2
    table = scale.table()
    bar = np.repeat(table[np.rint(np.linspace(1, 254, length)).astype(int)][None], thickness, axis=0)
    figure.figimage(bar, left, bottom)
    for code, x, words in ((0, left - 34, "below"), (255, left + length + 6, "beyond")):
        if code or scale.signed:
            figure.figimage(np.tile(table[code], (thickness, 28, 1)), x, bottom)
            _draw_text(figure, x + 14, bottom + thickness + 9, words, size=9)
    for value in ticks(scale.low, scale.limit, 6):
        x = left + (value - scale.low) / (scale.limit - scale.low) * length
        signed = f"{value:+g}" if scale.signed and value else f"{value:g}"
        _draw_text(figure, x, bottom - 13, signed, size=10)
    meaning = "deviation, + outside the part" if scale.signed else "distance"
    tolerance = "" if data.tolerance is None else f"; the scale ends at {scale_end(data.limits)}, ±{data.tolerance:g}"
    _draw_text(figure, left + 0.5 * length, 9, in_unit(meaning, data.unit) + tolerance, size=10)


def _draw_labels(figure: Figure, data: ReportData, scene: PartScene, frame: ViewFrame, corner: tuple[int, int]) -> None:
    """Draw the numbers of what is in sight, each beside its place with a line to it, away from the middle."""
    from matplotlib.lines import Line2D

    points = np.array([label.position - data.origin for label in data.labels]) / data.size
    columns, rows, _ = frame.columns_rows(points)
    whole = figure.get_size_inches() * PER_INCH
    for k in np.flatnonzero(scene.in_sight(frame, points, MAX_DEPTH_DIAGONALS)):
        label = data.labels[k]
        foot = np.array([corner[0] + columns[k], corner[1] + frame.height - 1 - rows[k]], dtype=np.float64)
        away = foot - (corner[0] + 0.5 * frame.width, corner[1] + 0.5 * frame.height)
        away /= max(float(np.linalg.norm(away)), 1.0)
        head = foot + LEADER_PIXELS * (away if away.any() else np.array([0.7, 0.7]))
        line = np.column_stack([foot, head]) / whole[:, None]
        colour = LABELS.get(label.kind, INK)
        figure.add_artist(Line2D(*line, color=colour, linewidth=1.1, transform=figure.transFigure))
        box = {"boxstyle": "round,pad=0.25,rounding_size=0.8", "facecolor": PAPER, "edgecolor": colour}
        x, y = head / whole
        figure.text(
            x,
            y,
            label.text,
            fontsize=10,
            color=colour,
            ha="center",
            va="center",
            weight="bold",
            family="DejaVu Sans",
            bbox=box,
        )


def _draw_scale_bar(figure: Figure, data: ReportData, frame: ViewFrame, left: int, bottom: int) -> None:
    """Draw a bar of a round length with that length."""
    per_pixel = frame.pixel * data.size
    goal = nice_above(0.12 * frame.width * per_pixel)
    length = round(goal / per_pixel)
    figure.figimage(np.full((4, length, 3), rgb(PENCIL), dtype=np.uint8), left, bottom)
    _draw_text(figure, left, bottom + 16, f"{goal:g}{unit_words(data.unit)}", size=10, align="left", colour=PENCIL)


def _draw_text(
    figure: Figure, x: float, y: float, text: str, *, size: float, colour: str = INK, align: str = "center"
) -> None:
    """Draw a word at a pixel."""
    width, height = figure.get_size_inches() * PER_INCH
    # A dollar sign would begin a formula.
    safe = text.replace("$", r"\$")
    figure.text(x / width, y / height, safe, fontsize=size * 0.92, color=colour, ha=align, va="center")
