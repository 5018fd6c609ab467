"""Between two clouds an initial pose is kept, unless something speaks against it.

Means over points that some pose puts on the target compare poses by how much the clouds have in common there: a twin
that lays three faces on three beats the right pose that has one. A point where the other view did not look says
nothing; what a scanner looked through speaks, or that much of what is near lies apart or looks another way.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg.registration.displacement import displacement_between, offset_from_start
from dqreg.registration.fallback import BestPoses
from dqreg.registration.fit import Fit
from dqreg.registration.free_space import looked_through_at
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE, DISAGREEING_NORMAL_SHARE, MIN_INLIER_FRACTION, RAY_CONFLICT_SHARE

# Displacement of a point by the loop, in sizes, beyond which it has left what was meant.
LEFT_DIAGONALS = 0.2


def but_start_kept(begun: Fit, known: BestPoses, start: FloatArray) -> BestPoses:
    """What is known of two clouds; or, where that is far from the initial pose, the fit to which this led.

    The pose that was left stands beside it. Where the loop itself went far, what was found is the answer, and the
    initial pose stands beside that. Nothing is kept that is contradicted.
    """
    found = known.fit
    if begun.target.kind != "cloud" or not begun.found or not found.found:
        return known
    if not _is_elsewhere(found, begun.T_target_source) and not _is_elsewhere(found, start):
        return known
    has_stayed = displacement_between(begun, start, begun.T_target_source) <= LEFT_DIAGONALS
    if has_stayed and not is_contradicted(begun):
        others = np.concatenate([found.T_target_source[None], known.others])
        return replaced(known, fit=begun, others=others, turned=np.concatenate([others[:1], known.turned]))
    if is_contradicted(begun.at(start)):
        return known
    return replaced(known, turned=np.concatenate([known.turned, start[None]]))


def _is_elsewhere(fit: Fit, T: FloatArray) -> bool:
    """Whether a pose is in another basin than the fit's: no rough initial pose means both."""
    return offset_from_start(fit, fit.T_target_source, T) > 1.0


def is_contradicted(fit: Fit) -> bool:
    """Whether something speaks against a pose between clouds, however little they have in common there."""
    through, alike = looked_through_at(fit)
    if np.isfinite(through):
        return bool(through > (RAY_CONFLICT_SHARE if np.isfinite(alike) else DEPTH_CONFLICT_SHARE))
    agreement = fit.agreement
    return agreement.share_near < MIN_INLIER_FRACTION or agreement.normals_apart > DISAGREEING_NORMAL_SHARE
