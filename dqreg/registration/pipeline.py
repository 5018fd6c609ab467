"""The stages of a registration in their order: from a `Problem` by way of a `Fit` to a `Registration`."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from dqreg._records import replaced
from dqreg._statuses import SearchStage
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.icp.rejectors import beyond_boundary
from dqreg.kernels.threads import Later, TimeUpError, until
from dqreg.registration.assessment.assess import Uncertainty, evidence_of, uncertainty_of, verdict_on
from dqreg.registration.assessment.drift import without_drift
from dqreg.registration.choice.alternatives import alternatives_of, on_other_sides
from dqreg.registration.choice.corner_rivals import beside_corners
from dqreg.registration.choice.fallback import BestPoses, best_known, is_doubtful
from dqreg.registration.choice.kept_start import but_start_kept, held_at_start, meant_copy
from dqreg.registration.continued_fit import all_points_say_more, in_doubt_on_all_points, on_all_points, settled
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.initial_pose import GlobalSearch, InitialPose, initial_pose
from dqreg.registration.other_poses.ring_rivals import best_on_ring
from dqreg.registration.other_poses.rivals import (
    NO_POSES,
    best_near_symmetric,
    best_seen,
    down_to_noise,
    limit_of,
    mirror_gain,
)
from dqreg.registration.other_poses.same_poses import but_on_the_way
from dqreg.registration.other_poses.slides import without_slide
from dqreg.registration.other_poses.wall_sides import equal_sides, on_best_sides
from dqreg.registration.overlap.cloud_overlap import begin_judging, begun_to_judge, prepared_to_judge
from dqreg.registration.overlap.common_faces import on_common_faces
from dqreg.registration.overlap.free_space import viewpoint_behind
from dqreg.registration.problem.problem import Problem, SourceAndTarget
from dqreg.registration.remarks import UNJUDGED, remarked_on_guesses, remarked_on_inputs
from dqreg.registration.result.result import Registration
from dqreg.registration.visibility import on_shown_sides, on_visible_faces
from dqreg.trust import judge
from dqreg.trust.records import Alternative, Verdict

# Share of the inliers below which they may hold a motion at a wrong place. In doubt all motions are asked: a step on
# its neighbour's place holds the others there too.
MAY_HOLD = 1.0


def align(problem: Problem) -> Registration:
    """Pose, uncertainty and verdict of a problem."""
    watch, options = problem.watch, problem.options
    with watch.stage("prepare"):
        prepared = prepared_to_judge(problem) if options.verdict else problem.prepare()
    search = GlobalSearch.of(problem, prepared)
    with watch.stage("start"):
        start = initial_pose(problem, search)
    with watch.stage("register"):
        prepared = problem.prepare_found(prepared)
        constraints = problem.constraints(start.T_target_source)
        settings = options.icp_settings(
            problem.max_distance(prepared), constraints, start.kernel_scale, even=prepared.even
        )
        fit = coarse_to_fine(problem, prepared, start.T_target_source, settings, constraints)
        if not fit.found and options.verdict:
            fit = on_shown_sides(fit)
        if all_points_say_more(fit):
            with suppress(TimeUpError), until(watch.deadline):
                fit = on_all_points(fit)
        fit = best_seen(fit, start.T_target_source)
        if options.verdict:
            fit = begun_to_judge(fit)
    if options.keep_inputs:
        # Beside what is asked about the pose.
        Later(problem.kept)
    if not options.verdict:
        return not_judged(fit)
    with watch.stage("second try"):
        problem.await_target()
        is_lost = problem.start is not None and not fit.found
        known = replaced(second_try(fit, start, search), start_lost=is_lost)
        fit, gain = settled(known.fit), -np.inf
        with suppress(TimeUpError), until(watch.deadline):
            fit = on_common_faces(fit)
            gain = mirror_gain(fit, always=known.searched)
    return concluded(seen_alone(fit), fit, known, start.search, gain)


def seen_alone(fit: Fit) -> Fit:
    """The fit on the faces that could be seen, where viewpoints were given."""
    if fit.problem.viewpoints is None:
        return fit
    with fit.problem.watch.stage("viewpoint"):
        return on_visible_faces(fit, fit.problem.viewpoints)


def concluded(fit: Fit, whole: Fit, known: BestPoses, search: SearchStage, gain: float) -> Registration:
    """The answer; where the time is up before all is known that two clouds say, as of a loop that the limit ended.

    Whole is the fit to all faces, where this one is to those that could be seen.
    """
    found, deadline = None, fit.problem.watch.deadline
    with suppress(TimeUpError), until(deadline if fit.between_clouds else np.inf):
        found = judged(fit, whole, known, search, gain)
    if found is None:
        fit = fit.late()
        found = judged(fit, whole, known, search, gain)
    fit.problem.watch.end()
    return registration_of(fit, *found)


def judged(
    fit: Fit, whole: Fit, known: BestPoses, search: SearchStage, gain: float
) -> tuple[Uncertainty, Verdict, tuple[Alternative, ...]]:
    """How sure a fit is, and the other poses known that explain the scan as well."""
    uncertainty = uncertainty_of(fit)
    alternatives = alternatives_of(fit, whole, known.others, equal_sides(fit), known.turned)
    evidence = evidence_of(fit, uncertainty, alternatives, search=search, mirror_gain=gain)
    verdict = remarked_on_guesses(verdict_on(fit, evidence), fit, start_lost=known.start_lost)
    return uncertainty, verdict, alternatives


def not_judged(fit: Fit) -> Registration:
    """The answer where the loop ended, with its covariance; where there is no pose the verdict says why."""
    fit.problem.await_target()
    fit = seen_alone(fit)
    uncertainty = uncertainty_of(fit, by_rims=False)
    verdict = UNJUDGED if fit.found else judge(fit.agreement)
    fit.problem.watch.end()
    return registration_of(fit, uncertainty, verdict, ())


def second_try(fit: Fit, start: InitialPose, search: GlobalSearch) -> BestPoses:
    """The best of a fit, its near symmetries and, where that is in doubt, of a search; of what there is time for.

    Each step may be the last one, where the time is up: what is known after it is the answer.
    """
    is_given, kernel_scale = fit.problem.start is not None, search.kernel_scale
    T_given = start.T_target_source if is_given else None
    begun, known, equals = fit, BestPoses(fit, start.others), NO_POSES
    with suppress(TimeUpError), until(fit.problem.watch.deadline):
        fit, _ = without_slide(down_to_noise(fit))
        known = BestPoses(fit, start.others)
        if T_given is not None:
            begin_judging(fit)
            fit, equals = best_near_symmetric(fit, kernel_scale, T_given)
            # What is asked of a pose is asked of the answer, with its unconstrained motions as they were given.
            fit = held_at_start(without_drift(fit, T_given), T_given)
            known = BestPoses(begun := fit, start.others)
        fit = in_doubt_on_all_points(fit)
        known = best_known(fit, start, search)
        if is_doubtful(known.fit):
            known = replaced(known, fit=without_slide(known.fit, MAY_HOLD)[0])
        is_other = known.fit is not fit
        if is_other or (not is_given and not fit.between_clouds):
            # A search sees a sample: few points may tell its pose from a nearly symmetric one that it missed.
            best, equals = best_near_symmetric(known.fit, kernel_scale, T_given)
            known = replaced(known, fit=best)
        best, turned = best_on_ring(known.fit, T_given, kernel_scale)
        known = replaced(known, fit=on_best_sides(best), turned=turned)
        if T_given is not None:
            meant, copies = meant_copy(known.fit, T_given, kernel_scale)
            known, equals = replaced(known, fit=meant), np.concatenate([equals, copies])
        equals = but_on_the_way(known.fit, equals, kernel_scale)
        equals = np.concatenate([equals, on_other_sides(known.fit, start.behind, kernel_scale)])
    known = replaced(known, others=np.concatenate([known.others, equals]))
    if T_given is not None:
        known = but_start_kept(begun, replaced(known, fit=without_drift(known.fit, T_given)), T_given, kernel_scale)
    return beside_corners(known, T_given)


def registration_of(
    fit: Fit, uncertainty: Uncertainty, verdict: Verdict, alternatives: tuple[Alternative, ...]
) -> Registration:
    """The answer, in the caller's frames."""
    problem = fit.problem
    # Not those points of a cloud alone for which there was time.
    sides = SourceAndTarget(problem.source, problem.whole if fit.between_clouds else fit.target)
    return Registration(
        T_target_source=problem.to_caller(fit.T_target_source) if fit.found else np.full((4, 4), np.nan),
        verdict=remarked_on_inputs(verdict, problem),
        status=fit.run.status,
        covariance=uncertainty.covariance,
        observability=uncertainty.directions,
        alternatives=alternatives,
        history=problem.history_in_caller_frames(fit.run.history),
        rms=fit.run.rms,
        inlier_fraction=fit.run.inlier_fraction,
        timings=problem.watch.seconds,
        settings={**problem.asked, "cell_size": fit.prepared.cell_size, **resolved(fit)},
        inputs=sides.kept() if problem.options.keep_inputs else None,
        partial_information=uncertainty.partial_information,
    )


def resolved(fit: Fit) -> dict[str, Any]:
    """Lengths, counts and kinds that followed from the data."""
    source, target, scan, pairs = fit.problem.source, fit.target, fit.prepared.scan, fit.run.pairs
    max_distance, width = fit.settings.max_distance, fit.run.mixture.scale
    behind = viewpoint_behind(fit.problem)
    place = source.viewpoint if fit.problem.viewpoints is None else None
    beyond = beyond_boundary(pairs, fit.prepared.surface, width, max_distance) if fit.found else np.zeros(0)
    return {
        "max_distance": max_distance,
        "reach": limit_of(fit),
        "width": width,
        "source_noise": noise_on(scan, fit.prepared.surface),
        "source_spacing": scan.spacing,
        "source_points": scan.total,
        "source_dropped": source.cloud.dropped,
        "source_scale": source.scale,
        "used_points": round(pairs.scan.represented),
        "beyond_border": int(np.count_nonzero(beyond)),
        "normals_oriented": pairs.same_sign,
        **({} if np.isnan(behind) else {"viewpoint_behind": behind}),
        **({} if place is None else {"source_viewpoint": place.tolist()}),
        "target_kind": target.kind,
        "target_dropped": target.geometry.dropped,
        "diagonal": fit.prepared.surface.diagonal,
        "centre": target.origin.tolist(),
    }
