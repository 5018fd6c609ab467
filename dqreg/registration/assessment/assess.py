"""How far a fit can be trusted: its uncertainty, and the evidence for the verdict, each made in one call."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg._records import replaced
from dqreg.geometry import PointCloud, Surface
from dqreg.geometry.morton import distinct_in_order
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.icp import find_correspondences
from dqreg.registration.assessment.one_way_constraints import held_both_ways
from dqreg.registration.constrained_motions import own_normals
from dqreg.registration.fit.fit import Fit
from dqreg.registration.fit.loop_status import status_of
from dqreg.registration.other_poses.exposures import second_pose
from dqreg.registration.other_poses.rivals import gain_if_freed
from dqreg.registration.other_poses.slides import SLIDE, slide_of
from dqreg.registration.other_poses.wall_sides import may_confuse_sides
from dqreg.registration.overlap.cloud_overlap import evidence_between_clouds, have_planes_alone, planes_of
from dqreg.registration.overlap.common_faces import OVERLAP, begin_sampling, overlap_at, spread_on_common_faces
from dqreg.registration.overlap.free_space import begin_free_space, looked_through_at, viewpoint_behind
from dqreg.registration.problem.derived_values import Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import Problem
from dqreg.rigid import pose
from dqreg.solvers.motion_words import Vector
from dqreg.solvers.search_stage import SearchStage
from dqreg.trust import (
    Evidence,
    Information,
    covariance_of,
    judge,
    observe_directions,
    without_free_motion,
)
from dqreg.trust.covariance import partial_information_of
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD, MIRROR_GAIN, is_rough
from dqreg.trust.neighbourhoods import is_flat
from dqreg.trust.patch_tests import INLIER_SIGMAS
from dqreg.trust.records import Alternative, Direction, Verdict
from dqreg.trust.segments import OFF_WIDTHS
from dqreg.trust.strain import MIN_DRIFT_DIAGONALS, drift_of

# Fraction of the inliers that must remain where a drift along an unconstrained motion is taken back.
STAYS = 0.99
# Share of a displacement during the scan that its residuals show at least: 0.29 of its range, 0.58 of its direction.
SHOWN = 0.15
# Points from which a drift along the scan is fitted.
DRIFTING = 3_000
# A scan whose inliers spread less than this share of the target's spread shows a detail of it; points that tell.
PARTIAL, SPREAD = 0.6, 2_000
# A scan whose standard deviation across its plane is below so many widths of its distances is flat.
FLAT_WIDTHS = 2.0
# No direction, and no drift.
STILL: Vector = (0.0, 0.0, 0.0)
NO_DRIFT = (0.0, 0.0, STILL)


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """How sure a pose is."""

    covariance: FloatArray  # (6, 6): See `Registration.covariance`
    directions: tuple[Direction, ...]  # The six motions, the weakest first
    partial_information: FloatArray | None = None  # (6, 6): See `Registration.partial_information`

    @staticmethod
    def of(information: Information, units: str | None = None) -> Uncertainty:
        """What follows from the information of the six motions; words name lengths in those units."""
        is_free = information.free.any() and np.isnan(information.by_rims)
        partial = partial_information_of(information) if is_free else None
        return Uncertainty(covariance_of(information), observe_directions(information, units), partial)


UNCERTAINTY: Key[Uncertainty] = Key(of_pose=True)
MEASURED: Key[Evidence] = Key()
IS_PARTIAL: Key[bool] = Key()
VERDICTS: Key[list[tuple[Evidence, Verdict]]] = Key()


def uncertainty_of(fit: Fit, *, by_rims: bool = True) -> Uncertainty:
    """Covariance and observability of a fit; NaN and none where no pose was found.

    It may be left out how the rims of a part hold what no normal constrains: the pose is displaced to learn that.
    """
    if not fit.found:
        return Uncertainty(np.full((6, 6), np.nan), ())

    def uncertainty() -> Uncertainty:
        # The pose errs by so much more as residuals follow less of a displacement.
        known, share = fit.information, fit.followed
        scatter, inflation = known.scatter, fit.inflation
        if inflation is not None:
            scatter = inflation @ known.spread @ inflation.T
        scatter = None if scatter is None else scatter / share**2
        of_both = spread_on_common_faces(fit, known)
        scatter = scatter if of_both is None else of_both
        scatter = held_both_ways(fit, known, known.spread / share**2 if scatter is None else scatter)
        rims = slide_of(fit).by_rims if by_rims else np.nan
        known = replaced(known, sigma=known.sigma / share, scatter=scatter, by_rims=rims)
        return Uncertainty.of(known, fit.problem.units[1])

    return fit.derived.once(UNCERTAINTY, uncertainty)


def evidence_of(
    fit: Fit,
    uncertainty: Uncertainty,
    alternatives: tuple[Alternative, ...] = (),
    *,
    search: SearchStage = "",
    mirror_gain: float = -np.inf,
) -> Evidence:
    """All that the verdict on a fit is made of; see `Evidence` for the meaning of each number."""
    measured = fit.derived.once(MEASURED, lambda: _measured(fit, uncertainty.covariance))
    if fit.constraints.any and (mirror_gain > MIRROR_GAIN or is_rough(measured)):
        gain, rad, shift = gain_if_freed(fit)
        measured = replaced(measured, freed_gain=gain, freed_rad=rad, freed_shift=shift)
    if search and _may_be_turned_over(fit):
        measured = replaced(measured, largest_plane=1.0)
    return replaced(
        measured,
        directions=uncertainty.directions,
        carriers=tuple(fit.information.carriers.tolist()) if uncertainty.directions else (),
        sliding_loss=slide_of(fit).loss,
        alternatives=alternatives,
        search=search,
        is_detail=measured.share_together > 0.0 and is_partial(fit),
        mirror_gain=mirror_gain,
    )


def _may_be_turned_over(fit: Fit) -> bool:
    """Whether the scan of a part lies in one plane and nothing tells its sides."""
    if not fit.found or fit.run.pairs.same_sign or fit.problem.viewpoints is not None or fit.between_clouds:
        return False
    points = fit.prepared.scan.points
    spreads = np.linalg.eigvalsh(np.cov(points[sample_rows(len(points), SPREAD)].T))
    return bool(spreads[0] <= (FLAT_WIDTHS * fit.run.mixture.scale) ** 2)


def _measured(fit: Fit, covariance: FloatArray) -> Evidence:
    """What the fit and its covariance tell alone."""
    drift, drift_rad, drift_along = max(_drift(fit), (*second_pose(fit), STILL))
    looked_through, seen_alike = looked_through_at(fit, by_rays=have_planes_alone(fit))
    measured = evidence_between_clouds(fit, covariance)
    if measured.patches_deformed and may_confuse_sides(fit):
        # A face on the wrong side of its wall lies on the other one, but for where it bends.
        measured = replaced(measured, patches_deformed=0.0, share_deformed=0.0)
    return replaced(
        measured,
        status=status_of(fit),
        max_distance=fit.settings.max_distance,
        units=fit.problem.units[1],
        carriers_of_both=own_normals(fit.prepared.surface, fit.run.pairs) is not None,
        clutter=fit.problem.options.clutter,
        is_scene=fit.has_border or fit.is_scene,
        looked_through=looked_through,
        seen_alike=seen_alike,
        viewpoint_behind=viewpoint_behind(fit.problem),
        drift=drift,
        drift_rad=drift_rad,
        drift_along=drift_along,
    )


def begin_evidence(problem: Problem, surface: Surface, *, is_whole: bool) -> None:
    """Make what the evidence on a pose between two dense clouds will ask of them beside the loop, whatever the pose.

    The scan may be whole, where the target alone is so dense.
    """
    target = problem.target.geometry
    if isinstance(target, PointCloud):
        begin_sampling(problem, surface, target, is_whole=is_whole)
        begin_free_space(problem, target)


def begin_judging(fit: Fit) -> None:
    """Make what the evidence on a fit will ask first, beside what else is asked of it."""
    target = fit.target.geometry
    if fit.found and _is_worth_it(fit.prepared) and isinstance(target, PointCloud):
        # First what is asked first.
        fit.begin_information()
        fit.begin_agreement()
        fit.begin(OVERLAP, lambda: overlap_at(fit))


def begin_comparing(fit: Fit) -> None:
    """Make what takes longest of the evidence on two clouds, at a pose that will hardly change, beside the rest.

    Of many small steps nothing is: two threads that take turns at them take longer than one.
    """
    if not fit.found or fit.is_late or not _is_worth_it(fit.prepared) or fit.problem.options.time_limit is not None:
        return
    if not fit.between_clouds:
        return
    if (planes := planes_of(fit)) is not None:
        planes.begin()


def _is_worth_it(prepared: Prepared) -> bool:
    """Whether it pays to use another thread: of two dense clouds. Below, handing over costs more than it saves."""
    return prepared.cell_size > 0.0


def is_partial(fit: Fit) -> bool:
    """Whether the scan shows so little of the target that it may fit elsewhere, where no near symmetry leads to."""
    return fit.derived.once(IS_PARTIAL, lambda: _is_partial(fit))


def _is_partial(fit: Fit) -> bool:
    if not fit.found:
        return False
    rows = sample_rows(len(fit.run.weights), SPREAD)
    points, weights = np.take(fit.run.pairs.moved, rows, axis=0), fit.run.weights[rows]
    if not weights.any():
        return False
    total = float(weights.sum())
    arms = points - weights @ points / total
    spread = dot(weights, row_dots(arms, arms)) / total
    whole = float((fit.problem.target.spreads**2).sum())
    return bool(
        spread < PARTIAL**2 * whole
        or (
            is_flat(arms if (kept := weights > 0.0).all() else arms[kept])
            and not any(motion.is_free for motion in uncertainty_of(fit).directions)
        )
    )


def verdict_on(fit: Fit, evidence: Evidence) -> Verdict:
    """The verdict; what the second try has asked already is not asked again."""
    # Other poses are arrays, by which nothing is compared; and to hash an evidence takes longer than to compare two.
    if evidence.alternatives:
        return judge(evidence)
    judged = fit.derived.once(VERDICTS, list)
    for before, verdict in judged:
        if before == evidence:
            return verdict
    judged.append((evidence, judge(evidence)))
    return judged[-1][1]


def _drift(fit: Fit) -> tuple[float, float, Vector]:
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
