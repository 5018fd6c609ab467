"""Covariance of minimum zone, inscribed and circumscribed shapes: the fit repeated on drawn residuals."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.features.models import PARAMETERS, FeatureKind, Shape, as_displacements, distances
from dqreg.inspection.features.spread import DRAW_SEED, MIN_PATCHED_POINTS, covariance_of
from dqreg.inspection.features.zone import PRISM_SIDES, ZoneMethod, ZoneProblem, chebyshev_step
from dqreg.solvers.sandwich import larger

# Fits that are repeated on drawn residuals.
RESIDUAL_DRAWS = 100
# Bounds of the step of a linear problem, in standard deviations of a residual: it has a least without them.
STEP_BOUND_SIGMAS = 1e6
# The cylinder about a line is a prism here, within a hundredth of it, about so many points.
FARTHEST_POINTS = 60
# Residuals with less kurtosis than that lie at two values; beyond the other, a handful of points decides.
MIN_KURTOSIS, MAX_KURTOSIS = 1.2, 9.0


def zone_covariance(
    kind: FeatureKind, method: ZoneMethod, points: FloatArray, *, shape: Shape, gauss: Shape
) -> FloatArray:
    """Of the parameters of a zone's shape, (k, k): how they scatter when the points' residuals are drawn again.

    A few extreme points decide, so residuals are drawn from the symmetric distribution that has the spread and the
    kurtosis of those of the least squares shape (a beta or a Student distribution; parametric bootstrap, Efron and
    Tibshirani 1993, section 6.5). The fit is repeated to first order. What neighbours have in common, where there are
    400 points, counts at least as in the least squares fit.
    """
    centre = points.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)))) or 1.0
    rows, own = distances(kind, gauss, points)
    unit = as_displacements(kind, size)
    _, slopes = distances(kind, shape, points)
    slopes = slopes * unit
    rng = np.random.default_rng(DRAW_SEED)
    problem, count = ZoneProblem(kind, method, points), own.shape[1]
    steps = np.zeros((RESIDUAL_DRAWS, count))
    drawn = _drawn(rows, len(points), count, rng)
    scale = float(drawn.std())
    if scale == 0.0:
        return covariance_of(kind, shape, points, rows, own)
    for step, values in zip(steps, drawn / scale, strict=True):
        step[:] = _repeated(problem, values, slopes)
    # The inverse of a covariance from few draws is too large by this (Hartlap, Simon and Schneider 2007).
    found = np.cov(steps.T).reshape(count, count) * scale**2 * (RESIDUAL_DRAWS - 1) / (RESIDUAL_DRAWS - count - 2)
    covariance: FloatArray = found * unit * unit[:, None]
    if len(points) < MIN_PATCHED_POINTS or len(rows) != len(points):
        return covariance
    # Scaled, so that parameters of any unit stand beside each other.
    lengths = np.sqrt(np.diag(covariance))
    both = lengths[:, None] * lengths
    return np.asarray(larger(covariance / both, covariance_of(kind, gauss, points, rows, own) / both) * both)


def noise_covariance(
    kind: FeatureKind, method: ZoneMethod, points: FloatArray, *, shape: Shape, sigma: float
) -> FloatArray:
    """Of the parameters of a zone's shape, (k, k): how they scatter when noise is added to the points anew."""
    size = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))) or 1.0
    unit = as_displacements(kind, size)
    values, slopes = distances(kind, shape, points)
    rng, problem = np.random.default_rng(DRAW_SEED), ZoneProblem(kind, method, points)
    drawn = (values / sigma + rng.standard_normal(len(values)) for _ in range(RESIDUAL_DRAWS))
    steps = [_repeated(problem, each, slopes * unit) for each in drawn]
    found: FloatArray = np.cov(np.array(steps).T) * sigma**2 * unit * unit[:, None]
    return found


def _repeated(problem: ZoneProblem, values: FloatArray, slopes: FloatArray) -> FloatArray:
    """The step of all parameters that the zone's shape takes for other residuals, to first order, (k,)."""
    # What a circle's zone leaves to the least squares fit follows that.
    step = np.linalg.lstsq(slopes, -values, rcond=None)[0]
    if problem.kind == "line":
        x, y = values.reshape(2, -1)
        rows = np.argsort(-np.hypot(x, y), kind="stable")[:FARTHEST_POINTS]
        turns = 2.0 * np.pi / PRISM_SIDES * np.arange(PRISM_SIDES)[:, None]
        across = np.cos(turns) * x[rows] + np.sin(turns) * y[rows]
        change_x, change_y = slopes.reshape(2, len(x), -1)[:, rows]
        changes = np.cos(turns)[..., None] * change_x + np.sin(turns)[..., None] * change_y
        return chebyshev_step(across.ravel(), changes.reshape(across.size, -1), STEP_BOUND_SIGMAS)
    ahead, changes = problem.of_distances(values, slopes, 0.0)
    step[problem.free] = chebyshev_step(ahead, changes, STEP_BOUND_SIGMAS)
    if problem.method != "chebyshev":
        height = float((ahead + changes @ step[problem.free]).max())
        step[PARAMETERS[problem.kind].index("radius")] = problem.sign * height
    return np.asarray(step)


def _drawn(rows: FloatArray, points: int, count: int, rng: np.random.Generator) -> FloatArray:
    """Residuals as they might have been, (draws, r): each component by itself."""
    parts = rows.reshape(-1, points)
    freedom = max(rows.size - count, 1) / rows.size
    drawn = np.concatenate([_alike(each, rng) for each in parts], axis=1)
    return np.asarray(drawn / np.sqrt(freedom))


def _alike(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws of a symmetric distribution with the spread and kurtosis of values, (draws, n)."""
    spread = float(np.sqrt(np.mean(values**2)))
    if spread == 0.0:
        return np.zeros((RESIDUAL_DRAWS, len(values)))
    # Of few values the extremes are short: half a standard error more is rather too much than too little.
    known = float(np.mean((values / spread) ** 4))
    known += 0.25 * (known - 1.0) * np.sqrt(24.0 / len(values))
    kurtosis = float(np.clip(known, MIN_KURTOSIS, MAX_KURTOSIS))
    size = (RESIDUAL_DRAWS, len(values))
    if kurtosis < 3.0:
        # Of Beta(a, a) it is 3 - 6 / (2 a + 3), and the variance on -1 to 1 is 1 / (2 a + 1).
        a = 0.5 * (6.0 / max(3.0 - kurtosis, 1e-3) - 3.0)
        return np.asarray(spread * np.sqrt(2.0 * a + 1.0) * (2.0 * rng.beta(a, a, size) - 1.0))
    # Of Student's distribution it is 3 + 6 / (nu - 4), and the variance nu / (nu - 2).
    nu = 4.0 + 6.0 / max(kurtosis - 3.0, 1e-3)
    return np.asarray(spread * np.sqrt((nu - 2.0) / nu) * rng.standard_t(nu, size))
