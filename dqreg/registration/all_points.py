"""From the cells of two clouds on to all of their points, where these say more."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.icp import InlierMixture, Observer, Plan, Run, run_graduated
from dqreg.icp.history import Iteration
from dqreg.registration.downsampling import Sides

# Distances from the planes below this share of the spacing of all points: the points then stand nearer to the surface
# than to each other, and the mean of a cell hides something. Scans of one body came to 0.16 to 0.23, range scans from a
# bench included, LiDAR and depth cameras to 0.7 and more, where all points gained nothing over their cells.
WELL_BELOW = 0.4


def all_points_say_more(sides: Sides, run: Run) -> bool:
    """Whether a run on the means of cells is worth going on with on all points."""
    if not sides.cell or run.ended_early or not run.weights.any():
        return False
    # Of a surface: that many points in as many cells, each the square of its edge.
    spacing = sides.cell * np.sqrt(len(sides.scan) / sides.scan.total)
    aside = np.sqrt(np.average(run.pairs.aside**2, weights=run.weights))
    return bool(aside < WELL_BELOW * spacing)


def go_on(
    sides: Sides, plan: Plan, run: Run, mixture: InlierMixture, observe: Observer | None
) -> tuple[Run, InlierMixture]:
    """Go on with other sides from where a run has ended."""
    done = len(run.history)
    plan = dataclasses.replace(plan, first_width=mixture.scale)
    numbered = None if observe is None else lambda record: observe(_later(record, done))
    last, mixture = run_graduated(sides.scan, sides.surface, run.T_target_source, plan, numbered)
    history = run.history + tuple(_later(record, done) for record in last.history)
    return dataclasses.replace(last, history=history), mixture


def _later(record: Iteration, by: int) -> Iteration:
    return dataclasses.replace(record, number=record.number + by)
