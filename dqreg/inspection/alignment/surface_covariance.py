"""Covariance of an alignment to faces: by patches for least squares, by the rows that decide for extreme values."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray, dot
from dqreg.inspection.alignment.surface_goals import as_small, least_largest
from dqreg.inspection.alignment.surface_rows import SurfaceRows
from dqreg.inspection.decision.places import MEDIAN_SIGMA, PLACE_POINTS
from dqreg.inspection.decision.surface_model import SmoothSurface
from dqreg.inspection.features.spread import DRAW_SEED, MIN_RESIDUAL_SHARE, without_form
from dqreg.solvers import Freedom
from dqreg.solvers.sandwich import larger, scatter_of

# A row decides where it is so near to its limit.
ACTIVE_ROW_DIAGONALS = 1e-9
# Noise below that share of the part's size is rounding.
ROUNDING_DIAGONALS = 1e-12
# Repeated fits, and the places that enter them: those with the largest deviations.
NOISE_DRAWS, MAX_DRAWN_PLACES = 60, 1_000


def covariance_of(rows: SurfaceRows, T: FloatArray, goal: str, free: Freedom, prior: FloatArray | None) -> FloatArray:
    """Of the twist about the centre, (6, 6); 0 along locked motions."""
    basis = rows.basis(T, free)
    known = np.zeros((basis.shape[1],) * 2) if prior is None else basis.T @ prior @ basis
    least = _least_squares(rows, T, basis, known)
    spread = least
    if goal == "minimax":
        spread = _of_largest(rows, T, basis, least)
    elif goal in ("outside", "inside"):
        spread = _of_one_side(rows, T, basis, least, 1.0 if goal == "outside" else -1.0)
    full: FloatArray = basis @ spread @ basis.T
    return 0.5 * (full + full.T)


def _least_squares(rows: SurfaceRows, T: FloatArray, basis: FloatArray, known: FloatArray) -> FloatArray:
    moved, values, slopes, normals = rows.at(T)
    slopes = slopes @ basis
    # A tolerance fit centres what is within the bands; what is far out has no pull.
    banded = np.isfinite(rows.low) & np.isfinite(rows.high)
    middle = np.where(banded, 0.5 * (np.where(banded, rows.low, 0.0) + np.where(banded, rows.high, 0.0)), 0.0)
    residuals, pulls = values - middle, slopes * rows.weights[:, None]
    bread = np.asarray(np.linalg.pinv(pulls.T @ slopes + known, rcond=1e-13, hermitian=True), dtype=np.float64)
    white = _independent(pulls, slopes, residuals, bread, known)
    # Beside a prior the weights are inverse variances already.
    variance = 1.0 if known.any() else dot(rows.weights, residuals**2) / max(len(values) - basis.shape[1], 1)
    spread = scatter_of(slopes.T, moved, normals, residuals, rows.weights, known, variance)
    return white if spread is None else without_form(spread, white, rows.scanned(basis))


def _independent(
    pulls: FloatArray, slopes: FloatArray, residuals: FloatArray, bread: FloatArray, known: FloatArray
) -> FloatArray:
    """Of points with independent errors, each as large as its residual (HC3). Shapes: (n, k), (n, k), (n,), (k, k)."""
    left = 1.0 - np.einsum("ni,ij,nj->n", pulls, bread, slopes)
    each = (residuals / np.maximum(left, MIN_RESIDUAL_SHARE))[:, None] * pulls
    return np.asarray(bread @ (each.T @ each + known) @ bread)


def _of_largest(rows: SurfaceRows, T: FloatArray, basis: FloatArray, least: FloatArray) -> FloatArray:
    """By repeating the fit, to first order: which places are the farthest is chance too.

    Once with the noise of the medians drawn again, once on surfaces that the points allow for; the larger counts.
    """
    values, slopes = rows.scaled(T)
    unit = np.linalg.norm(slopes[:, 3:], axis=1)
    slopes = slopes @ basis
    if rows.place_sigma(T) <= ROUNDING_DIAGONALS * rows.size:
        return np.zeros_like(least)
    chosen = np.argsort(-np.abs(values), kind="stable")[:MAX_DRAWN_PLACES]
    # What is noise already is not there twice.
    variance = float(np.mean((values / unit) ** 2))
    surface = np.sqrt(max(1.0 - rows.place_sigma(T) ** 2 / variance, 0.0)) if variance > 0.0 else 0.0
    values, slopes, unit = values[chosen], slopes[chosen], unit[chosen]
    lengths = np.sqrt(np.maximum(np.diag(least), 1e-300))
    size = max(float(np.abs(values).max()), np.finfo(float).tiny)
    # Parameters in standard deviations of the best fit: of one size.
    slopes = slopes * lengths / size
    steps = np.array([least_largest(each / size, slopes) for each in surface * values + unit * _noise(rows, T, chosen)])
    # The inverse of a covariance from few draws is too large by this (Hartlap, Simon and Schneider 2007).
    found = np.atleast_2d(np.cov(steps.T)) * (NOISE_DRAWS - 1) / (NOISE_DRAWS - len(lengths) - 2)
    between = values + unit * _between(rows, T, chosen)
    found = _covering(found, np.array([least_largest(each / size, slopes) for each in between]))
    # Poses whose largest deviation is as small are all an answer.
    found = found + np.diag(as_small(values / size, slopes) ** 2 / 12.0)
    return np.asarray(found * lengths * lengths[:, None])


def _covering(found: FloatArray, steps: FloatArray) -> FloatArray:
    """A covariance that is no less in any direction than what steps from the pose, (draws, k), are on average."""
    return larger(found, np.asarray(steps.T @ steps / len(steps))) if found.any() else found


def _between(rows: SurfaceRows, T: FloatArray, chosen: IntArray) -> FloatArray:
    """By how much the surface at some rows may differ from the medians there, by its own points: (draws, m).

    Medians flatten what bends within their neighbourhoods, and the farthest places lie between points.
    """
    if np.isnan(rows.sigma):
        return np.zeros((NOISE_DRAWS, len(chosen)))
    moved, values, _, _ = rows.at(T)
    own, noise = values - rows.offsets, rows.sigma * np.sqrt(PLACE_POINTS) / MEDIAN_SIGMA
    rng, found = np.random.default_rng(DRAW_SEED), np.zeros((NOISE_DRAWS, len(chosen)))
    for label in np.unique(rows.labels[chosen]):
        on, here = np.flatnonzero(rows.labels == label), np.flatnonzero(rows.labels[chosen] == label)
        if len(on) >= 2 * PLACE_POINTS:
            surface = SmoothSurface.of(own[on], moved[on], float(noise))
            found[:, here] = surface.drawn(moved[chosen[here]], NOISE_DRAWS, rng) - values[chosen[here]]
    return found


def _noise(rows: SurfaceRows, T: FloatArray, chosen: IntArray) -> FloatArray:
    """Noise of the deviations of some rows as it might have been, alike where medians share points: (draws, m)."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(DRAW_SEED)
    if np.isnan(rows.sigma):
        return np.asarray(rows.place_sigma(T) * rng.standard_normal((NOISE_DRAWS, len(chosen))))
    around = np.zeros((len(chosen), PLACE_POINTS), dtype=np.int64)
    for label in np.unique(rows.labels[chosen]):
        own, here = np.flatnonzero(rows.labels == label), np.flatnonzero(rows.labels[chosen] == label)
        nearest = cKDTree(rows.points[own]).query(rows.points[chosen[here]], k=min(PLACE_POINTS, len(own)))[1]
        nearest = np.asarray(nearest, dtype=np.int64).reshape(len(here), -1)
        # A face of fewer points than that repeats them.
        around[here] = own[np.resize(nearest.T, (PLACE_POINTS, len(here))).T]
    factor = rows.sigma * np.sqrt(PLACE_POINTS)
    draws = [rng.standard_normal(len(rows.points))[around].mean(axis=1) for _ in range(NOISE_DRAWS)]
    return np.asarray(factor * np.stack(draws))


def _of_one_side(rows: SurfaceRows, T: FloatArray, basis: FloatArray, least: FloatArray, sign: float) -> FloatArray:
    _, values, slopes, _ = rows.at(T)
    limits = rows.low if sign > 0.0 else -rows.high
    limits = np.where(np.isfinite(limits), limits, 0.0)
    active = sign * values - limits <= ACTIVE_ROW_DIAGONALS * rows.size
    matrix = slopes[active] @ basis
    inverse = np.linalg.pinv(matrix, rcond=1e-9)
    return np.asarray(rows.place_sigma(T) ** 2 * inverse @ inverse.T + _open(matrix, least))


def _open(matrix: FloatArray, least: FloatArray) -> FloatArray:
    """What the rows leave open is as uncertain as in the best fit."""
    _, strengths, axes = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.count_nonzero(strengths > 1e-9 * max(float(strengths.max(initial=0.0)), 1e-300)))
    null = axes[rank:].T
    return np.asarray(null @ null.T @ least @ null @ null.T)
