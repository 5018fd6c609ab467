"""Drifts: of a scan while it was taken, which its residuals show, and along motions that nothing constrains."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.icp import find_correspondences
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.slides import SLIDE, slide_of
from dqreg.rigid import pose
from dqreg.solvers.motion_words import Vector
from dqreg.trust import without_free_motion
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD
from dqreg.trust.patch_tests import INLIER_SIGMAS
from dqreg.trust.segments import OFF_WIDTHS
from dqreg.trust.strain import MIN_DRIFT_DIAGONALS, drift_of

# Fraction of the inliers that must remain where a drift along an unconstrained motion is taken back.
STAYS = 0.99
# Share of a displacement during the scan that its residuals show at least: 0.29 of its range, 0.58 of its direction.
SHOWN = 0.15
# Points from which a drift along the scan is fitted.
DRIFTING = 3_000
# No direction, and no drift.
STILL: Vector = (0.0, 0.0, 0.0)
NO_DRIFT = (0.0, 0.0, STILL)


def drift_at(fit: Fit) -> tuple[float, float, Vector]:
    """Significant displacement, rotation and direction of a drift along a scan, by the times or order of its points."""
    surface, source = fit.prepared.surface, fit.problem.source
    count, times = len(source.cloud), moments(source.cloud.times)
    # Between the points of two clouds planes are guesses: their order alone tells nothing.
    if not fit.found or fit.is_late or (fit.between_clouds and times is None) or source.mesh:
        return NO_DRIFT
    if fit.agreement.width < SHOWN * MIN_DRIFT_DIAGONALS * surface.diagonal:
        # A drift that matters would have left larger residuals.
        return NO_DRIFT
    rows = sample_rows(count, DRIFTING)
    placed = pose.apply(fit.T_target_source, source.cloud._at(rows))
    order = distinct_in_order(placed)
    placed, times = placed[order], rows[order] / count - 0.5 if times is None else times[rows[order]]
    closest = surface.closest(placed)
    # Farther off, tables and clamps begin.
    near = closest.distances <= min(fit.agreement.near, OFF_WIDTHS * INLIER_SIGMAS * fit.run.mixture.scale)
    residuals = row_dots(placed - closest.points, closest.normals)[near]
    found = drift_of(closest.points[near], closest.normals[near], residuals, times[near])
    if not found.matters(surface.diagonal * fit.agreement.deviation_ratio):
        return NO_DRIFT
    return found.displacement, found.rotation_rad, found.along


def moments(times: FloatArray | None) -> FloatArray | None:
    """Times of points from -1/2 to 1/2; None where they tell nothing."""
    if times is None or not np.isfinite(times).all() or not np.ptp(times) > 0.0:
        return None
    return np.asarray((times - times.min()) / np.ptp(times) - 0.5)


def without_drift(fit: Fit, start: FloatArray) -> Fit:
    """The fit with unconstrained motions as the initial pose had them; as it is where that would lose inliers."""
    if not fit.found or fit.constraints.any or not fit.information.free.any():
        return fit
    slide = slide_of(fit)
    if np.isfinite(slide.by_rims):
        return fit
    run = fit.run
    T = without_free_motion(run.T_target_source, start, fit.information)
    pairs = find_correspondences(run.pairs.scan, fit.prepared.surface, T)
    weights = np.where(run.weights > 0.0, run.mixture.weight(pairs.distances), 0.0)
    if pairs.scan.counts is not None:
        weights *= pairs.scan.counts
    if weights.sum() < STAYS * run.weights.sum():
        return fit
    moved = replaced(fit, run=replaced(run, T_target_source=T, pairs=pairs, weights=weights))
    if slide.loss < CONSTRAINT_LOG_LIKELIHOOD:
        # What held too little before holds as little now: the verdict refuses it, and it is not asked for again.
        moved.derived.put(SLIDE, replaced(slide, best=None))
    return moved
