"""The sums over all matches from which the pose follows: additive over chunks, threads and machines.

Weighted sums of products over matched rows: one pass in blocks that stay in the cache, by small BLAS products.

A block is 2048 rows because every product then stays below the size at which BLAS wakes its threads, whose
hand-over costs more than the product. Two rows of three numbers are read as one row of six: the 6x6 product of
those costs half of the 3x3 product, whose registers are mostly empty, and its two diagonal blocks add up to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dqreg._arrays import FloatArray

BLOCK = 2048
# Blocks that one call of matmul runs through: enough to hide the price of the call, few enough for the cache.
STACK = 16
# Rows of the block when its vectors are summed by a product with ones.
SUM_ROWS = 64

Pair = tuple[FloatArray, FloatArray]


class FeatureSums(NamedTuple):
    """Sums over matched vectors a (source) and b (target), both about one given origin a side."""

    weight: float  # ``sum w``
    # source, target: (3,): ``sum w a`` and ``sum w b``
    source: FloatArray
    target: FloatArray
    cross: FloatArray  # (3, 3): ``sum w b a^T``
    # square_source, square_target: ``sum w |a|^2`` and ``sum w |b|^2``
    square_source: float
    square_target: float


def feature_sums(
    source: FloatArray,
    target: FloatArray,
    weights: FloatArray | None = None,
    origin: Pair | None = None,
    *,
    products_only: bool = False,
) -> FeatureSums:
    """Sum over all rows."""
    whole = len(source) // BLOCK * BLOCK
    if not whole:
        return _sums_of_few(source, target, weights, origin)
    head = _sums_of_blocks(
        (source[:whole], target[:whole]), None if weights is None else weights[:whole], origin, products_only
    )
    if whole == len(source):
        return head
    tail = _sums_of_few(source[whole:], target[whole:], None if weights is None else weights[whole:], origin)
    return FeatureSums(
        head.weight + tail.weight,
        head.source + tail.source,
        head.target + tail.target,
        head.cross + tail.cross,
        head.square_source + tail.square_source,
        head.square_target + tail.square_target,
    )


def _sums_of_few(
    source: FloatArray, target: FloatArray, weights: FloatArray | None, origin: Pair | None
) -> FeatureSums:
    if origin is not None:
        source, target = source - origin[0], target - origin[1]
    if weights is None:
        weights = np.ones(len(source))
        heavy_source, heavy_target = source, target
    else:
        heavy_source, heavy_target = source * weights[:, None], target * weights[:, None]
    return FeatureSums(
        float(weights.sum()),
        weights @ source,
        weights @ target,
        heavy_target.T @ source,
        float(np.dot(heavy_source.ravel(), source.ravel())),
        float(np.dot(heavy_target.ravel(), target.ravel())),
    )


def _sums_of_blocks(rows: Pair, weights: FloatArray | None, origin: Pair | None, products_only: bool) -> FeatureSums:
    count = len(rows[0]) // BLOCK
    source, target = (side.reshape(count, 3 * BLOCK) for side in rows)
    by_block = None if weights is None else weights.reshape(count, BLOCK)
    shift = None if origin is None else np.tile(np.stack(origin), BLOCK)
    moved, weighed = np.zeros((2, min(STACK, count), 3 * BLOCK)), np.zeros((3, min(STACK, count), 3 * BLOCK))
    cross, squares = np.zeros((count, 6, 6)), np.zeros((2, count, 1, 1))
    sums, ones = np.zeros((2, count, 3 * BLOCK // SUM_ROWS)), np.ones(SUM_ROWS)
    for first in range(0, count, STACK):
        here = slice(first, min(first + STACK, count))
        pair = (source[here], target[here])
        k = len(pair[0])
        if shift is not None:
            pair = tuple(np.subtract(pair[side], shift[side], out=moved[side, :k]) for side in (0, 1))
        heavy = pair if by_block is None else _weigh(pair, by_block[here], weighed[:, :k])
        np.matmul(heavy[1].reshape(k, -1, 6).transpose(0, 2, 1), pair[0].reshape(k, -1, 6), out=cross[here])
        for side in (0, 1):
            np.matmul(pair[side][:, None, :], heavy[side][:, :, None], out=squares[side, here])
            if not products_only:
                np.matmul(ones, heavy[side].reshape(k, SUM_ROWS, -1), out=sums[side, here])
    two = cross.sum(axis=0).reshape(2, 3, 2, 3)
    of_source, of_target = sums.sum(axis=1).reshape(2, -1, 3).sum(axis=1)
    weight = float(len(rows[0])) if weights is None else float(weights.sum())
    square_source, square_target = squares.sum(axis=(1, 2, 3)).tolist()
    return FeatureSums(weight, of_source, of_target, two[0, :, 0] + two[1, :, 1], square_source, square_target)


def _weigh(pair: Pair, weights: FloatArray, out: FloatArray) -> Pair:
    # Each weight is written three times in a row: flat products are far cheaper than rows of three times one.
    thrice = out[2].reshape(*weights.shape, 3)
    for axis in range(3):
        thrice[:, :, axis] = weights
    return np.multiply(pair[0], out[2], out=out[0]), np.multiply(pair[1], out[2], out=out[1])


# Rows looked at to guess the means of a large set.
SAMPLE = 64
# Squared distance of the origin from the mean, in squared spreads, up to which sums are taken as they come.
FAR = 16.0

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

    def __add__(self, other: Moments) -> Moments:
        weight = self.point_weight + other.point_weight
        step_source = other.mean_source - self.mean_source
        step_target = other.mean_target - self.mean_target
        share = other.point_weight / weight if weight else 0.0
        # Each set is central about its own mean; moving both to the common mean adds one pair of that weight.
        lever = self.point_weight * share
        return Moments(
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

    @property
    def is_finite(self) -> bool:
        """Whether every number summed was finite and none overflowed when squared."""
        total = self.point_weight + self.spread_source + self.spread_target + self.length_source + self.length_target
        return math.isfinite(total)

    @property
    def constant(self) -> float:
        """The cost before the rotation enters: all spreads and lengths; the cost is this less twice the fit."""
        return self.spread_source + self.spread_target + self.length_source + self.length_target


def moments_of(
    points_source: FloatArray,
    points_target: FloatArray,
    point_weights: FloatArray | None = None,
    directions_source: FloatArray | None = None,
    directions_target: FloatArray | None = None,
    direction_weights: FloatArray | None = None,
) -> Moments:
    """Sum the moments in one pass; the arrays are trusted.

    Parameters
    ----------
    points_source, points_target : ndarray, (n, 3)
        Matched points, float64 and C-contiguous.
    point_weights : ndarray, (n,), optional
        beta >= 0; 1 where not given.
    directions_source, directions_target : ndarray, (m, 3), optional
        Matched directions, float64 and C-contiguous, weighed as given: none is scaled to unit length.
    direction_weights : ndarray, (m,), optional
        alpha >= 0; 1 where not given.

    Returns
    -------
    Moments
        Not finite if an input was not: see `Moments.is_finite`.

    Examples
    --------
    >>> round(moments_of(np.eye(3), np.eye(3) + 5.0).spread_source, 12)
    2.0
    """
    points = _central_sums(points_source, points_target, point_weights)
    if directions_source is None or directions_target is None or not len(directions_source):
        return Moments(*points, np.zeros((3, 3)), 0.0, 0.0)
    sums = feature_sums(directions_source, directions_target, direction_weights, products_only=True)
    return Moments(*points, sums.cross, sums.square_source, sums.square_target)


def _central_sums(source: FloatArray, target: FloatArray, weights: FloatArray | None) -> Central:
    if len(source) < BLOCK:
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
    step = len(source) // SAMPLE
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
    return not lever <= FAR * (square - lever)


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
