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
from dqreg.report.cameras import BEST, VIEWS, require_view
from dqreg.report.colours import ALIGNED, OFF_PART, SOURCE, TARGET, ByteArray, rgb
from dqreg.report.figure import encode, new_figure
from dqreg.report.picture_marks import INK, PER_INCH, draw_legend, draw_scale_bar, draw_text
from dqreg.report.raster import Dots, PartScene, frame_of
from dqreg.report.report_data import ReportData

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATES = ("deviation", "before", "after")
# What is drawn at most; more only hides itself.
MOST_POINTS = 400_000
PAPER = "#ffffff"
MARGIN, TITLE, LEGEND = 14, 44, 86


@dataclasses.dataclass(frozen=True)
class Panel:
    """One part of a picture."""

    state: str  # The scan in the colours of its deviations, at the start in orange, or in place in blue
    view: str  # Name of a view, see `dqreg.report.cameras.VIEWS`, or "best"


def parse_panels(text: str) -> tuple[Panel, ...]:
    """Panels of a list such as ``before:iso,iso,top``."""
    panels = []
    for word in text.split(","):
        state, _, view = word.strip().rpartition(":")
        if state and state not in STATES:
            raise InputError(f"unknown state {state!r} in {word.strip()!r}; known are {', '.join(STATES)}")
        panels.append(Panel(state or "deviation", require_view(view)))
    return tuple(panels)


def draw(story: ReportData, panels: Sequence[Panel], width: int = 900, height: int = 640, columns: int = 2) -> Figure:
    """A picture of several panels."""
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    coloured = story.scale is not None and any(panel.state == "deviation" for panel in panels)
    full = (columns * width + 2 * MARGIN, rows * (height + TITLE) + (LEGEND if coloured else MARGIN))
    figure = new_figure(full[0] / PER_INCH, full[1] / PER_INCH, PER_INCH, layout=None)
    figure.set_facecolor(PAPER)
    geometry = story.inputs.target.geometry
    scene = PartScene(geometry if isinstance(geometry, Mesh) else None, story.size)
    for number, panel in enumerate(panels):
        left = MARGIN + (number % columns) * width
        bottom = full[1] - (number // columns + 1) * (height + TITLE)
        _panel(figure, story, scene, panel, (left, bottom, width, height))
    if coloured:
        draw_legend(figure, story, full[0])
    return figure


def save_picture(
    story: ReportData, path: str | Path, panels: Sequence[Panel], width: int = 900, height: int = 640
) -> None:
    """Write a picture, whole or not at all."""
    goal = picture_path(path)
    figure = draw(story, panels, width, height)
    write_atomically(goal, encode(figure, "png" if goal.suffix.lower() == ".png" else "jpeg"))


def picture_path(path: str | Path) -> Path:
    """Path of a picture that can be written; asked before the work.

    >>> picture_path("view.png").name
    'view.png'
    """
    goal = require_writable(path)
    if goal.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InputError(f"cannot write {goal}: a picture is .png, .jpg or .jpeg; got {goal.suffix or 'no ending'!r}")
    return goal


def _panel(figure: Figure, story: ReportData, scene: PartScene, panel: Panel, place: tuple[int, int, int, int]) -> None:
    left, bottom, width, height = place
    angles = VIEWS[story.view if panel.view == BEST else panel.view]
    layers = _layers(story, panel.state)
    corners = _corners(story.inputs.target.surface.diagonal, story)
    # Clutter does not decide what is shown; where the scan was before does, but for strays.
    held = corners if panel.state != "before" else np.vstack([corners, _bulk(layers[-1].points)])
    frame = frame_of(held, angles, width, height)
    image = scene.render(frame, TARGET, PAPER, layers)
    figure.figimage(image, left, bottom, origin="upper")
    title, colour = _title(story, panel)
    x, y = (left + 0.5 * width), bottom + height + 0.45 * TITLE
    draw_text(figure, x, y, title, colour=colour, size=13)
    draw_scale_bar(figure, story, frame, left + 18, bottom + 14)


def _layers(story: ReportData, state: str) -> list[Dots]:
    points = story.points / story.size
    # Discs that just cover the gaps between them.
    radius = 0.62 * float(story.result.settings.get("source_spacing") or 0.0) / story.size
    layers = _target_cloud(story)
    deviations, scale = story.deviations, story.scale
    if deviations is None or scale is None or state == "before":
        moved = _at_start(story, points)
        rows = _some(np.arange(len(moved)))
        return [*layers, Dots(moved[rows], _colour(SOURCE), radius * _thinner(len(moved)))]
    on, off = _some(np.flatnonzero(deviations.counted)), _some(np.flatnonzero(~deviations.counted))
    colours = _colour(ALIGNED) if state == "after" else scale.table()[scale.codes(deviations.values[on])]
    return [
        *layers,
        Dots(points[off], _colour(OFF_PART), 0.5 * radius),
        Dots(points[on], colours, radius * _thinner(int(deviations.counted.sum()))),
    ]


def _target_cloud(story: ReportData) -> list[Dots]:
    geometry = story.inputs.target.geometry
    if isinstance(geometry, Mesh):
        return []
    return [Dots(geometry.points[_some(np.arange(len(geometry.points)))] / story.size, _colour(TARGET), 0.0)]


def _at_start(story: ReportData, points: FloatArray) -> FloatArray:
    if not story.found or story.T_before is None:
        return points
    return story.inputs.placed(story.T_before) / story.size


def _bulk(points: FloatArray) -> FloatArray:
    low, high = np.quantile(points, [0.005, 0.995], axis=0)
    kept: FloatArray = points[((points >= low) & (points <= high)).all(axis=1)]
    return kept


def _corners(size: float, story: ReportData) -> FloatArray:
    geometry = story.inputs.target.geometry
    points = geometry.vertices if isinstance(geometry, Mesh) else geometry.points
    shown: FloatArray = points / size
    return shown


def _title(story: ReportData, panel: Panel) -> tuple[str, str]:
    before = ", ".join(story.before_words).lower() or "scan as it came"
    count = f"{len(story.points):,} points"
    if panel.state == "before" or not story.found:
        return f"{before}: {count}", SOURCE
    if panel.state == "after":
        return f"scan in place: {count}", ALIGNED
    view = story.view if panel.view == BEST else panel.view
    return f"deviation of the scan from the part, {view} view", INK


def _some(rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return rows[:: -(-len(rows) // MOST_POINTS)] if len(rows) else rows


def _thinner(count: int) -> float:
    return float(np.sqrt(-(-count // MOST_POINTS))) if count else 1.0


def _colour(text: str) -> ByteArray:
    return np.array(rgb(text), dtype=np.uint8)
