"""The ICP loop and its parts.

`Icp` is the loop at one scale of its robust kernel; `align_coarse_to_fine` runs it from a rough initial pose to the
last digit.
Estimators, kernels, weights and stopping rules are values that can be exchanged.
"""

from __future__ import annotations

from dqreg.icp.coarse_to_fine import COARSE, align_coarse_to_fine, find_basin, width_floor
from dqreg.icp.constrained import constrained
from dqreg.icp.correspondences import Pairs, carried, correspond
from dqreg.icp.estimators import ESTIMATORS, Estimator, points_and_normals, points_only, points_to_planes, svd_points
from dqreg.icp.level import Level, Plan, Schedule
from dqreg.icp.loop import Alignment, Icp, Observer, Run
from dqreg.icp.rejectors import NormalAngle, Robust, Trimmed, WithinDistance
from dqreg.icp.stopping import Stopping
from dqreg.solvers.robust import Huber, InlierMixture, LeastSquares, Tukey, Welsch
from dqreg.solvers.status import NO_POSE

__all__ = [
    "COARSE",
    "ESTIMATORS",
    "NO_POSE",
    "Alignment",
    "Estimator",
    "Huber",
    "Icp",
    "InlierMixture",
    "LeastSquares",
    "Level",
    "NormalAngle",
    "Observer",
    "Pairs",
    "Plan",
    "Robust",
    "Run",
    "Schedule",
    "Stopping",
    "Trimmed",
    "Tukey",
    "Welsch",
    "WithinDistance",
    "align_coarse_to_fine",
    "carried",
    "constrained",
    "correspond",
    "find_basin",
    "points_and_normals",
    "points_only",
    "points_to_planes",
    "svd_points",
    "width_floor",
]
