"""How far two poses place a scan apart."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.registration.fit import Fit
from dqreg.rigid import pose

# Points of the scan that tell.
FEW = 500


def displacement_between(fit: Fit, T: FloatArray, other: FloatArray) -> float:
    """How far two poses place a point of the fit's scan apart at most, in sizes of the target."""
    points = fit.prepared.scan.thinned(FEW).points
    away = np.linalg.norm(pose.apply(other, points) - pose.apply(T, points), axis=1).max(initial=0.0)
    return float(away / fit.prepared.surface.diagonal)
