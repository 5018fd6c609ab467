"""Registration to what the scanner could see: hidden faces of a part do not attract, and walls show one side.

A search knows no signs of normals, and may lay a scan onto the other sides of walls. There the loop, which knows them,
finds nothing: the scan is laid by its points alone, and from there onto other sides.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg._statuses import INTERRUPTED
from dqreg.errors import InputError
from dqreg.geometry.normals import sample_rows
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import JUDGING_POINTS, limit_of, of_those_on
from dqreg.registration.other_poses.slides import losses_at
from dqreg.registration.other_poses.wall_sides import on_best_sides, rivals_of
from dqreg.registration.problem.target_index import TargetIndex
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.scoring import MAX_EQUAL_LOG_LIKELIHOOD, distances_at
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD, OPPOSITE_NORMAL_SHARE

# Runs at most: each starts with what can be seen at the pose of the last one.
RUNS = 3
# Scale of the kernel to start with, in scales at the end of the last run and in sizes of the part: the hidden faces may
# have held the pose off by the thickness of a wall.
WIDER, WIDEST = 3.0, 0.01
# Refinement of another pose on the faces that it sees.
REFINEMENT_STEPS = 6


def on_visible_faces(fit: Fit, viewpoints: FloatArray) -> Fit:
    """Register again, to the faces that can be seen at the pose found, until those stay the same.

    Shapes: viewpoints (k, 3), in the caller's source frame.
    """
    for _ in range(RUNS):
        if not fit.found or fit.problem.watch.is_over or fit.run.status in INTERRUPTED:
            break
        target = fit.problem.visible_from(viewpoints, fit.T_target_source)
        if _same_faces(target, fit.target):
            break
        kernel_scale = max(WIDER * fit.run.mixture.scale, WIDEST * target.surface.diagonal)
        fit = fit.resumed(
            fit.T_target_source,
            None if fit.settings.fine is None else kernel_scale,
            prepared=dataclasses.replace(fit.prepared, surface=target.surface),
            target=target,
        )
    return fit


def is_worse_where_seen(fit: Fit, T_target_source: FloatArray) -> bool:
    """Whether a pose explains the scan worse than the fit, each by the faces that could be seen from there.

    It was found on all faces, of which hidden ones may have held it off: it is led to those that it sees first.
    """
    viewpoints, surface = fit.problem.viewpoints, fit.prepared.surface
    if viewpoints is None or fit.problem.watch.is_over:
        return False
    try:
        there = fit.problem.visible_from(viewpoints, T_target_source).surface
    except InputError:
        # No face of the part would be seen, and the scan shows some.
        return True
    points, limit = fit.prepared.scan.points, limit_of(fit)
    last = max(fit.run.mixture.scale, fit.floor)
    how = Refinement(WIDEST * surface.diagonal, REFINEMENT_STEPS, last=last)
    refined = Poses.of(refined_on(T_target_source[None], points, there, how, unit=1.0))
    asked = points[sample_rows(len(points), JUDGING_POINTS)]
    here = distances_at(Poses.of(fit.T_target_source[None]), asked, surface, limit)
    scores = of_those_on(fit, np.concatenate([here, distances_at(refined, asked, there, limit)]))[0]
    return bool(scores.deficit(0)[0][1] > MAX_EQUAL_LOG_LIKELIHOOD)


def _same_faces(one: TargetIndex, other: TargetIndex) -> bool:
    if one.visible is None or other.visible is None:
        return one.visible is other.visible
    return np.array_equal(one.visible, other.visible)


def on_shown_sides(fit: Fit) -> Fit:
    """The fit, or where its normals look away from what it lies on, that to sides of walls which look their way.

    As likely by the points alone: normals that were given inside out, or by a wrong viewpoint, are told as before.
    """
    if fit.problem.start is not None or not _looks_away(fit):
        return fit
    scan = dataclasses.replace(fit.prepared.scan, oriented=False)
    blind = fit.resumed(
        fit.T_target_source, fit.settings.first_kernel_scale, prepared=replaced(fit.prepared, scan=scan)
    )
    if not blind.found:
        return fit
    best = on_best_sides(blind)
    known = [best, *rivals_of(best), *(() if best is blind else (blind, *rivals_of(blind)))]
    losses = np.concatenate([[0.0], losses_at(best, np.stack([other.T_target_source for other in known]))])
    for k in np.argsort(losses, kind="stable"):
        if losses[k] > losses.min() + CONSTRAINT_LOG_LIKELIHOOD:
            break
        shown = fit.resumed(known[k].T_target_source, known[k].run.mixture.scale)
        if shown.found and not _looks_away(shown):
            return shown
    return fit


def _looks_away(fit: Fit) -> bool:
    """Whether most normals of known sides look the other way than what they lie on."""
    return bool(fit.run.pairs.looking_away(fit.settings.max_distance) > OPPOSITE_NORMAL_SHARE)
