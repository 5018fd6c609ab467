"""Whether a loop is gone on from where it ended: on all points in place of cells, or until the pose stays."""

from __future__ import annotations

import numpy as np

from dqreg.geometry import Scan
from dqreg.registration.fallback import is_doubtful, may_search
from dqreg.registration.fit import Fit
from dqreg.registration.loop_status import status_of
from dqreg.solvers.status import INTERRUPTED

# Distances from the planes below this share of the spacing of all points: the points then stand nearer to the surface
# than to each other, and the mean of a cell hides something. Scans of one body came to 0.16 to 0.23, range scans from a
# bench included, LiDAR and depth cameras to 0.7 and more, where all points gained nothing over their cells.
WELL_BELOW = 0.4
# Noise below this share of the spacing of all points: what is off then is the target's planes where the surface bends
# away from them, and planes of the scan's own on the other side take it back. Of 40 random pairs of scanned parts the
# error fell to 0.13 to 0.4 there in the median; from twice as much on it gained nothing, above a third it rose.
CLEAN = 0.1
# Points of the scan a cell below which its mean hides nothing: all points of 5,000 to 20,000 on 40,000 cost half as
# much again, and left the error as it was on range scans, and larger on views of parts.
CROWDED = 3.0
# Points of the scan a cell above which a search costs less than a loop with all of them.
MOST = 10.0
# Ways of a loop to end from which it is gone on: motions that little holds come to rest slowly. A limit of fewer
# iterations than this is meant.
UNSETTLED, MEANT = ("iteration limit", "stalled"), 50


def all_points_say_more(fit: Fit) -> bool:
    """Whether a fit to cells, to the target's planes alone or with planes that are none is worth going on with."""
    prepared, run = fit.prepared, fit.run
    # A target of a few points has no planes.
    if run.ended_early or not run.weights.any() or not run.pairs.closest.normals.any():
        return False
    if not prepared.even:
        return fit.problem.both_are_clouds and is_clean(prepared.scan)
    spacing, smoothed = prepared.scan.spacing, 0.0
    if prepared.cell_size:
        if fit.problem.options.effort == "fast" and not is_clean(prepared.scan):
            # Of 90 random pairs of scanned parts cells left 1.07 to 1.27 times the error, in half of the time.
            return False
        if prepared.is_from_a_stand or prepared.scan.total < CROWDED * len(prepared.scan):
            return False
        # Noise that the cells of both were rid of is the points' still.
        smoothed = 2.0 * (prepared.scan.quiet or 0.0) ** 2
        # Of a surface: that many points in as many cells, each the square of its edge.
        spacing = prepared.cell_size * np.sqrt(len(prepared.scan) / prepared.scan.total)
    elif prepared.scan.noise < WELL_BELOW * spacing:
        # Its own planes have had their say, of points of one body as the target's.
        return False
    aside = np.sqrt(np.average(run.pairs.point_to_plane**2, weights=run.weights) + smoothed)
    return bool(aside < WELL_BELOW * spacing)


def in_doubt_on_all_points(fit: Fit) -> Fit:
    """The fit; where something speaks against cells of two clouds, that of all points if nothing does against it.

    Cells as wide as a tooth hold its flanks no more: they would leave to a search what the points themselves tell.
    """
    prepared = fit.prepared
    few = prepared.scan.total <= MOST * len(prepared.scan)
    if not prepared.cell_size or prepared.is_from_a_stand or not few or not may_search(fit) or not is_doubtful(fit):
        return fit
    other = on_all_points(fit)
    return other if other.found and not is_doubtful(other) else fit


def is_clean(scan: Scan) -> bool:
    """Whether the points of a scan stand so near to the surface that planes of both sides tell more than of one."""
    return scan.noise < CLEAN * scan.spacing


def on_all_points(fit: Fit) -> Fit:
    """The fit resumed on all points of both clouds."""
    problem, prepared = fit.problem, fit.problem.prepare_whole()
    if is_clean(prepared.scan):
        prepared = problem.prepare_even()
    settings = problem.options.icp_settings(fit.settings.max_distance, fit.constraints, even=prepared.even)
    return fit.resumed(fit.T_target_source, fit.run.mixture.scale, prepared=prepared, settings=settings)


def settled(fit: Fit) -> Fit:
    """The fit, gone on from once where the loop ended before the pose stayed where it was."""
    options, is_over = fit.problem.options, fit.problem.watch.is_over
    is_asked = options.method != "auto" or options.max_iterations < MEANT
    if not fit.found or is_over or is_asked or status_of(fit) not in UNSETTLED:
        return fit
    other = fit.resumed(fit.T_target_source, fit.run.mixture.scale)
    return other if other.found and status_of(other) not in (*UNSETTLED, *INTERRUPTED) else fit
