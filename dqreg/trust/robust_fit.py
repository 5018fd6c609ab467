"""A robust least-squares fit of few unknowns to distances along normals, and what it leaves unexplained."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from dqreg._arrays import FloatArray, dot, median, product
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.solvers.sandwich import scatter_of

# Rounds of the robust fit.
MAX_ROUNDS = 8
# Residuals beyond so many standard deviations have no weight (Tukey's biweight).
TUKEY_SIGMAS = 4.685
# A round that moves the fit by less than this share of a standard deviation is the last.
CONVERGENCE_SIGMAS = 0.02
# Information below this share of the whole is none: of fifteen unknowns, some times what `scatter_of` takes for none.
SINGULAR_SHARE = 3e-9
# Strains and motions expected beforehand, in extents of the scan: what the faces do not show stays at zero.
PRIOR_SIGMA_EXTENTS = 0.2
TINY = float(np.finfo(float).tiny)


@dataclasses.dataclass(frozen=True, eq=False)
class RobustFit:
    """A weighted fit of few unknowns to residuals."""

    rows: FloatArray  # (k, n): What each unknown adds to the residuals
    residuals: FloatArray  # (n,)
    lever: float  # Length that rotations are over
    fitted: FloatArray  # (k,)
    weights: FloatArray  # (n,)

    @cached_property
    def left(self) -> FloatArray:
        """Residuals that remain, (n,)."""
        return np.asarray(self.residuals - self.fitted @ self.rows)

    @cached_property
    def variance(self) -> float:
        """Variance of what remains."""
        return dot(self.weights, self.left**2) / max(float(self.weights.sum()) - len(self.rows), 1.0)

    def scatter(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Covariance of the unknowns, (k, k), by patches of points, (n, 3), and normals; None of too few."""
        known = known_before(product(self.rows * self.weights, self.rows.T), self.variance, self.lever)
        return scatter_of(self.rows, points, normals, self.left, self.weights, known, self.variance)


def without_motion(displaced: FloatArray, motions: FloatArray, weights: FloatArray) -> FloatArray:
    """Displacements, (n,), without the motions, (6, n), nearest to them."""
    return np.asarray(displaced - best_motion(displaced, motions, weights) @ motions)


def weighted_rms(values: FloatArray, weights: FloatArray) -> float:
    """Root of the weighted mean square of numbers, (n,); NaN without weight."""
    total = float(weights.sum())
    return math.sqrt(dot(weights, values**2) / total) if total > 0.0 else math.nan


def unexplained(displaced: FloatArray, motions: FloatArray, weights: FloatArray) -> float:
    """Root mean square of displacements, (n,), without the motions, (6, n), nearest to them."""
    return weighted_rms(without_motion(displaced, motions, weights), weights)


def best_motion(displaced: FloatArray, motions: FloatArray, weights: FloatArray) -> FloatArray:
    """Shares of the motions, (6, n), that come nearest to displacements, (n,); zero of what these do not show."""
    # Six unknowns need no decomposition of n rows, which takes ten times as long and wakes the threads of BLAS.
    weighed = motions * weights
    values, axes = np.linalg.eigh(product(weighed, motions.T))
    shown = values > SINGULAR_SHARE * values[-1]
    found: FloatArray = axes[:, shown] @ (axes[:, shown].T @ (weighed @ displaced) / values[shown])
    return found


def robust_fit(
    rows: FloatArray,
    residuals: FloatArray,
    lever: float,
    first: FloatArray,
    is_small: Callable[[FloatArray], bool] = lambda _: False,
    rounds: int = MAX_ROUNDS,
) -> RobustFit:
    """Least squares with Tukey's biweight, from the first weights.

    What is small after two rounds is not fitted to the last digit.
    """
    fitted: FloatArray = np.zeros(len(rows))
    weights, was_small, left = first, False, residuals
    for _ in range(rounds):
        variance = dot(weights, left**2) / float(weights.sum()) + TINY
        weighed = rows * weights
        information = product(weighed, rows.T)
        solved = np.linalg.solve(information + known_before(information, variance, lever), weighed @ residuals)
        step, fitted = solved - fitted, np.asarray(solved, dtype=np.float64)
        now_small = is_small(fitted)
        if was_small and now_small:
            break
        was_small = now_small
        left = residuals - fitted @ rows
        weights = weights_of(left)
        if step @ information @ step <= CONVERGENCE_SIGMAS**2 * variance:
            break
    return RobustFit(rows, residuals, lever, fitted, weights)


def known_before(information: FloatArray, variance: float, lever: float) -> FloatArray:
    """What is known of strains and motions before a fit, in the units of its information, both (k, k).

    Nearly exact data tell next to nothing of what their faces do not show: that has to be told from rounding.
    """
    known = np.zeros(information.shape)
    np.fill_diagonal(
        known, variance / (PRIOR_SIGMA_EXTENTS * lever) ** 2 + SINGULAR_SHARE * float(information.diagonal().sum())
    )
    return known


def weights_of(residuals: FloatArray) -> FloatArray:
    """Tukey's biweight of residuals, (n,), from their own median."""
    aside = np.abs(residuals)
    limit = TUKEY_SIGMAS * GAUSSIAN_MEDIAN * median(aside) + TINY
    # Beyond the limit nothing counts, and exact data would overflow.
    inner = np.minimum(aside, limit) / limit
    return np.asarray((1.0 - inner**2) ** 2)
