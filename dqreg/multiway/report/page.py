"""The report of a multiway registration: one HTML file that opens anywhere and loads nothing."""

from __future__ import annotations

import colorsys
import io
import time
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.multiway.report import tables
from dqreg.multiway.report.figures import graph_figure, overlap_figure
from dqreg.multiway.report.result_protocol import ManyScans
from dqreg.report.cameras import VIEWS
from dqreg.report.colours import TARGET, rgb
from dqreg.report.figure import PALETTE, encode
from dqreg.report.html import data_uri, render
from dqreg.report.page_file import page_path, write_page
from dqreg.report.page_tables import SIGNS
from dqreg.report.raster import Dots, PartScene, frame_of
from dqreg.report.text import text_of, unit_words
from dqreg.rigid import pose

ADVICE = {
    "accepted": "All scans are placed; the poses can be used.",
    "suspect": "Look at the reasons before the poses are used.",
    "failed": "No two scans were joined; there is nothing to use.",
}
# Turns of the hue from one scan to the next, beyond the palette.
HUE_STEP_TURNS = 0.6180339887
WIDTH_PIXELS, HEIGHT_PIXELS = 560, 420
# Points of a scan in a picture, and their size in sizes of the whole.
POINTS_PER_SCAN, DOT_SIZES = 12_000, 0.0035


def write_report(result: ManyScans, path: str | Path) -> Path:
    """Write the report of a result, whole or not at all."""
    goal = page_path(path)
    return write_page(goal, to_html(result))


def to_html(result: ManyScans) -> str:
    """The page of a result."""
    level = result.verdict.level
    used = [edge for edge in result.edges if edge.used]
    loops = [loop for loop in result.loop_errors if loop.used and loop.sharp]
    spread, unit = tables.sigmas(result)[list(result.placed)], unit_words(tables.unit_of(result))
    tiles = [
        ("Scans placed", f"{len(result.placed)} of {len(result.names)}", "in one frame"),
        ("Pairs used", f"{len(used)} of {len(result.edges)}", f"{sum(e.level == 'accepted' for e in used)} accepted"),
        (
            "Loops that close",
            f"{sum(loop.chi2 <= CHI2_LIMIT for loop in loops)} of {len(loops)}",
            "of three used pairs",
        ),
        ("Sigma of rotation", _with_unit(_most(spread[:, 0]), " deg"), "largest of all scans"),
        ("Sigma of translation", _with_unit(_most(spread[:, 1]), unit), "largest of all scans"),
    ]
    return render(
        "multiway.html",
        level=level,
        sign=SIGNS[level],
        advice=ADVICE[level],
        reasons=result.verdict.reasons,
        count=len(result.names),
        written=time.strftime("%Y-%m-%d %H:%M"),
        tiles=tiles,
        rescans=tables.rescans(result),
        pictures=_pictures(result),
        names=list(zip(result.names, colours_of(len(result.names)), strict=True)),
        graph=data_uri(encode(graph_figure(result))),
        overlaps=data_uri(encode(overlap_figure(result))),
        tables=[tables.scans_table(result), tables.loops_table(result), tables.pairs_table(result)],
        timings=", ".join(f"{name} {seconds:.1f} s" for name, seconds in result.timings.items()),
    )


def colours_of(count: int) -> list[str]:
    """A colour for each scan: the palette, and beyond it hues a golden section apart, dark and light in turns."""
    found = list(PALETTE[:count])
    for k in range(len(found), count):
        red, green, blue = colorsys.hls_to_rgb(k * HUE_STEP_TURNS % 1.0, (0.35, 0.5, 0.65)[k % 3], 0.75)
        found.append("#" + "".join(f"{round(255 * part):02x}" for part in (red, green, blue)))
    return found


def _with_unit(value: float, unit: str) -> str:
    return text_of(value, 2) + (unit if np.isfinite(value) else "")


def _most(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else np.nan


def _pictures(result: ManyScans) -> list[tuple[str, str]]:
    """Titles and pictures of the scans: as they were given, and placed, from three sides."""
    if result.views is None:
        return []
    before, after = [], []
    for k, view in enumerate(result.views):
        if view.usable and view.cloud is not None:
            points = view.cloud.points[:: max(1, len(view.cloud.points) // POINTS_PER_SCAN)]
            before.append((k, points))
            if k in result.placed:
                after.append((k, pose.apply(result.T_world_scan[k], points)))
    colours = colours_of(len(result.names))
    shown = [("Before: each scan in its own frame", _draw(before, colours, "iso"))]
    if after:
        shown += [(f"Together, {view} view", _draw(after, colours, view)) for view in ("iso", "iso-back", "top")]
    return shown


def _draw(parts: list[tuple[int, FloatArray]], colours: list[str], view: str) -> str:
    # Matplotlib brings it along, and takes ten times as long to load.
    from PIL import Image

    everything = np.concatenate([points for _, points in parts])
    # A few strays must not make the rest a dot.
    low, high = np.quantile(everything, [0.002, 0.998], axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0
    inside = ((everything >= low) & (everything <= high)).all(axis=1)
    layers = [Dots((points - middle) / size, np.array(rgb(colours[k]), np.uint8), DOT_SIZES) for k, points in parts]
    frame = frame_of((everything[inside] - middle) / size, VIEWS[view], WIDTH_PIXELS, HEIGHT_PIXELS)
    image = PartScene(None, size).render(frame, TARGET, "#ffffff", layers)
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "jpeg", quality=85, optimize=True)
    return data_uri(buffer.getvalue(), "jpeg")
