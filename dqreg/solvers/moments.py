"""The sums over all matches from which the pose follows: additive over chunks, threads and machines."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import warn_of_old_name
from dqreg.solvers.feature_sums import BLOCK_ROWS, FeatureSums, Pair, feature_sums
from dqreg.solvers.matches import Matches, read_rows
from dqreg.solvers.narrow_data import Aligned, is_narrow, long_axes, products_in_axes
from dqreg.solvers.rounding import grain_of

# Rows looked at to guess the means of a large set.
SAMPLE_ROWS = 64
# Squared distance of the origin from the mean, in squared spreads, up to which sums are taken as they come.
FAR_SQUARED_SPREADS = 16.0
# Arguments of `moments_of` beyond the points, in the order that they had.
OLD_ORDER = "point_weights", "directions_source", "directions_target", "direction_weights"

Given = ParamSpec("Given")
Central = tuple[float, FloatArray, FloatArray, FloatArray, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Central moments of matched points p, q and plain moments of matched directions m, n.

    The points' sums are taken about the weighted means of each side, so nothing is lost where both lie far from
    the origin. Moments of two sets of matches add up to the moments of all of them.

    Attributes
    ----------
    point_weight : float
        ``sum beta``.
    mean_source, mean_target : ndarray, (3,)
        Weighted means of p and q; zeros where no point carries weight.
    point_cross : ndarray, (3, 3)
        ``sum beta (q - mean_q) (p - mean_p)^T``.
    spread_source, spread_target : float
        ``sum beta |p - mean_p|^2`` and the same of q.
    direction_cross : ndarray, (3, 3)
        ``sum alpha n m^T``.
    length_source, length_target : float
        ``sum alpha |m|^2`` and the same of n.
    aligned : Aligned or None
        The sums again, in axes along and across the matches, where these are narrow: in the axes of the coordinates
        the small entries would drown in the rounding of the large ones.

    Examples
    --------
    >>> p = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]])
    >>> whole, halves = moments_of(p, p), moments_of(p[:1], p[:1]) + moments_of(p[1:], p[1:])
    >>> bool(np.allclose(whole.point_cross, halves.point_cross)), halves.point_weight
    (True, 4.0)
    """

    point_weight: float
    mean_source: FloatArray
    mean_target: FloatArray
    point_cross: FloatArray
    spread_source: float
    spread_target: float
    direction_cross: FloatArray
    length_source: float
    length_target: float
    aligned: Aligned | None = None

    def __add__(self, other: Moments) -> Moments:
        weight = self.point_weight + other.point_weight
        step_source = other.mean_source - self.mean_source
        step_target = other.mean_target - self.mean_target
        share = other.point_weight / weight if weight else 0.0
        # Each set is central about its own mean; moving both to the common mean adds one pair of that weight.
        lever = self.point_weight * share
        total = Moments(
            weight,
            self.mean_source + share * step_source,
            self.mean_target + share * step_target,
            self.point_cross + other.point_cross + lever * np.outer(step_target, step_source),
            self.spread_source + other.spread_source + lever * float(step_source @ step_source),
            self.spread_target + other.spread_target + lever * float(step_target @ step_target),
            self.direction_cross + other.direction_cross,
            self.length_source + other.length_source,
            self.length_target + other.length_target,
        )
        H = total.point_cross + total.direction_cross
        if not is_narrow(H):
            return total
        axes = long_axes(H)
        one, two = (_in_axes(part, axes) for part in (self, other))
        step = np.concatenate([step_source @ axes[0], step_target @ axes[1]])
        points = one.points + two.points + lever * np.outer(step, step)
        grains = np.hypot(one.grains, two.grains)
        return replace(total, aligned=Aligned(*axes, points, one.directions + two.directions, grains))

    @property
    def is_finite(self) -> bool:
        """Whether every number summed was finite and none overflowed when squared."""
        total = self.point_weight + self.spread_source + self.spread_target + self.length_source + self.length_target
        return math.isfinite(total)

    @property
    def constant(self) -> float:
        """The cost before the rotation enters: all spreads and lengths; the cost is this less twice the fit."""
        return self.spread_source + self.spread_target + self.length_source + self.length_target


def scaled(moments: Moments, factor: float) -> Moments:
    """Moments of weights that are ``factor`` times as large."""
    m = moments
    return Moments(
        factor * m.point_weight,
        m.mean_source,
        m.mean_target,
        factor * m.point_cross,
        factor * m.spread_source,
        factor * m.spread_target,
        factor * m.direction_cross,
        factor * m.length_source,
        factor * m.length_target,
        None if m.aligned is None else m.aligned.scaled(factor),
    )


def _in_axes(moments: Moments, axes: Pair) -> Aligned:
    """The sums in axes of either side; of matches that are not narrow each square is the most that it can be."""
    m = moments
    if m.aligned is not None:
        return m.aligned.turned(*axes)
    points, directions = np.eye(6), np.eye(6)
    for products, cross, *squares in (
        (points, m.point_cross, m.spread_source, m.spread_target),
        (directions, m.direction_cross, m.length_source, m.length_target),
    ):
        products *= np.repeat(squares, 3)
        products[3:, :3] = axes[1].T @ cross @ axes[0]
        products[:3, 3:] = products[3:, :3].T
    return Aligned(*axes, points, directions, _grains(m))


def _grains(moments: Moments) -> FloatArray:
    """How far the rounding of coordinates may move the points of either side. Shapes: returns (2,)."""
    m = moments
    away = np.array([math.hypot(*m.mean_source), math.hypot(*m.mean_target)])
    return np.asarray(grain_of(m.point_weight, away, np.array([m.spread_source, m.spread_target])))


def _understood_in_old_order(function: Callable[Given, Moments]) -> Callable[Given, Moments]:
    """The function with directions before weights, which understands and tells the order that its arguments had."""

    @functools.wraps(function)
    def either(*args: Given.args, **named: Given.kwargs) -> Moments:
        if not _is_old(args[2:]):
            return function(*args, **named)
        call = "moments_of(points, points, {}, ..)"
        warn_of_old_name(call.format("weights"), call.format("directions"), "order")
        given: Any = dict(zip(OLD_ORDER, args[2:], strict=False))
        points: Any = args[:2]
        return function(*points, **given, **named)

    return either


def _is_old(places: tuple[Any, ...]) -> bool:
    # Weights are numbers in one row; where there were none, directions stand where none can without their other side.
    if places and places[0] is not None:
        return np.ndim(places[0]) < 2
    return len(places) > 1 and np.ndim(places[1]) == 2


@_understood_in_old_order
def moments_of(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
) -> Moments:
    """Sum the moments in one pass; the coordinates are trusted.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Matched points.
    directions_source, directions_target : array_like, (m, 3), optional
        Matched directions, weighed as given: none is scaled to unit length.
    point_weights : array_like, (n,) or float, optional
        beta >= 0; 1 where not given.
    direction_weights : array_like, (m,) or float, optional
        alpha >= 0; 1 where not given.

    Returns
    -------
    Moments
        Not finite if a coordinate was not: see `Moments.is_finite`.

    Raises
    ------
    InputError
        If a shape or a count is wrong, or a weight is negative or not finite.

    Examples
    --------
    >>> round(moments_of(np.eye(3), np.eye(3) + 5.0).spread_source, 12)
    2.0
    """
    return sums_of(
        read_rows(points_source, points_target, directions_source, directions_target, point_weights, direction_weights)
    )


def sums_of(matches: Matches) -> Moments:
    """`moments_of` for matches, whose arrays are trusted: float64 and C-contiguous."""
    m = matches
    points = _central_sums(m.points_source, m.points_target, m.point_weights)
    if not len(m.directions_source):
        moments = Moments(*points, np.zeros((3, 3)), 0.0, 0.0)
    else:
        sums = feature_sums(m.directions_source, m.directions_target, m.direction_weights, products_only=True)
        moments = Moments(*points, sums.cross, sums.square_source, sums.square_target)
    H = moments.point_cross + moments.direction_cross
    if not is_narrow(H):
        return moments
    axes, origins = long_axes(H), (moments.mean_source, moments.mean_target)
    nowhere = (np.zeros(3), np.zeros(3))
    aligned = Aligned(
        *axes,
        products_in_axes((m.points_source, m.points_target), m.point_weights, origins, axes),
        products_in_axes((m.directions_source, m.directions_target), m.direction_weights, nowhere, axes),
        _grains(moments),
    )
    return replace(moments, aligned=aligned)


def _central_sums(source: FloatArray, target: FloatArray, weights: FloatArray | None) -> Central:
    if len(source) < BLOCK_ROWS:
        origin = _means(source, target, weights)
        return _about_means(feature_sums(source, target, weights, origin), origin)
    origin = _guess_origin(source, target, weights)
    sums = feature_sums(source, target, weights, origin)
    if sums.weight > 0.0 and (
        _is_far(sums.source, sums.weight, sums.square_source) or _is_far(sums.target, sums.weight, sums.square_target)
    ):
        # The guess was poor: a few heavy rows, say, none of them in the sample. Now the means are known.
        near = (np.zeros(3), np.zeros(3)) if origin is None else origin
        origin = (near[0] + sums.source / sums.weight, near[1] + sums.target / sums.weight)
        sums = feature_sums(source, target, weights, origin)
    return _about_means(sums, origin)


def _means(source: FloatArray, target: FloatArray, weights: FloatArray | None) -> Pair | None:
    if weights is None:
        weights = np.ones(len(source))
    weight = float(weights.sum())
    return (weights @ source / weight, weights @ target / weight) if weight > 0.0 else None


def _guess_origin(source: FloatArray, target: FloatArray, weights: FloatArray | None) -> Pair | None:
    """Means of a sample, or None where the sums about zero lose no more than a digit."""
    step = len(source) // SAMPLE_ROWS
    sample = source[::step], target[::step], None if weights is None else weights[::step]
    origin = _means(*sample)
    if origin is None:
        return None
    sums = feature_sums(*sample)
    if _is_far(sums.source, sums.weight, sums.square_source) or _is_far(sums.target, sums.weight, sums.square_target):
        return origin
    return None


def _is_far(total: FloatArray, weight: float, square: float) -> bool:
    # Sums about an origin this far from the mean, measured in spreads, lose more than one digit to cancellation.
    lever = float(total @ total) / weight
    return not lever <= FAR_SQUARED_SPREADS * (square - lever)


def _about_means(sums: FeatureSums, origin: Pair | None) -> Central:
    weight = sums.weight
    if not weight > 0.0:
        # NaN goes on, for the caller to see; no weight at all means no mean.
        return weight, np.zeros(3), np.zeros(3), np.zeros((3, 3)), sums.square_source, sums.square_target
    offset_source, offset_target = sums.source / weight, sums.target / weight
    return (
        weight,
        offset_source if origin is None else origin[0] + offset_source,
        offset_target if origin is None else origin[1] + offset_target,
        sums.cross - offset_target[:, None] * sums.source,
        # Rounding may leave a tiny negative spread where all points coincide; a spread is never negative.
        max(sums.square_source - float(offset_source @ sums.source), 0.0),
        max(sums.square_target - float(offset_target @ sums.target), 0.0),
    )
