"""Covariance of an alignment to faces: by patches for least squares, by the rows that decide for extreme values."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.alignment.surface_rows import SurfaceRows
from dqreg.solvers import Freedom
from dqreg.solvers.sandwich import scatter_of

# A row decides where it is within that share of the largest of its limit, or so many sizes of the part from it.
DECIDES = 1e-6


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
    residuals = values - middle
    freedom = max(len(values) - basis.shape[1], 1)
    variance = float(rows.weights @ residuals**2) / freedom
    spread = scatter_of(slopes.T, moved, normals, residuals, rows.weights, known, 1.0)
    if spread is None:
        information = (slopes * rows.weights[:, None]).T @ slopes / max(variance, 1e-300) + known
        spread = np.linalg.pinv(information, rcond=1e-13, hermitian=True)
    return np.asarray(spread, dtype=np.float64)


def _of_largest(rows: SurfaceRows, T: FloatArray, basis: FloatArray, least: FloatArray) -> FloatArray:
    values, slopes = rows.scaled(T)
    sizes = np.abs(values)
    active = sizes >= sizes.max() * (1.0 - DECIDES)
    signs, unit = np.sign(values[active]), np.linalg.norm(slopes[active][:, 3:], axis=1)
    # The equal largest values fix the pose and their own size: each is known as well as its median.
    matrix = np.column_stack([signs[:, None] * (slopes[active] @ basis), -np.ones(len(signs))])
    inverse = np.linalg.pinv(matrix, rcond=1e-9)[:-1] * unit
    return np.asarray(rows.place_sigma(T) ** 2 * inverse @ inverse.T + _open(matrix[:, :-1], least))


def _of_one_side(rows: SurfaceRows, T: FloatArray, basis: FloatArray, least: FloatArray, sign: float) -> FloatArray:
    _, values, slopes, _ = rows.at(T)
    limits = rows.low if sign > 0.0 else -rows.high
    limits = np.where(np.isfinite(limits), limits, 0.0)
    active = sign * values - limits <= DECIDES * rows.size * 1e-3
    matrix = slopes[active] @ basis
    inverse = np.linalg.pinv(matrix, rcond=1e-9)
    return np.asarray(rows.place_sigma(T) ** 2 * inverse @ inverse.T + _open(matrix, least))


def _open(matrix: FloatArray, least: FloatArray) -> FloatArray:
    """What the rows leave open is as uncertain as in the best fit."""
    _, strengths, axes = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.count_nonzero(strengths > 1e-9 * max(float(strengths.max(initial=0.0)), 1e-300)))
    null = axes[rank:].T
    return np.asarray(null @ null.T @ least @ null @ null.T)
