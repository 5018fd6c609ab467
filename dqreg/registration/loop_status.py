"""How the loop of a fit ended, as far as the noise of the scan can tell."""

from __future__ import annotations

import numpy as np

from dqreg.geometry.normals import sample_rows
from dqreg.registration.fit import Fit
from dqreg.rigid import pose
from dqreg.solvers.status import Status
from dqreg.trust import without_free_motion

# Iterations at the end of a run that stalled, and the share of the width of the inliers within which they stay where it
# goes to and fro over a point that is an inlier in one of two poses: it has converged as far as the noise can tell.
LAST_ITERATIONS, OSCILLATION_WIDTHS = 10, 0.1
# Points whose displacement tells it.
ASKED_POINTS = 100


def status_of(fit: Fit) -> Status:
    """How the loop ended; converged too where it goes to and fro by less than the noise, but for what nothing holds."""
    history, scan, T = fit.run.history, fit.prepared.scan, fit.T_target_source
    if fit.run.status != "stalled" or len(history) < LAST_ITERATIONS:
        return fit.run.status
    points = scan.points[sample_rows(len(scan), ASKED_POINTS)]
    here = pose.apply(T, points)
    ended = (without_free_motion(record.T_target_source, T, fit.information) for record in history[-LAST_ITERATIONS:])
    moved = (pose.apply(each, points) - here for each in ended)
    farthest = max(float(np.sqrt((each**2).sum(axis=1).mean())) for each in moved)
    return "converged" if farthest <= OSCILLATION_WIDTHS * fit.run.mixture.scale else "stalled"
