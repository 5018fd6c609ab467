"""Scale and pose of given matches in closed form, on request: `dqreg` never scales on its own.

B. K. P. Horn, "Closed-form solution of absolute orientation using unit quaternions" (1987), section 2.E, the
*symmetric* form: ``s^2 = sum beta |q'|^2 / sum beta |p'|^2`` about the weighted means. It needs no rotation, and
exchanging source and target gives its inverse. The least-squares form ``sum beta q'.R p' / sum beta |p'|^2`` is biased
low by noise and, with closest points for matches, shrinks the source to nothing in the end.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.solvers.euclidean import solve
from dqreg.solvers.matches import read_matches


@dataclasses.dataclass(frozen=True)
class Similarity:
    """``q = R (scale p) + t``."""

    scale: float  # What source lengths are multiplied with, > 0
    T_target_source: FloatArray  # (4, 4): Rigid pose of the *scaled* source
    rms: float  # Weighted root mean square distance of the matches, target units


def similarity(
    points_source: ArrayLike, points_target: ArrayLike, point_weights: ArrayLike | None = None
) -> Similarity:
    """Scale and pose of given matches in closed form, the scale by Horn's symmetric formula."""
    matches = read_matches(points_source, points_target, point_weights=point_weights)
    p, q = matches.points_source, matches.points_target
    weights = np.ones(len(p)) if matches.point_weights is None else matches.point_weights
    spreads = spread_of(p, weights), spread_of(q, weights)
    if not min(spreads) > 0.0:
        raise DegenerateGeometryError("all matched points of one side are in one place; the scale is not determined")
    scale = spreads[1] / spreads[0]
    fit = solve(scale * p, q, point_weights=weights)
    return Similarity(scale, fit.T_target_source, fit.rms)


def spread_of(points: FloatArray, weights: FloatArray) -> float:
    """Weighted root mean square distance of points from their mean; 0 where no point carries weight."""
    total = weights.sum()
    if not total > 0.0:
        return 0.0
    away = points - weights @ points / total
    return float(np.sqrt(weights @ np.einsum("ij,ij->i", away, away) / total))
