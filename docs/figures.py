"""Draws the figures of the conventions page: ``python docs/figures.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon

IMAGES = Path(__file__).parent / "images"
TARGET, SOURCE, ALIGNED, INK = "#9aa0a6", "#e07b00", "#0b6e99", "#222222"
PART = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.2], [0.0, 2.2]])


def turn(points: np.ndarray, degrees: float, shift: tuple[float, float]) -> np.ndarray:
    """Points turned about the origin, then shifted."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return points @ np.array([[c, s], [-s, c]]) + shift


def along(polygon: np.ndarray, count: int) -> np.ndarray:
    """Points evenly spaced along the outline."""
    ends = np.roll(polygon, -1, axis=0)
    lengths = np.linalg.norm(ends - polygon, axis=1)
    places = np.linspace(0.0, lengths.sum(), count, endpoint=False)
    edge = np.searchsorted(np.cumsum(lengths), places, side="right")
    share = (places - np.r_[0.0, np.cumsum(lengths)][edge]) / lengths[edge]
    return polygon[edge] + share[:, None] * (ends - polygon)[edge]


def arrow(axes: Axes, begin: tuple, end: tuple, colour: str = INK, bend: float = 0.0, width: float = 1.4) -> None:
    """Draw an arrow."""
    style = f"arc3,rad={bend}"
    axes.add_patch(FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=13, color=colour, lw=width,
                                   connectionstyle=style, shrinkA=0, shrinkB=0))  # fmt: skip


def frame(axes: Axes, origin: tuple[float, float], degrees: float, colour: str, name: str) -> None:
    """Draw two axes and their name."""
    for angle, letter in ((degrees, "x"), (degrees + 90.0, "y")):
        tip = np.array(origin) + 0.9 * np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        arrow(axes, origin, tuple(tip), colour, width=2.0)
        axes.text(*(tip + 0.14 * (tip - origin)), letter, color=colour, ha="center", va="center", style="italic")
    axes.text(origin[0] - 0.15, origin[1] - 0.32, name, color=colour, ha="center", va="center")


def blank(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure without a frame, equal scales."""
    figure = Figure(figsize=(width, height), layout="tight")
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, axes


def frames() -> Figure:
    """Source, target and the pose between them."""
    figure, axes = blank(8.4, 3.3)
    scan = turn(along(PART, 60)[:44], 35.0, (2.1, 0.4))
    axes.scatter(*scan.T, s=9, color=SOURCE)
    frame(axes, (0.0, 0.0), 0.0, SOURCE, "source frame")
    axes.text(2.2, 3.35, "scan: the source moves", color=SOURCE, ha="center")
    part = PART + np.array([8.4, 0.3])
    axes.add_patch(Polygon(part, closed=True, fc="#e6e8ea", ec=TARGET, lw=2))
    axes.scatter(*along(part, 60)[:44].T, s=9, color=ALIGNED)
    frame(axes, (7.0, 0.0), 0.0, "#5f6368", "target frame")
    axes.text(9.9, 3.35, "part: the target stands", color="#5f6368", ha="center")
    point, moved = turn(PART[2:3], 35.0, (2.1, 0.4))[0], part[2]
    for place, colour in ((point, SOURCE), (moved, ALIGNED)):
        axes.scatter(*place, s=45, color=colour, zorder=3, ec=INK)
    axes.text(point[0] + 0.15, point[1] + 0.15, r"$p_\mathrm{source}$", color=INK)
    axes.text(moved[0] + 0.15, moved[1] + 0.1, r"$p_\mathrm{target} = R\,p_\mathrm{source} + t$", color=INK)
    arrow(axes, (5.0, 1.9), (8.0, 1.9), ALIGNED, bend=-0.15, width=2.2)
    axes.text(6.5, 2.4, r"$T_\mathrm{target\,source}$", ha="center", color=ALIGNED, size=13)
    axes.set_xlim(-0.8, 14.6)
    axes.set_ylim(-0.7, 3.8)
    return figure


def increment() -> Figure:
    """The increment that a covariance belongs to."""
    figure, axes = blank(7.2, 3.3)
    axes.add_patch(Polygon(PART, closed=True, fc="#e6e8ea", ec=TARGET, lw=2))
    low, high = PART.min(axis=0), PART.max(axis=0)
    axes.add_patch(
        Polygon([low, (high[0], low[1]), high, (low[0], high[1])], closed=True, fill=False, ec=TARGET, ls=":")
    )
    centre = 0.5 * (low + high)
    moved = turn(PART - centre, 9.0, (0.25, 0.12)) + centre
    axes.add_patch(Polygon(moved, closed=True, fill=False, ec=ALIGNED, lw=1.5))
    axes.scatter(*centre, s=35, color=INK, zorder=3)
    axes.text(centre[0] + 0.05, centre[1] - 0.28, "centre", color=INK)
    arrow(axes, tuple(centre), (centre[0] + 0.25, centre[1] + 0.72), ALIGNED, width=2.0)
    axes.text(centre[0] + 0.35, centre[1] + 0.7, "translation  v", color=ALIGNED, va="center")
    arrow(axes, (3.35, 0.35), (3.2, 1.75), ALIGNED, bend=0.25, width=2.0)
    axes.text(3.55, 1.15, "rotation vector  w\n(radians, about the centre)", color=ALIGNED, va="center")
    axes.text(3.55, 2.05, "the true pose is\n" r"$\mathrm{about}(\exp(w, v), \mathrm{centre})\; T$", va="center")
    axes.text(0.0, -0.35, "covariance: 6 x 6, (w, v), in the target's frame", color=INK, va="center")
    axes.set_xlim(-0.3, 6.6)
    axes.set_ylim(-0.6, 2.7)
    return figure


def screw() -> Figure:
    """A turn about an axis and a slide along it."""
    figure, axes = blank(7.2, 3.4)
    arrow(axes, (0.0, 0.0), (0.0, 3.2), INK, width=1.6)
    axes.text(0.12, 3.05, "axis  n  (unit vector)", va="center")
    height, radius = 0.5, 1.2
    theta = np.linspace(np.deg2rad(-70), np.deg2rad(60), 60)
    rise = np.linspace(0.0, 1.5, 60)
    path = np.column_stack([radius * np.cos(theta), height + 0.3 * radius * np.sin(theta) + rise])
    axes.plot(*path.T, color=ALIGNED, lw=2)
    arrow(axes, tuple(path[-3]), tuple(path[-1]), ALIGNED, width=2.0)
    axes.scatter(*path[0], s=45, color=SOURCE, zorder=3, ec=INK)
    axes.scatter(*path[-1], s=45, color=ALIGNED, zorder=3, ec=INK)
    axes.text(
        1.4,
        1.1,
        r"turn by the angle $\theta$ about the axis" "\n" r"(right-handed) and slide by $d$ along it",
        color=ALIGNED,
    )
    axes.scatter(0.0, 0.15, s=35, color=INK)
    axes.text(-0.12, 0.15, "point  p", ha="right", va="center")
    axes.text(1.4, 2.55, r"real part  $r = (\cos\frac{\theta}{2},\ n\,\sin\frac{\theta}{2})$" "\n"
              r"dual part  $s = \frac{1}{2}\,(0, t)\,r$", size=12, va="center")  # fmt: skip
    axes.set_xlim(-1.0, 6.6)
    axes.set_ylim(-0.2, 3.4)
    return figure


def deviation() -> Figure:
    """Signs of deviations, tolerance and reach."""
    figure, axes = blank(8.0, 2.7)
    axes.add_patch(Polygon([(0, 0), (8, 0), (8, -1), (0, -1)], closed=True, fc="#e6e8ea", ec="none"))
    axes.plot([0, 8], [0, 0], color="#5f6368", lw=2)
    axes.text(0.15, -0.78, "material of the part", color="#5f6368", va="center")
    axes.fill_between([0, 8], -0.3, 0.3, color=ALIGNED, alpha=0.12, lw=0)
    axes.text(7.9, 0.14, "within the tolerance", ha="right", va="center", color=ALIGNED, size=9)
    for x, y, words in (
        (1.3, 0.62, "+0.6: too much\nmaterial"),
        (3.4, -0.55, "−0.6: material\nis missing"),
        (5.2, 0.1, ""),
    ):
        arrow(axes, (x, 0.0), (x, y), INK)
        axes.scatter(x, y, s=40, color=SOURCE, ec=INK, zorder=3)
        axes.text(x + 0.15, y, words, va="center", size=10)
    axes.scatter([6.0, 6.35, 6.8], [1.35, 1.5, 1.3], s=40, color="#c8c8c8", ec=INK)
    axes.text(7.0, 1.42, "beyond the reach:\nsomething else", va="center", size=10)
    axes.axhline(1.0, color=TARGET, ls=":", xmin=0.0, xmax=0.83)
    axes.text(0.1, 1.12, "reach", color="#5f6368", size=9)
    axes.set_xlim(0, 9.2)
    axes.set_ylim(-1.05, 1.75)
    return figure


def main() -> None:
    """Draw all of them."""
    # Text as outlines and no date: the same file on every machine.
    mpl.rcParams.update({"svg.hashsalt": "dqreg", "font.size": 11, "savefig.facecolor": "white"})
    for draw in (frames, increment, screw, deviation):
        draw().savefig(IMAGES / f"conventions_{draw.__name__}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
