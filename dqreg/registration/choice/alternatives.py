"""Other poses that explain the scan as well, as the result names them: symmetries of the part, periods, rotations."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import remembered
from dqreg.registration.choice.fallback import is_sound
from dqreg.registration.fit.displacement import displacement_between
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import JUDGING_POINTS, JUDGING_POINTS_LATE, NO_POSES, scores_of
from dqreg.registration.other_poses.same_poses import as_likely
from dqreg.registration.other_poses.wall_sides import may_confuse_sides, rivals_of
from dqreg.registration.visibility import is_worse_where_seen
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of, axis_of
from dqreg.rigid.single_pose import orthonormal
from dqreg.rigid.symmetry import SAME_AXIS_RAD, Axis
from dqreg.search import symmetry_words
from dqreg.search.poses import Poses
from dqreg.search.scoring import MAX_EQUAL_LOG_LIKELIHOOD
from dqreg.search.stages import FINE_APART
from dqreg.solvers.motion_words import axis_words, direction_words
from dqreg.trust.records import Alternative

# A shift is a period within this share of it.
PERIOD = 0.05
# Poses behind the answer that are asked, the best first.
MAX_ASKED = 3
# Thicknesses that a pose may be off the answer and be its own other side, which is asked anyway.
OWN_THICKNESSES = 2.0


def alternatives_of(
    fit: Fit, whole: Fit, others: FloatArray, near: FloatArray = NO_POSES, turned: FloatArray = NO_POSES
) -> tuple[Alternative, ...]:
    """Other poses, (k, 4, 4), as the result names them: each once; and poses that are others however near they are.

    And turns of a ring, which have been compared by more than how much of the scan they leave on the target. Where the
    fit is to the faces that could be seen, the whole one is to all: other poses see other faces.
    """
    if not len(others) + len(near) + len(turned) or not fit.found:
        return ()
    diagonal = min(fit.prepared.surface.diagonal, fit.prepared.scan.diagonal)
    count = JUDGING_POINTS_LATE if fit.is_late else JUDGING_POINTS
    poses = _each_once(whole, np.concatenate([whole.T_target_source[None], others]), FINE_APART[1] * diagonal, count)
    poses = np.concatenate([poses, near, turned])
    scores = scores_of(whole, poses, count)
    target = fit.problem.target
    deficit, error = scores.deficit(0)
    rms = np.sqrt((scores.distances**2).mean(axis=1))
    found = []
    is_named = (deficit <= MAX_EQUAL_LOG_LIKELIHOOD) | (np.arange(len(poses)) >= len(poses) - len(turned))
    for k in np.flatnonzero(is_named[1:]) + 1:
        if fit.target is not whole.target and k < len(poses) - len(turned) and is_worse_where_seen(fit, poses[k]):
            continue
        axis = _symmetry_between(fit, poses[0], poses[k], FINE_APART[1] * diagonal)
        words = symmetry_words(axis.moved(target.origin), fit.problem.units[1], diagonal) if axis else ""
        motion = _motion_words(fit, poses[k] @ pose.inverse(poses[0]))
        figures = float(-deficit[k]), float(error[k])
        # After many products of poses rounding is more than a result may depart from rigid.
        pose_k = orthonormal(fit.problem.to_caller(poses[k]))
        found.append(Alternative(pose_k, float(rms[k]), words, *figures, motion, _symmetric=axis is not None))
    return tuple(found)


def on_other_sides(fit: Fit, behind: FloatArray, kernel_scale: float | None) -> FloatArray:
    """Poses behind a fit, (k, 4, 4), on those sides of thin walls where they explain the scan as well, (m, 4, 4).

    A search knows no sides: each of its poses lies on either side of a sheet, and on the wrong one it explains less.
    """
    if not len(behind) or not fit.found or not fit.may_be_moved or not may_confuse_sides(fit):
        return NO_POSES
    # Beside an answer that is refused, or slides, they would be many.
    if fit.information.free.any() or not is_sound(fit):
        return NO_POSES
    target, found, last = fit.problem.target, [], fit
    near = OWN_THICKNESSES * float(target.thin_walls.thickness.max()) / target.surface.diagonal
    elsewhere = [T for T in behind if displacement_between(fit, T, fit.T_target_source) > near]
    for T in elsewhere[:MAX_ASKED]:
        last = last.resumed(T, kernel_scale)
        if last.problem.watch.is_over:
            break
        found += [rival.T_target_source for rival in rivals_of(last)]
    return as_likely(fit, np.array(found).reshape(-1, 4, 4))


def _each_once(fit: Fit, poses: FloatArray, offset: float, count: int) -> FloatArray:
    """Poses, (k, 4, 4), each once: the first, and of others that are one the likeliest by so many points.

    A search, and the loop, may have led to one pose: on few points, and to the noise.
    """
    middle, whole = fit.prepared.scan.points.mean(axis=0), Poses.of(poses)
    if len(rows := whole.distinct(middle, FINE_APART[0], offset, len(poses))) < len(poses):
        rows = np.r_[0, 1 + np.argsort(-scores_of(fit, poses, count).means[1:], kind="stable")]
        rows = np.sort(rows[whole[rows].distinct(middle, FINE_APART[0], offset, len(poses))])
    return poses[rows]


def _symmetry_between(fit: Fit, T: FloatArray, other: FloatArray, within: float) -> Axis | None:
    """The axis of a symmetry that leads from one pose of a part to another within a length; None if none does.

    Across a wall half of its thickness is the limit: one side of it laid on the other is no symmetry.
    """
    target = fit.problem.target
    # Known where a global search has run.
    symmetry = target.pairs.symmetry if remembered(target, "pairs") is not None else None
    axis = symmetry.between(T, other, within) if symmetry else None
    if axis is None or symmetry is None:
        return None
    walls = target.thin_walls
    shift = pose.apply(other @ pose.inverse(T), symmetry.centre[None])[0] - symmetry.centre
    return None if (np.abs(walls.normals @ shift) > 0.5 * walls.thickness).any() else axis


def _motion_words(fit: Fit, T: FloatArray) -> str:
    """A motion of the target's centred frame in words of the caller's."""
    target, units = fit.problem.target, fit.problem.units[1]
    size = target.surface.diagonal
    angle = angle_of(T[:3, :3])
    if angle > SAME_AXIS_RAD:
        axis = axis_of(T[:3, :3])
        # The point of the axis nearest to the middle; what is left is along the axis.
        along = float(axis @ T[:3, 3])
        point = np.linalg.lstsq(np.eye(3) - T[:3, :3], T[:3, 3] - axis * along, rcond=1e-6)[0]
        words = (
            f"rotated by {np.rad2deg(angle):.4g} degrees about {axis_words(point + target.origin, axis, units, size)}"
        )
        is_screw = abs(along) > FINE_APART[1] * size
        return words + (f" and shifted by {_in_units(along, units)} along it" if is_screw else "")
    length = float(np.linalg.norm(T[:3, 3]))
    words = _in_units(length, units)
    where = direction_words(T[:3, 3] / length)
    periods = remembered(target, "near_periods", np.zeros((0, 4, 4)))[:, :3, 3]
    if len(periods) and np.linalg.norm(periods - T[:3, 3], axis=1).min() < PERIOD * length:
        return f"one period ({words}) along {where}"
    return f"shifted by {words} along {where}"


def _in_units(length: float, units: str | None) -> str:
    return f"{length:.4g}" + (f" {units}" if units else "")
