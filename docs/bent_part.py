"""Draws the bent part of the inspection page: ``python docs/bent_part.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Section, inspect, measure_deviations
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import box

IMAGE = Path(__file__).parent / "images" / "bent_part.svg"
TARGET, SOURCE, ALIGNED = "#9aa0a6", "#e07b00", "#0b6e99"
# A plate of 120 x 30 x 8 mm, clamped at its left end, whose right end hangs down by 0.6 mm; noise 0.01 mm.
SIZE, SAG, NOISE = (120.0, 30.0, 8.0), 0.6, 0.01
# Reference points on the clamped end: three on top, two on the front, one on the left.
CLAMPED = [[-55, 10, 4], [-55, -10, 4], [-35, 0, 4], [-55, -15, 0], [-35, -15, 0], [-60, 0, 0]]
STEPS = {
    "best fit": {"name": "best fit", "kind": "best-fit"},
    "datums on the clamped end": {"name": "clamped end", "kind": "points", "points": CLAMPED},
}


def sections() -> dict[str, Section]:
    """The cut along the middle of the plate under each alignment."""
    part = Mesh(*box(SIZE))
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 20_000, rng).points
    points[:, 2] -= SAG * ((points[:, 0] + 60.0) / 120.0) ** 2
    points += NOISE * rng.normal(size=points.shape)
    scan = measure_deviations(points, part, MeshSurface(part), reach=5.0)
    cut = [{"name": "middle", "point": [0, 0, 0], "normal": [0, 1, 0]}]
    top = [{"name": "top", "kind": "profile", "near": [0, 0, 4], "tolerance": 0.5}]
    found = {}
    for name, step in STEPS.items():
        plan = plan_of({"alignment": [step], "section": cut, "characteristic": top})
        found[name] = inspect(scan, plan).sections[0][1]
    return found


def draw() -> Figure:
    """Deviations along the top of the plate."""
    figure = Figure(figsize=(8.0, 3.2), layout="tight")
    axes = figure.add_subplot()
    axes.axhline(0.0, color=TARGET, lw=1.0)
    for (name, cut), colour in zip(sections().items(), (SOURCE, ALIGNED), strict=True):
        top = cut.outward[:, 2] > 0.5
        order = np.argsort(cut.positions[top, 0])
        axes.plot(cut.positions[top, 0][order], cut.values[top][order], color=colour, lw=2.0, label=name)
    axes.set_xlabel("along the plate (mm)")
    axes.set_ylabel("deviation of the top (mm)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="lower left")
    return figure


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "dqreg", "font.size": 11, "savefig.facecolor": "white"})
    draw().savefig(IMAGE, metadata={"Date": None})
