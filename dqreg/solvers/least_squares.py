"""`dqreg.solve`: the 1991 closed form for given matches, with the cost in plain squared distances."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, require_workable
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.solvers.closed_form import fit_of_moments, require_determined, rounding_gap
from dqreg.solvers.exact_cost import cost_of_pose
from dqreg.solvers.exact_matches import solve_beside, split_weights
from dqreg.solvers.feature_sums import BLOCK_ROWS
from dqreg.solvers.fit import Fit
from dqreg.solvers.matches import Matches, read_matches, refuse_bad_values, weights_of
from dqreg.solvers.moments import Moments, sums_of
from dqreg.solvers.rounding import SAME_POINT, SMALLEST_DIFFERENCE
from dqreg.solvers.uncertainty import FitUncertainty, counted, residual_variance
from dqreg.solvers.undetermined_rotation import no_weight_message, undetermined

# Part of the constant below which its difference from the fit has lost more than seven digits of fifteen.
SMALL_COST = 1e-7
# Variance of the points below which their squares lose digits at the end of the float64 range.
SMALLEST_SQUARE = 1e-290

F = TypeVar("F", bound=Fit)


def solve(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
    *,
    absolute_weights: bool = False,
) -> Fit:
    """Pose that best maps matched points and directions onto each other, in closed form.

    Minimises ``sum beta |R p + t - q|^2 + sum alpha |R m - n|^2`` over all rigid poses: the algorithm of Walker,
    Shao and Volz (1991) over unit dual quaternions, with squared distances in place of the paper's quarters of them.
    The answer is the global minimum, and a rotation, never a mirror image.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Points p in source coordinates and the points q in target coordinates that they belong to.
    directions_source, directions_target : array_like, (m, 3), optional
        Directions m and n, for example normals or axes; m may differ from n, the number of points. They are weighed
        as given and never scaled to unit length: a direction of length 2 counts as 4 directions of length 1, where
        its partner has the length 2 too. A direction that carries weight must not have length zero.
    point_weights : array_like, (n,) or float, optional
        beta >= 0, one a point; 1 where not given, 0 rejects the match.
    direction_weights : array_like, (m,) or float, optional
        alpha >= 0, one a direction, in squared lengths if the cost is to be one; 1 where not given, 0 rejects the
        match. `likelihood_weights` derives both kinds from the noise. An infinite weight of either kind makes its
        match exact: exact matches are met first, and the others fit what they leave open.
    absolute_weights : bool
        Whether the weights are 1 / variance, as `likelihood_weights` gives them, and the covariance follows from them
        alone. Else they are in proportion to it, and the residuals give the scale.

    Returns
    -------
    Fit
        ``T_target_source``, ``dual_quaternion``, ``cost``, ``rms`` of the points, ``eigenvalue_gap``, ``covariance``
        (computed when first asked for) about ``centre``. The cost is the sum of the squared residuals, right and never
        negative for an exact fit too. Only of some thousand matches and more, and where it is at least 1e-7 of the
        sums it is the difference of, is it taken as that difference, which holds eight digits of it and saves a pass.
        Exact matches enter neither cost nor rms; beside them the gap is that of `RotationFit`.

    Raises
    ------
    InputError
        If a shape or count is wrong, a number is not finite, a weight is negative, there are no matches, or the
        lengths are too large or too small for their squares, or exact matches contradict each other by more than
        1e-9 of their extent.
    DegenerateGeometryError
        If the matches leave part of the pose free: no weight on any point, all points in one place or on one line
        without a direction across it. The message holds the measured relative gap, the cause and the remedy.

    Examples
    --------
    >>> import numpy as np
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> quarter_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    >>> fit = solve(points, points @ quarter_turn.T + [1, 2, 3])
    >>> bool(np.allclose(fit.T_target_source[:3, :3], quarter_turn)), bool(fit.rms < 1e-15)
    (True, True)
    """
    beta, exact_points = split_weights(point_weights, "point_weights")
    alpha, exact_directions = split_weights(direction_weights, "direction_weights")
    matches = read_matches(points_source, points_target, directions_source, directions_target, beta, alpha)
    if exact_points is not None or exact_directions is not None:
        return solve_beside(matches, exact_points, exact_directions, absolute_weights=absolute_weights)
    # What is not finite shows in the sums, and only then is looked for: the check costs no pass of its own.
    with np.errstate(over="ignore", invalid="ignore"):
        moments = sums_of(matches)
    _check_sums(moments, matches)
    fit = fit_of_moments(moments, matches)
    if _needs_residuals(fit, moments, matches):
        point_cost, direction_cost = cost_of_pose(fit.T_target_source, matches)
        fit = replace(fit, cost=point_cost + direction_cost, rms=math.sqrt(point_cost / moments.point_weight))
    return fit if absolute_weights else _scaled(fit, matches)


def with_uncertainty(fit: F, matches: Matches, moments: Moments, *, absolute_weights: bool) -> F:
    """The fit of a reference solver with the sums that its covariance follows from."""
    H = moments.point_cross + moments.direction_cross
    fit = replace(fit, uncertainty=FitUncertainty(H, moments.point_weight, moments.mean_target, 1.0))
    return fit if absolute_weights else _scaled(fit, matches)


def _scaled(fit: F, matches: Matches) -> F:
    if fit.uncertainty is None:
        return fit
    variance = residual_variance(
        fit.cost,
        counted(matches.point_weights, len(matches.points_source)),
        counted(matches.direction_weights, len(matches.directions_source)),
    )
    return replace(fit, uncertainty=replace(fit.uncertainty, variance=variance))


def _needs_residuals(fit: Fit, moments: Moments, matches: Matches) -> bool:
    if max(len(matches.points_source), len(matches.directions_source)) < BLOCK_ROWS:
        return True  # cheap, and then exact
    spread = moments.spread_source + moments.spread_target
    point_cost = fit.rms * fit.rms * moments.point_weight
    return fit.cost <= SMALL_COST * moments.constant or point_cost <= SMALL_COST * spread


def _check_sums(moments: Moments, matches: Matches) -> None:
    if not moments.is_finite:
        refuse_bad_values(matches)
        raise InputError("the coordinates are finite, but their squares are not; give them in a larger unit")
    if not min(moments.spread_source, moments.spread_target) >= SMALLEST_SQUARE * moments.point_weight:
        # Squares of lengths this small are no longer whole: what is left of them would give a wrong pose.
        for name in ("points_source", "points_target"):
            if len(rows := getattr(matches, name)):
                require_workable(rows, name)
    if len(matches.directions_source) and _may_hold_zero(moments, matches.direction_weights, matches):
        refuse_bad_values(matches)


def _may_hold_zero(moments: Moments, weights: FloatArray | None, matches: Matches) -> bool:
    # Unit directions add up to the sum of their weights, and one of length zero is missing from it.
    expected = float(len(matches.directions_source)) if weights is None else float(weights.sum())
    least = 1.0 if weights is None else float(weights.min())
    shortest = min(moments.length_source, moments.length_target)
    longest = max(moments.length_source, moments.length_target)
    return not expected - 0.5 * least < shortest <= longest < expected + 0.5 * least


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
    points = math.sqrt(beta @ (p * p).sum(axis=1)) * math.sqrt(beta @ (q * q).sum(axis=1))
    m, n = matches.directions_source, matches.directions_target
    directions = math.sqrt(alpha @ (m * m).sum(axis=1)) * math.sqrt(alpha @ (n * n).sum(axis=1))
    return Centred(beta, alpha, mean_source, mean_target, p, q, points + directions)


def fit_of_rotation(
    R: FloatArray, lambda_1: float, lambda_2: float, matches: Matches, centred: Centred, *, absolute_weights: bool
) -> Fit:
    """Fit with this rotation, the translation that belongs to it, and the cost of its residuals. Shapes: R (3, 3)."""
    moments = sums_of(matches)
    floor = SMALLEST_DIFFERENCE * centred.reach + rounding_gap(moments)
    gap = require_determined(
        lambda_1, lambda_1 - lambda_2, centred.reach, floor, lambda words: undetermined(words, matches=matches)
    )
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = centred.mean_target - R @ centred.mean_source  # Jia (13)
    point_cost, direction_cost = cost_of_pose(T, matches)
    fit = Fit(T, point_cost + direction_cost, math.sqrt(point_cost / centred.beta.sum()), gap)
    return with_uncertainty(fit, matches, moments, absolute_weights=absolute_weights)


def _about_mean(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ points / weights.sum()
    away = points - mean
    heavy = away[weights > 0.0]
    if np.linalg.norm(heavy, axis=1).max() <= SAME_POINT * np.linalg.norm(mean):
        away = np.zeros_like(away)
    return mean, away
