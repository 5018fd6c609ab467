"""Figures of a multiway result: the graph with its edges by verdict, and the overlap of all pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.report.result_protocol import ManyScans
from dqreg.multiway.report.tables import name_of
from dqreg.report.colours import LEVELS
from dqreg.report.figure import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours and styles of edges: those used, and those that contradict; the others are faint.
EDGE_STYLES = {
    "used": (LEVELS["accepted"], "-", 2.2, "used, pair accepted"),
    "confirmed": (LEVELS["suspect"], "-", 1.6, "used, confirmed by loops"),
    "contradicts": (LEVELS["failed"], "--", 1.6, "contradicts the others"),
    "elsewhere": ("#7d8590", "-.", 1.2, "joins scans that are not placed"),
}
UNUSED_EDGE_STYLE = ("#c9ccd2", ":", 0.7, "not used")
# Scans up to which each has its name in the figure.
NAMED_SCANS = 40


def graph_figure(result: ManyScans) -> Figure:
    """The scans on a circle, in their order, and the pairs between them."""
    figure = new_figure(7.6, 7.0, 110)
    axes = figure.subplots()
    places = _places(result)
    labels: set[str] = set()
    for edge in sorted(result.edges, key=lambda edge: edge.used):
        colour, line, width, label = EDGE_STYLES.get(edge.code, UNUSED_EDGE_STYLE)
        a, b = places[edge.target], places[edge.source]
        once = label if label not in labels else None
        labels.add(label)
        axes.plot([a[0], b[0]], [a[1], b[1]], line, color=colour, linewidth=width, label=once, zorder=1 + edge.used)
    for node, (x, y) in places.items():
        if node == PART and result.settings.get("target") is None:
            continue
        found = node == PART or node in result.placed
        axes.plot(x, y, "o", markersize=9, color="#0072B2" if found else "#ffffff", markeredgecolor="#333333", zorder=4)
        if len(result.names) <= NAMED_SCANS:
            side = "left" if x >= 0.0 else "right"
            axes.annotate(name_of(result, node), (x, y), (1.07 * x, 1.07 * y), ha=side, va="center", fontsize=9)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.margins(0.22)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, -0.08), ncols=2, frameon=False, fontsize=9)
    return figure


def _places(result: ManyScans) -> dict[int, tuple[float, float]]:
    count = len(result.names)
    angles = np.pi / 2.0 - 2.0 * np.pi * np.arange(count) / count
    places = {k: (float(np.cos(angle)), float(np.sin(angle))) for k, angle in enumerate(angles)}
    return {**places, PART: (0.0, 0.0)}


def overlap_figure(result: ManyScans) -> Figure:
    """How much of each scan lies where another does."""
    figure = new_figure(6.4, 5.4, 110)
    axes = figure.subplots()
    overlap: FloatArray = 100.0 * result.overlap
    image = axes.imshow(overlap, cmap="cividis", vmin=0.0, vmax=100.0)
    figure.colorbar(image, ax=axes, label="overlap [% of the smaller scan]")
    if len(result.names) <= NAMED_SCANS:
        ticks = np.arange(len(result.names))
        axes.set_xticks(ticks, result.names, rotation=60, ha="right", fontsize=8)
        axes.set_yticks(ticks, result.names, fontsize=8)
    return figure
