"""The ICP loop and its parts.

`Icp` is the loop at one width of its robust kernel; `run_graduated` takes it from a rough start to the last digit.
Estimators, kernels, weights and stopping rules are values that can be exchanged.
"""

from __future__ import annotations

from dqreg.icp.coarse_to_fine import COARSE, find_basin, run_graduated, width_floor
from dqreg.icp.constrained import constrained
from dqreg.icp.correspondences import Pairs, carried, correspond
from dqreg.icp.estimators import ESTIMATORS, Estimator, points_and_normals, points_only, points_to_planes, svd_points
from dqreg.icp.level import Level, Plan, Schedule
from dqreg.icp.loop import Icp, Observer, Run
from dqreg.icp.rejectors import NormalAngle, Robust, Trimmed, WithinDistance
from dqreg.icp.stopping import Stopping
from dqreg.solvers.robust import Huber, InlierMixture, LeastSquares, Tukey, Welsch
from dqreg.solvers.status import NO_POSE

__all__ = [
    "COARSE",
    "ESTIMATORS",
    "NO_POSE",
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
    "carried",
    "constrained",
    "correspond",
    "find_basin",
    "points_and_normals",
    "points_only",
    "points_to_planes",
    "run_graduated",
    "svd_points",
    "width_floor",
]
