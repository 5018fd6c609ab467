"""Whether a loop is gone on from where it ended: on all points in place of cells, or until the pose stays."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import median
from dqreg._statuses import INTERRUPTED
from dqreg.geometry import PointCloud, Scan
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.morton import morton_codes
from dqreg.geometry.normals import sample_rows
from dqreg.registration.choice.fallback import is_doubtful, may_search
from dqreg.registration.fit.fit import Fit
from dqreg.registration.fit.loop_status import status_of
from dqreg.rigid import pose
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# Usual distance from the planes below this share of the edge of the cells: means of cells then hide more of the shape
# than they rid of noise. Of simulated bodies and parts of 18,000 to 120,000 points all points came nearer below, up to
# tenfold without noise, and above cells did, up to fivefold, in a third of the time.
FINE = 0.02
# The same of the wider cells of the fast effort, which does not go on from where the normal one stays.
FINE_OF_FAST = 0.015
# Distances below this share of the spacing of clouds with planes at all points: these stand nearer to the surface than
# to each other.
WELL_BELOW = 0.4
# Noise below this share of the spacing of all points: what is off then is the target's planes where the surface bends
# away from them, and planes of the scan's own on the other side take it back. Of 40 random pairs of scanned parts the
# error fell to 0.13 to 0.4 there in the median; from twice as much on it gained nothing, above a third it rose.
CLEAN = 0.1
# Points of the source that are looked for in the target's cells.
ASKED_POINTS = 400
# So near to one of the target, in spacings, one is its copy, and more than such a share of them is no chance: of points
# strewn anew it is 0.03.
COPY_SPACINGS, COPIED_SHARE = 0.1, 0.2
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
    if prepared.cell_size:
        is_fast = fit.problem.options.effort == "fast"
        if prepared.is_from_a_stand or (is_fast and not is_clean(prepared.scan)):
            return False
        usual = GAUSSIAN_MEDIAN * median(np.abs(run.pairs.point_to_plane[run.weights > 0.0]))
        return usual < (FINE_OF_FAST if is_fast else FINE) * prepared.cell_size or _are_copies(fit)
    if prepared.scan.noise < WELL_BELOW * prepared.scan.spacing:
        # Its own planes have had their say, of points of one body as the target's.
        return False
    aside = np.sqrt(np.average(run.pairs.point_to_plane**2, weights=run.weights))
    return bool(aside < WELL_BELOW * prepared.scan.spacing)


def _are_copies(fit: Fit) -> bool:
    """Whether points of the source lie on points of the target: without cells the pose is exact then, noise and all."""
    surface, geometry, cloud = fit.prepared.surface, fit.target.geometry, fit.problem.source.cloud
    if not isinstance(surface, CellSurface) or not isinstance(geometry, PointCloud):
        return False
    cells, some = surface.cells, sample_rows(len(cloud), ASKED_POINTS)
    moved = pose.apply(fit.T_target_source, cloud._at(some))
    codes = morton_codes(moved, cells.size, geometry._ends)
    rows = np.minimum(np.searchsorted(cells.codes, codes), len(cells.codes) - 1)
    filled = cells.codes[rows] == codes
    rows, moved = rows[filled], moved[filled]
    if not len(rows):
        return False
    counts = cells.counts[rows].astype(np.int64)
    firsts = np.cumsum(counts) - counts
    each = np.repeat(cells.starts[rows] - firsts, counts) + np.arange(int(counts.sum()))
    squares = ((geometry.points[cells.order[each]] - np.repeat(moved, counts, axis=0)) ** 2).sum(axis=1)
    nearest = np.sqrt(np.minimum.reduceat(squares, firsts))
    spacing = cells.size / np.sqrt(cells.counts.mean())
    return bool((nearest < COPY_SPACINGS * spacing).mean() > COPIED_SHARE)


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
