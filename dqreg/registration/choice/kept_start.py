"""An initial pose is kept between two clouds, unless something speaks against it, and in a scene where it passes.

Means over points that some pose puts on the target compare poses by how much the clouds have in common there: a twin
that lays three faces on three beats the right pose that has one. A point where the other view did not look says
nothing; what a scanner looked through speaks, or that much of what is near lies apart or looks another way.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.registration.assessment.assess import evidence_of, uncertainty_of
from dqreg.registration.choice.fallback import BestPoses, is_doubtful, is_sound
from dqreg.registration.fit.displacement import displacement_between, is_elsewhere, offset_from_start
from dqreg.registration.fit.fit import Fit
from dqreg.registration.initial_pose import FOUND
from dqreg.registration.other_poses.near_places import near_maps
from dqreg.registration.other_poses.rivals import MIN_LOG_GAIN, NO_POSES, but_symmetric, scores_of
from dqreg.search.search import RAY_CONFLICT_MARGIN
from dqreg.trust.limits import DISAGREEING_NORMAL_SHARE, MIN_INLIER_FRACTION, looked_through_limit

# Displacement of a point by the loop, in sizes, beyond which it has left the pose that it was begun at.
LEFT_DIAGONALS = 0.2


def but_start_kept(begun: Fit, known: BestPoses, start: FloatArray, kernel_scale: float | None) -> BestPoses:
    """What is known of two clouds; or, where that is far from the initial pose, the fit to which this led.

    The pose that was left stands beside it. Where the loop itself went far, a kernel too narrow to leave the initial
    pose is asked; where the surfaces agree less there, what was found is the answer, and the initial pose stands beside
    that. Nothing is kept that is contradicted. A rough initial pose is, before the first step, and is asked all the
    same where what was found is contradicted too: with little in common a wide kernel lays views on top of each other.
    """
    found = known.fit
    if not begun.between_clouds or not begun.found or not found.found:
        return known
    is_left = any(is_elsewhere(found, found.T_target_source, T) for T in (begun.T_target_source, start))
    has_stayed = displacement_between(begun, start, begun.T_target_source) <= LEFT_DIAGONALS
    if not is_left and (has_stayed or not _is_contradicted(found, found)):
        return known
    if has_stayed and not _is_contradicted(begun, found):
        return _beside_found(begun, known)
    is_rough = _is_contradicted(begun.at(start), found)
    if is_rough and not _is_contradicted(found, found):
        return known
    # A chosen method finds its own kernel, and would leave the initial pose again.
    if kernel_scale is not None and _is_as_sound(near := begun.resumed(start, kernel_scale), found, start):
        return _beside_found(near, known)
    if is_rough or not is_left:
        return known
    return replaced(known, turned=np.concatenate([known.turned, start[None]]))


def held_at_start(fit: Fit, start: FloatArray) -> Fit:
    """The fit to a part; or that of a kernel as narrow as the noise, which passes at the start where the fit does not.

    What stands beside the part in a scene holds the kernel wide, and it leaves a right initial pose.
    """
    if fit.between_clouds or not fit.is_scene or not fit.may_be_moved or is_sound(fit):
        return fit
    near = fit.resumed(start, max(noise_on(fit.prepared.scan, fit.prepared.surface), fit.floor))
    has_stayed = near.found and displacement_between(near, start, near.T_target_source) <= LEFT_DIAGONALS
    return near if has_stayed and is_sound(near) else fit


def _beside_found(fit: Fit, known: BestPoses) -> BestPoses:
    """A fit as the answer, with the best of what is known named beside it, and no pose that is the fit's own."""
    turned = np.concatenate([known.fit.T_target_source[None], known.turned])
    apart = [displacement_between(fit, fit.T_target_source, T) > FOUND for T in turned]
    return replaced(known, fit=fit, turned=turned[apart])


def _is_as_sound(near: Fit, found: Fit, start: FloatArray) -> bool:
    """Whether a fit is beside the initial pose, and no more speaks against it than against the one found elsewhere."""
    if not near.found or near.is_late or displacement_between(near, start, near.T_target_source) > LEFT_DIAGONALS:
        return False
    return not _is_contradicted(near, found) and (not is_doubtful(near) or is_doubtful(found))


def _is_contradicted(fit: Fit, found: Fit) -> bool:
    """Whether something speaks against a pose between clouds, by itself or beside another one.

    How little is common does not. What a scanner looked through does; where its place is not known, much of what is
    near that lies apart or looks another way.
    """
    evidence, other = (evidence_of(each, uncertainty_of(each)) for each in (fit, found))
    through = evidence.looked_through
    if np.isfinite(through):
        return bool(through > min(looked_through_limit(evidence), other.looked_through + RAY_CONFLICT_MARGIN))
    return evidence.share_near < MIN_INLIER_FRACTION or evidence.normals_apart > DISAGREEING_NORMAL_SHARE


def meant_copy(fit: Fit, start: FloatArray, kernel_scale: float | None) -> tuple[Fit, FloatArray]:
    """The fit between clouds; far from the initial pose, one by that after a near symmetry, if as likely or sound.

    And, if so, the pose that was left, (k, 4, 4), unless it is the same place.
    """
    # On a part the points decide: what a notch speaks against is not meant.
    asked = fit.between_clouds and fit.may_be_moved
    if not asked or not fit.found or not is_elsewhere(fit, fit.T_target_source, start):
        return fit, NO_POSES
    copies = near_maps(fit, of_any=True) @ fit.T_target_source
    offsets = [offset_from_start(fit, T, start) for T in copies]
    if min(offsets, default=np.inf) > 1.0:
        return fit, NO_POSES
    # A map that was read off a cloud is rough, and few points of a refinement are not led far enough by it.
    other = fit.resumed(copies[int(np.argmin(offsets))], kernel_scale)
    poses = np.stack([fit.T_target_source, other.T_target_source])
    # What two clouds have in common differs from place to place: of what nothing speaks against the start decides.
    if other.found and (scores_of(fit, poses).as_likely(0, MIN_LOG_GAIN)[1] or not is_doubtful(other)):
        return other, but_symmetric(other, poses[:1])
    return fit, NO_POSES
