"""How far two poses place a scan apart, and a pose is from the initial one."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.registration.fit.fit import Fit
from dqreg.rigid import pose

# Points of the scan that tell.
FEW = 500
# A pose within this rotation and this fraction of the target's size of the initial pose is meant: that one is rough.
MEANT_RAD, MEANT = np.deg2rad(40.0), 0.25


def displacement_between(fit: Fit, T: FloatArray, other: FloatArray) -> float:
    """How far two poses place a point of the fit's scan apart at most, in sizes of the target."""
    points = fit.prepared.scan.thinned(FEW).points
    away = np.linalg.norm(pose.apply(other, points) - pose.apply(T, points), axis=1).max(initial=0.0)
    return float(away / fit.prepared.surface.diagonal)


def offset_from_start(fit: Fit, T: FloatArray, start: FloatArray | None) -> float:
    """How far a pose is from the initial one, 1 where that is not meant any more; 0 where none was given."""
    if start is None:
        return 0.0
    shift = pose.offset_between(T, start, at=np.zeros(3)) / (MEANT * fit.prepared.surface.diagonal)
    return float(max(pose.angle_between(T, start) / MEANT_RAD, shift))


def is_elsewhere(fit: Fit, T: FloatArray, start: FloatArray | None) -> bool:
    """Whether a pose is in another basin than the initial one: no rough initial pose means both."""
    return offset_from_start(fit, T, start) > 1.0
