"""How the loop of a fit ended, as far as the noise of the scan can tell."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import Status
from dqreg.geometry.normals import sample_rows
from dqreg.registration.fit.fit import Fit
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.trust import without_free_motion

# Iterations at the end of a run that stalled, and the share of the width of the inliers within which they stay where it
# goes to and fro over a point that is an inlier in one of two poses: it has converged as far as the noise can tell.
LAST_ITERATIONS, OSCILLATION_WIDTHS = 10, 0.1
# So it has within so many standard deviations of the pose: along a motion that five points hold, one of them is much.
OSCILLATION_SIGMAS = 1.0
# Points whose displacement tells it.
ASKED_POINTS = 100
# The least variance to divide by.
TINY = float(np.finfo(np.float64).tiny)


def status_of(fit: Fit) -> Status:
    """How the loop ended; converged too where it goes to and fro within the noise, but for what nothing holds."""
    history, scan, T = fit.run.history, fit.prepared.scan, fit.T_target_source
    if fit.run.status != "stalled" or len(history) < LAST_ITERATIONS:
        return fit.run.status
    ended = [without_free_motion(record.T_target_source, T, fit.information) for record in history[-LAST_ITERATIONS:]]
    points = scan.points[sample_rows(len(scan), ASKED_POINTS)]
    here = pose.apply(T, points)
    farthest = max(float(np.sqrt(((pose.apply(each, points) - here) ** 2).sum(axis=1).mean())) for each in ended)
    if farthest > OSCILLATION_WIDTHS * fit.run.mixture.scale and _sigmas(fit, ended) > OSCILLATION_SIGMAS:
        return "stalled"
    return "converged"


def _sigmas(fit: Fit, poses: list[FloatArray]) -> float:
    """How far the farthest of some poses is from that of a fit, in its standard deviations, whatever the direction."""
    known, back = fit.information, pose.inverse(fit.T_target_source)
    held = known.vectors[:, ~known.free]
    moved = np.stack([twist.log(T @ back) * scaling_by(known.lever) for T in poses]) @ held
    values, axes = np.linalg.eigh(held.T @ known.spread @ held)
    return float(np.linalg.norm(moved @ axes / np.sqrt(np.maximum(values, TINY)), axis=1).max())
