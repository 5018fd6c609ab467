"""Poses that are a fit's own again: after a symmetry, after a motion that nothing holds, or on the way of its loop."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Mesh
from dqreg.registration.fit.displacement import displacement_between
from dqreg.registration.fit.fit import Fit
from dqreg.registration.initial_pose import FOUND
from dqreg.registration.other_poses.rivals import MIN_GAIN_SIGMAS, MIN_LOG_GAIN, NO_POSES, scores_of
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose, twist
from dqreg.rigid.rotations import angle_of
from dqreg.rigid.symmetry import SAME_AXIS_RAD
from dqreg.rigid.twist import scaling_by
from dqreg.search.near_symmetry import EXACT_DIAGONALS, is_symmetry
from dqreg.search.scoring import EQUAL_LOG_LIKELIHOOD

# A pose this near to a symmetric copy of another one, in radians and sizes, is that copy.
COPY = 2e-3
# Poses of a search that are refined.
TRIED = 8

# Of a target.
EXACT_SYMMETRIES: Key[list[FloatArray]] = Key()


def is_copy_of(fit: Fit, others: FloatArray) -> BoolArray:
    """Which poses, (k, 4, 4), are the fit's after a symmetry of the part: no scan is explained better there."""
    target = fit.problem.target
    found = np.zeros(len(others), dtype=bool)
    if not len(others) or not fit.found or target.pairs.symmetry is None:
        return found
    for k, T in enumerate(others):
        motion = T @ pose.inverse(fit.T_target_source)
        within = 2.0 * COPY * target.surface.diagonal
        axis, angle = target.pairs.symmetry.between(fit.T_target_source, T, within), angle_of(motion[:3, :3])
        if axis is None or angle < SAME_AXIS_RAD:
            continue
        step = 2.0 * np.pi / axis.order if axis.order else angle
        shift = float(np.linalg.norm(pose.apply(motion, axis.point[None])[0] - axis.point))
        found[k] = max(abs(angle - step * round(angle / step)), shift / target.surface.diagonal) <= COPY
    return found


def copies_of(fit: Fit) -> FloatArray:
    """The fit's pose after each symmetry of the part, (k, 4, 4): as right as it is."""
    symmetry = fit.problem.target.pairs.symmetry
    if symmetry is None or not fit.found:
        return NO_POSES
    return np.asarray(symmetry.poses[1:] @ fit.T_target_source)


def exact_symmetries(fit: Fit) -> FloatArray:
    """The identity, and the symmetries that leave a part in place so exactly that no scan tells, (k, 4, 4)."""
    target, surface = fit.problem.target, fit.prepared.surface
    found = [np.eye(4)]
    if target.pairs.symmetry is not None and isinstance(target.geometry, Mesh):
        part, poses = target.geometry, target.pairs.symmetry.poses[1:]
        exact = target.derived.once(
            EXACT_SYMMETRIES, lambda: [T for T in poses if is_symmetry(T, part, surface, EXACT_DIAGONALS)]
        )
        found += exact
    return np.stack(found)


def without_equal_copies(fits: list[Fit]) -> tuple[list[Fit], FloatArray]:
    """Fits without the symmetric copies of the first that explain the scan no better, and those copies, (k, 4, 4)."""
    found = [fit for fit in fits if fit.found]
    if len(found) < 2 or not fits[0].found:
        return fits, NO_POSES
    poses = np.stack([fit.T_target_source for fit in found])
    is_copy = is_copy_of(fits[0], poses)
    is_copy[0] = False
    if not is_copy.any():
        return fits, NO_POSES
    deficit, error = scores_of(found[0], poses).deficit(0)
    is_copy &= -deficit <= np.maximum(MIN_LOG_GAIN, MIN_GAIN_SIGMAS * error)
    return [fit for fit, drop in zip(found, is_copy, strict=True) if not drop], poses[is_copy]


def but_slid(fit: Fit, others: FloatArray) -> FloatArray:
    """Poses, (k, 4, 4), without those that are the fit's or one another's after a motion that nothing constrains."""
    free = fit.information.free if fit.found else np.zeros(0, dtype=bool)
    if not len(others) or not free.any():
        return others
    scores = scores_of(fit, np.concatenate([fit.T_target_source[None], others]))
    kept: list[int] = []
    for k, T in enumerate(others, start=1):
        if not any(_is_slid(fit, others[j - 1] if j else fit.T_target_source, T) for j in (0, *kept)):
            kept.append(k)
            continue
        # Farther along something may hold the motion: a key in its way, which few points may see.
        deficit, error = scores.deficit(0)
        if -deficit[k] > max(MIN_LOG_GAIN, MIN_GAIN_SIGMAS * error[k]) or scores.distinguishable(k)[0]:
            kept.append(k)
    return np.asarray(others[np.array(kept, dtype=int) - 1])


def but_on_the_way(fit: Fit, others: FloatArray, kernel_scale: float | None) -> FloatArray:
    """Poses, (k, 4, 4), without those from which the loop arrives at the fit: a search refines on a sample alone.

    And where it arrives from the others: what few points have refined roughly says less of a pose than that end of it.
    """
    kept, ends, last = [], [], fit
    for T in others[:TRIED]:
        last = last.resumed(T, kernel_scale)
        if last.problem.watch.is_over:
            return others
        kept.append(not last.found or displacement_between(fit, last.T_target_source, fit.T_target_source) > FOUND)
        if kept[-1] and last.found:
            ends.append(last.T_target_source)
    return np.concatenate([others[np.flatnonzero(kept)], as_likely(fit, np.array(ends).reshape(-1, 4, 4))])


def as_likely(fit: Fit, ends: FloatArray) -> FloatArray:
    """Those of poses at which a loop ended, (k, 4, 4), that explain the scan about as well as the fit."""
    if not len(ends):
        return ends
    scores = scores_of(fit, np.concatenate([fit.T_target_source[None], ends]))
    likely = (scores.deficit(0)[0] <= EQUAL_LOG_LIKELIHOOD) & ~scores.distinguishable(0)
    return np.asarray(ends[likely[1:]])


def _is_slid(fit: Fit, T: FloatArray, other: FloatArray) -> bool:
    """Whether a motion that nothing constrains leads from one pose to another.

    Such motions are a group: the logarithm of any of them is a mixture of the free ones, however far it goes.
    """
    information, scale = fit.information, scaling_by(fit.information.lever)
    free, motion = information.vectors[:, information.free], twist.log(other @ pose.inverse(T))
    along = twist.exp(free @ (free.T @ (scale * motion)) / scale) @ T
    return displacement_between(fit, along, other) <= FOUND
