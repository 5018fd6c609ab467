"""The ICP loop and its parts.

`Icp` is the loop at one scale of its robust kernel; `align_coarse_to_fine` runs it from a rough initial pose to the
last digit.
Estimators, kernels, weights and stopping rules are values that can be exchanged.
"""

from __future__ import annotations

from dqreg._statuses import NO_POSE
from dqreg.icp.coarse_to_fine import COARSE_POINTS, align_coarse_to_fine, smallest_kernel_scale
from dqreg.icp.constrained_estimator import constrained
from dqreg.icp.correspondences import Correspondences, find_correspondences, propagate
from dqreg.icp.estimators import ESTIMATORS, Estimator, points_and_normals, points_only, points_to_planes, svd_points
from dqreg.icp.level import AnnealingSchedule, IcpSettings, Level
from dqreg.icp.loop import Alignment, Icp, Observer, Run
from dqreg.icp.rejectors import NormalAngle, Robust, Trimmed, WithinDistance
from dqreg.icp.stopping import Stopping
from dqreg.solvers.robust import Huber, InlierMixture, LeastSquares, Tukey, Welsch

__all__ = [
    "COARSE_POINTS",
    "ESTIMATORS",
    "NO_POSE",
    "Alignment",
    "AnnealingSchedule",
    "Correspondences",
    "Estimator",
    "Huber",
    "Icp",
    "IcpSettings",
    "InlierMixture",
    "LeastSquares",
    "Level",
    "NormalAngle",
    "Observer",
    "Robust",
    "Run",
    "Stopping",
    "Trimmed",
    "Tukey",
    "Welsch",
    "WithinDistance",
    "align_coarse_to_fine",
    "constrained",
    "find_correspondences",
    "points_and_normals",
    "points_only",
    "points_to_planes",
    "propagate",
    "smallest_kernel_scale",
    "svd_points",
]
