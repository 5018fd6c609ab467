"""Symmetric copies of a fit: poses after a symmetry of the part, which no scan tells apart."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.registration.fit import Fit
from dqreg.registration.rivals import BETTER, NO_POSES, SIGNIFICANT, scores_of
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.rigid.symmetry import SAME_AXIS_RAD

# A pose this near to a symmetric copy of another one, in radians and sizes, is that copy.
COPY = 2e-3


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
    is_copy &= -deficit <= np.maximum(BETTER, SIGNIFICANT * error)
    return [fit for fit, drop in zip(found, is_copy, strict=True) if not drop], poses[is_copy]
