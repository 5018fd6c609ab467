"""What the yardsticks share: checked matches about their means, and the fit that belongs to a rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.solvers.closed_form import SAME_POINT, no_weight_message, require_determined
from dqreg.solvers.fit import Fit
from dqreg.solvers.matches import Matches, refuse_bad_values
from dqreg.solvers.pose_cost import cost_of_pose


@dataclass(frozen=True, slots=True, eq=False)
class Centred:
    """Matches with their weights written out and the points about their weighted means."""

    # beta, alpha: (n,): Weights of points and directions
    beta: FloatArray
    alpha: FloatArray
    # mean_source, mean_target: (3,): Weighted means of the points
    mean_source: FloatArray
    mean_target: FloatArray
    # p, q: (n, 3): Points less their mean
    p: FloatArray
    q: FloatArray
    reach: float  # The largest lambda_1 such data could have, reached where they fit exactly


def centre(matches: Matches) -> Centred:
    """Check the values and take the weighted means off the points."""
    refuse_bad_values(matches)
    beta, alpha = weights_of(matches)
    if not beta.sum() > 0.0:
        raise DegenerateGeometryError(no_weight_message())
    mean_source, p = _about_mean(matches.points_source, beta)
    mean_target, q = _about_mean(matches.points_target, beta)
    points = math.sqrt(float(beta @ (p * p).sum(axis=1)) * float(beta @ (q * q).sum(axis=1)))
    m, n = matches.directions_source, matches.directions_target
    directions = math.sqrt(float(alpha @ (m * m).sum(axis=1)) * float(alpha @ (n * n).sum(axis=1)))
    return Centred(beta, alpha, mean_source, mean_target, p, q, points + directions)


def weights_of(matches: Matches) -> tuple[FloatArray, FloatArray]:
    """Weights beta (n,) and alpha (m,), ones where none were given."""
    beta = matches.point_weights
    alpha = matches.direction_weights
    return (
        np.ones(len(matches.points_source)) if beta is None else beta,
        np.ones(len(matches.directions_source)) if alpha is None else alpha,
    )


def fit_of_rotation(R: FloatArray, lambda_1: float, lambda_2: float, matches: Matches, centred: Centred) -> Fit:
    """Fit with this rotation, the translation that belongs to it, and the cost of its residuals.

    Shapes: R (3, 3).
    """
    gap = require_determined(lambda_1, lambda_2, centred.reach)
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = centred.mean_target - R @ centred.mean_source  # Jia (13)
    point_cost, direction_cost = cost_of_pose(T, matches)
    return Fit(T, point_cost + direction_cost, math.sqrt(point_cost / centred.beta.sum()), gap)


def _about_mean(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ points / weights.sum()
    away = points - mean
    heavy = away[weights > 0.0]
    if np.linalg.norm(heavy, axis=1).max() <= SAME_POINT * np.linalg.norm(mean):
        away = np.zeros_like(away)
    return mean, away
