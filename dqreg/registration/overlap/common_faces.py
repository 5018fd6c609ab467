"""What two clouds show of one surface at a pose: asked by the verdict, and the last step to the pose."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg.geometry import CloudSurface, PointCloud, Surface
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, PlaneFits, sample_rows
from dqreg.icp.history import Iteration
from dqreg.registration.fit.fit import Fit
from dqreg.registration.problem.derived_values import Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import Problem
from dqreg.registration.problem.target_index import TargetIndex
from dqreg.rigid import pose
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust import Information
from dqreg.trust.overlap import IndexedPoints, Overlap
from dqreg.trust.patch_tests import INLIER_SIGMAS
from dqreg.trust.robust_fit import robust_fit, weights_of
from dqreg.trust.wall_places import without_walls

# Points of two clouds of which what is left between them is asked.
COMPARED = 30_000
# Steps to the pose at most.
MAX_STEPS = 2
# One is taken where what both show becomes more likely by so much; where only some points of the clouds are asked, the
# loop that saw all of them is believed rather, and it takes more.
MIN_LOG_GAIN, MIN_LOG_GAIN_OF_SAMPLE = 2.0, 15.0
# So it is where a smaller share of the points asked stands on what both show: the rings of a LiDAR on few faces (0.15;
# range scans 0.4 to 0.6).
MIN_COMMON_SHARE = 0.3
# Correspondences of a loop whose kernel stayed wide are of other faces too: they lie so many times farther off than the
# places. Of 92 right poses two came to 28 and 56, the others to 10.8 at most.
OTHER_FACES_RATIO = 16.0


Compared = tuple[IndexedPoints, IndexedPoints, Overlap | None]
OVERLAP: Key[Compared] = Key()
# Of a problem.
SAMPLED_SOURCE: Key[IndexedPoints] = Key()
INDEXED_TARGET: Key[IndexedPoints] = Key()
# Of a target: of its surface, or of so many of its points.
SURFACE_COMPARED: Key[IndexedPoints] = Key()
POINTS_COMPARED: Key[IndexedPoints] = Key()


def overlap_of(fit: Fit) -> Compared:
    """Both clouds of a fit, and where they show one smooth surface; None where that is hardly anywhere."""
    return fit.derived.once(OVERLAP, lambda: overlap_at(fit))


def overlap_at(fit: Fit) -> Compared:
    """The same, found anew."""
    target = fit.target.geometry
    assert isinstance(target, PointCloud)
    moves = _indexed_source(fit.problem, fit.prepared)
    # Where that was begun beside the loop, it is waited for.
    fit.problem.derived.once(INDEXED_TARGET, lambda: indexed_target(fit.target, fit.prepared.surface, target))
    stands = indexed_target(fit.target, fit.prepared.surface, target)
    overlap = Overlap.of(moves, stands, fit.T_target_source)
    if overlap is not None:
        overlap = without_walls(overlap, moves, stands, fit.T_target_source, fit.prepared.surface.diagonal)
    return moves, stands, overlap


def on_common_faces(fit: Fit) -> Fit:
    """The fit to two clouds, or that after motions which bring together what both show, where that is more likely.

    The loop compares points with their neighbours in the other cloud, which stand elsewhere on the surface, or on
    another face beside an edge. Distances along the mean of both normals, at places on one face of both, are free of
    that. From a stand they are few and near, and cells beyond them have their say in the loop alone.
    """
    if not fit.between_clouds or not fit.may_be_moved or fit.prepared.is_from_a_stand:
        return fit
    for _ in range(MAX_STEPS):
        began = time.perf_counter()
        if not fit.found or fit.is_late or fit.problem.watch.is_over:
            break
        moves, _, overlap = overlap_of(fit)
        if overlap is None or len(overlap.points) < MIN_COMMON_SHARE * len(moves.some[0]):
            break
        # Where most of that lies farther apart than what holds the pose, it is another face: the other side of a plate.
        if median(np.abs(overlap.residuals)) > INLIER_SIGMAS * fit.run.mixture.scale:
            break
        T, gain = overlap.best_step()
        if gain <= (MIN_LOG_GAIN_OF_SAMPLE if moves.is_sampled else MIN_LOG_GAIN):
            break
        other = fit.beside(T @ fit.T_target_source)
        found = overlap_at(other)
        after = 0 if found[2] is None else len(found[2].points)
        # A step that leaves less in common has left the place.
        if not other.found or after < len(overlap.points) - np.sqrt(len(overlap.points)):
            break
        fit = _recorded(fit, other, found, overlap.residuals, began)
    return fit


def spread_on_common_faces(fit: Fit, information: Information) -> FloatArray | None:
    """Covariance of the scaled twist, (6, 6), by what both clouds show, where that holds the pose and not the loop.

    None where the loop's correspondences lie about as near, or a step would be taken: what is known of the loop then.
    """
    if not fit.between_clouds or not fit.may_be_moved or fit.is_late or not fit.problem.options.verdict:
        return None
    if fit.prepared.is_from_a_stand or information.free.any():
        return None
    moves, _, overlap = overlap_of(fit)
    if overlap is None or len(overlap.points) < MIN_COMMON_SHARE * len(moves.some[0]):
        return None
    sigma = GAUSSIAN_MEDIAN * median(np.abs(overlap.residuals))
    if not information.sigma > OTHER_FACES_RATIO * sigma or overlap.best_step()[1] > MIN_LOG_GAIN:
        return None
    return _spread(overlap, information.lever)


def _spread(overlap: Overlap, lever: float) -> FloatArray | None:
    """Covariance of the twist about the origin that the places leave, scaled by a lever, (6, 6); None of too few."""
    points, normals, residuals = overlap.points, overlap.normals, overlap.residuals
    fit = robust_fit(plane_rows(points, normals, np.zeros(3), lever), residuals, lever, weights_of(residuals))
    scatter, weights = fit.scatter(points, normals), fit.weights
    # Weights w of a biweight fall as residuals grow: by 5 w - 4 sqrt(w) of a step each pull follows, not by w.
    followed = float((5.0 * weights - 4.0 * np.sqrt(weights)).sum() / weights.sum())
    return None if scatter is None else scatter / followed**2


def _recorded(before: Fit, fit: Fit, found: Compared, residuals: FloatArray, began: float) -> Fit:
    """A fit with the record of the step to it, which is told to whoever observes; residuals (n,) before the step."""
    run, problem, points = fit.run, fit.problem, fit.run.pairs.scan.points
    moved = pose.apply(fit.T_target_source, points) - pose.apply(before.T_target_source, points)
    square = float(np.mean(residuals**2))
    record = Iteration(
        number=run.next_number,
        stage="common faces",
        points=len(residuals),
        pairs=len(residuals),
        inlier_fraction=run.inlier_fraction,
        rms=math.sqrt(square),
        kernel_scale=run.mixture.scale,
        energy=square,
        turn_rad=float(pose.angle_between(before.T_target_source, fit.T_target_source)),
        motion=float(np.sqrt((moved**2).sum(axis=1).mean())) / fit.prepared.surface.diagonal,
        seconds=time.perf_counter() - began,
        T_target_source=fit.T_target_source,
    )
    observe = problem.watch.watching(problem.observer(problem.options.observe))
    if observe is not None:
        observe(record)
    stepped = dataclasses.replace(fit, run=dataclasses.replace(run, history=(*run.history, record)))
    stepped.derived.put(OVERLAP, found)
    return stepped


def sampled_source(problem: Problem) -> IndexedPoints:
    """Some points of the source, and planes at those that are compared."""
    points = problem.source.cloud.points
    found = IndexedPoints.of(np.take(points, sample_rows(len(points), COMPARED), axis=0))
    _ = found.some
    return found


def indexed_target(index: TargetIndex, surface: Surface, target: PointCloud) -> IndexedPoints:
    """Some points of the target, or all where they are few."""
    derived, points = index.derived, target.points
    # The same for every scan that is registered to it. In rings the neighbours of a point are on its own, where there
    # is no plane: means of cells are compared.
    in_rings = _are_few_in_rings(surface, target)
    is_whole = len(points) <= COMPARED and isinstance(surface, CloudSurface) and surface._distinct.given == len(points)
    if isinstance(surface, CloudSurface) and (in_rings or is_whole):
        known, stands = derived.known(SURFACE_COMPARED), surface._distinct
        if known is None or known.tree is not stands.tree:
            known = IndexedPoints(stands.points, stands.tree, is_remembered=not in_rings)
            derived.put(SURFACE_COMPARED, known)
        return known
    return derived.once(
        POINTS_COMPARED, lambda: IndexedPoints.of(np.take(points, sample_rows(len(points), COMPARED), axis=0))
    )


def _are_few_in_rings(surface: Surface, target: PointCloud) -> bool:
    """Whether a surface is of the cells of a LiDAR's rings, which are few, or of so few points that all are compared.

    Of a pair from a road cells were as wide as a deformation that is told of right poses then.
    """
    return isinstance(surface, CellSurface) and (surface.of_few_rings or (len(target) <= COMPARED and surface.in_rings))


def begin_sampling(problem: Problem, surface: Surface, target: PointCloud, *, is_whole: bool) -> None:
    """Make what is compared of two clouds beside the caller; planes of a small scan that is whole will be there."""
    problem.begin(INDEXED_TARGET, lambda: indexed_target(problem.target, surface, target))
    if _are_few_in_rings(surface, target):
        return
    if not is_whole or len(problem.source.cloud) > COMPARED:
        problem.begin(SAMPLED_SOURCE, lambda: sampled_source(problem))


def _indexed_source(problem: Problem, prepared: Prepared) -> IndexedPoints:
    scan = prepared.scan
    target = problem.target.geometry
    if isinstance(target, PointCloud) and _are_few_in_rings(prepared.surface, target):
        return problem.derived.once(SAMPLED_SOURCE, lambda: IndexedPoints(scan.points, scan.tree))
    if len(problem.source.cloud) > COMPARED or not prepared.is_whole:
        return problem.derived.once(SAMPLED_SOURCE, lambda: sampled_source(problem))
    # Planes of all points are there, unless normals were given in their place.
    is_fitted = scan.fitted is None and problem.source.cloud.normals is None
    planes = PlaneFits(scan.normals, scan.residuals, scan.levers, NORMAL_NEIGHBOURS) if is_fitted else None
    return IndexedPoints(scan.points, scan.tree, planes)
