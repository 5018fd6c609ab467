"""Sums and residuals of a block of problems, with the problem as the last axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.solvers.batched_input import Sides
from dqreg.solvers.least_squares import SMALLEST_SQUARE
from dqreg.solvers.rounding import SAME_POINT, grain_of, rounding_of


@dataclass(frozen=True, slots=True, eq=False)
class BatchSums:
    """What decides the poses of c problems; see `closed_form` for the letters."""

    weight: FloatArray  # (c,): ``sum beta``
    # mean_source, mean_target: (3, c): Weighted means of the points
    mean_source: FloatArray
    mean_target: FloatArray
    # p, q: (3, k, c): Points less their mean
    p: FloatArray
    q: FloatArray
    H: FloatArray  # (3, 3, c): Matrices of the rotations' fit
    # reach, floor: (c,): Largest lambda_1 such data could have, and gap that the rounding of coordinates could make
    reach: FloatArray
    floor: FloatArray
    grains: FloatArray  # (2, c): How far rounding may move the points of either side, see `rounding`
    # wide, faint: (c,): Whether the points count, as those in one place do not; whether their squares lose digits
    wide: BoolArray
    faint: BoolArray


def sum_block(source: FloatArray, target: FloatArray, beta: FloatArray, directions: Sides | None) -> BatchSums:
    """Sums of a block of problems. Shapes: source, target (3, k, c), beta (k, c), directions (3, j, c)."""
    weight = beta.sum(axis=0)
    share = beta / np.where(weight > 0.0, weight, 1.0)
    mean_source, p = _about_mean(source, share)
    mean_target, q = _about_mean(target, share)
    H, spread_source, spread_target = _products(p, q, beta)
    sizes = np.sqrt(spread_source), np.sqrt(spread_target)
    away = [np.sqrt((mean**2).sum(axis=0)) for mean in (mean_source, mean_target)]
    # That of the mean alone: what the spread has rounds with the sums.
    far = [SAME_POINT * np.sqrt(weight) * each for each in away]
    wide = (sizes[0] > far[0]) & (sizes[1] > far[1])
    least = np.minimum(spread_source, spread_target)
    faint = (least > 0.0) & (least < SMALLEST_SQUARE * weight)
    H = np.where(wide, H, 0.0)
    reach = np.where(wide, sizes[0] * sizes[1], 0.0)
    floor = np.where(wide, rounding_of((far[0], far[1]), sizes), 0.0)
    grains = np.array([grain_of(weight, each, size**2) for each, size in zip(away, sizes, strict=True)])
    if directions is not None:
        more, length_source, length_target = _products(*directions)
        H = H + more
        reach = reach + np.sqrt(length_source) * np.sqrt(length_target)
    return BatchSums(weight, mean_source, mean_target, p, q, H, reach, floor, grains, wide, faint)


def residual_sums(
    R: FloatArray, sums: BatchSums, beta: FloatArray, directions: Sides | None
) -> tuple[FloatArray, FloatArray]:
    """Points' and directions' part of the costs, from the residuals.

    Shapes: R (3, 3, c), beta (k, c), directions (3, j, c), point_cost, direction_cost (c,).
    """
    point_cost = _residuals(R, sums.p, sums.q, beta)
    return point_cost, np.zeros_like(point_cost) if directions is None else _residuals(R, *directions)


def _about_mean(points: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = (points * share).sum(axis=1)
    away = points - mean[:, None]
    # The mean of far points rounds at the size of the coordinates; what is left of it is taken off too.
    rest = (away * share).sum(axis=1)
    return mean + rest, away - rest[:, None]


def _products(a: FloatArray, b: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    heavy = b * weights
    cross = np.array([[(heavy[i] * a[j]).sum(axis=0) for j in range(3)] for i in range(3)])
    square_b = (heavy * b).sum(axis=(0, 1))
    square_a = ((a * a).sum(axis=0) * weights).sum(axis=0)
    return cross, square_a, square_b


def _residuals(R: FloatArray, a: FloatArray, b: FloatArray, weights: FloatArray) -> FloatArray:
    squared = np.zeros_like(weights)
    for i in range(3):
        away = R[i, 0] * a[0] + R[i, 1] * a[1] + R[i, 2] * a[2] - b[i]
        squared += away * away
    total: FloatArray = (squared * weights).sum(axis=0)
    return total
