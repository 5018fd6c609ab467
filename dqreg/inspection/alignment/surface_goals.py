"""Steps towards the smallest largest deviation and towards one side of the part: linear and quadratic programs."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.inspection.alignment.surface_rows import SurfaceRows
from dqreg.solvers import Freedom, PoseCost

# Rows that enter a program at once; others join while they are violated by so much.
MAX_JOINING_ROWS = 400
# ... of the largest deviation, and of the part's size where all are on one side.
VIOLATED_SHARE, VIOLATED_DIAGONALS = 1e-13, 1e-13
# A prior bounds the minimax pose to that many standard deviations.
PRIOR_SIGMAS = 2.0
# Programs for one step at most.
MAX_PROGRAMS = 50
# Rows that enter a repeated fit at first, and the farthest that it goes.
FIRST_ROWS, MAX_STEP_SIGMAS = 60, 1e4
# What counts as the same largest value, relative to it.
AS_SMALL = 1e-6


def minimax_step(rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None, longest: float) -> FloatArray:
    """Twist about the centre that lowers the largest deviation most, to first order, within a trust region: (6,)."""
    from scipy.optimize import linprog

    values, slopes = rows.scaled(T)
    basis = rows.basis(T, free)
    slopes = slopes @ basis
    values, slopes = np.concatenate([values, -values]), np.concatenate([slopes, -slopes])
    unit = float(np.abs(values).max()) or 1.0
    values, slopes = values / unit, slopes / unit
    fixed, bound = _prior_rows(rows, T, basis, prior)
    count = basis.shape[1]
    chosen = np.argsort(-values, kind="stable")[:MAX_JOINING_ROWS]
    for _ in range(MAX_PROGRAMS):
        left = np.vstack(
            [np.column_stack([slopes[chosen], -np.ones(len(chosen))]), np.column_stack([fixed, np.zeros(len(fixed))])]
        )
        right = np.concatenate([-values[chosen], bound])
        limits = [(-longest * rows.size, longest * rows.size)] * count + [(None, None)]
        found = linprog(np.r_[np.zeros(count), 1.0], A_ub=left, b_ub=right, bounds=limits, method="highs")
        if found.x is None:
            return np.zeros(6)
        step, height = np.asarray(found.x[:-1]), float(found.x[-1])
        missed = _missed(values + slopes @ step - height, chosen, VIOLATED_SHARE)
        if not len(missed):
            break
        chosen = np.concatenate([chosen, missed])
    return np.asarray(basis @ step)


def least_largest(values: FloatArray, slopes: FloatArray) -> FloatArray:
    """The step after which the largest absolute value is least, to first order: (k,)."""
    from scipy.optimize import linprog

    count = slopes.shape[1]
    values, slopes = np.concatenate([values, -values]), np.concatenate([slopes, -slopes])
    chosen, step = np.argsort(-values, kind="stable")[:FIRST_ROWS], np.zeros(count)
    for _ in range(MAX_PROGRAMS):
        left = np.column_stack([slopes[chosen], -np.ones(len(chosen))])
        limits = [(-MAX_STEP_SIGMAS, MAX_STEP_SIGMAS)] * count + [(None, None)]
        found = linprog(np.r_[np.zeros(count), 1.0], A_ub=left, b_ub=-values[chosen], bounds=limits, method="highs")
        if found.x is None:
            return step
        step = np.asarray(found.x[:-1])
        missed = _missed(values + slopes @ step - found.x[-1], chosen, 1e-9)
        if not len(missed):
            return step
        chosen = np.concatenate([chosen, missed[:FIRST_ROWS]])
    return step


def as_small(values: FloatArray, slopes: FloatArray) -> FloatArray:
    """How far each parameter may go with the largest absolute value as small as it is, to first order: (k,)."""
    from scipy.optimize import linprog

    count, height = slopes.shape[1], float(np.abs(values).max())
    spans, largest = np.zeros(count), height * (1.0 + AS_SMALL)
    active = np.abs(values) >= height * (1.0 - AS_SMALL)
    held = np.column_stack([np.sign(values[active])[:, None] * slopes[active], -np.ones(np.count_nonzero(active))])
    if np.linalg.matrix_rank(held) > count:
        return spans
    left, right = np.concatenate([slopes, -slopes]), largest - np.concatenate([values, -values])
    limits = [(-MAX_STEP_SIGMAS, MAX_STEP_SIGMAS)] * count
    for k, sign in ((k, sign) for k in range(count) for sign in (1.0, -1.0)):
        wanted = np.where(np.arange(count) == k, -sign, 0.0)
        found = linprog(wanted, A_ub=left, b_ub=right, bounds=limits, method="highs")
        spans[k] += 0.0 if found.x is None else abs(float(found.x[k]))
    return spans


def one_sided_step(
    rows: SurfaceRows, T: FloatArray, free: Freedom, prior: PoseCost | None, sign: float
) -> FloatArray | None:
    """Twist of the least weighted squares with every deviation on one side of its limit: (6,); None where none is.

    A least distance program (Lawson and Hanson 1974, chapter 23) over the active rows.
    """
    values, slopes = rows.deviations(T)
    basis = rows.basis(T, free)
    slopes = slopes @ basis
    limits = rows.low if sign > 0.0 else -rows.high
    limits = np.where(np.isfinite(limits), limits, 0.0)
    weighted = slopes * rows.weights[:, None]
    hessian, gradient = weighted.T @ slopes, weighted.T @ values
    if prior is not None:
        hessian = hessian + basis.T @ prior.information(T, rows.centre) @ basis
        gradient = gradient + 0.5 * basis.T @ prior.gradient(T, rows.centre)
    root = np.linalg.cholesky(hessian + 1e-14 * np.trace(hessian) * np.eye(len(hessian)))
    # With x = L^T (d - d0) the cost is |x|^2: each row is a half space of x.
    least = -np.linalg.solve(hessian, gradient)
    sides = sign * slopes
    needed = limits - sign * values - sides @ least
    sides = np.asarray(np.linalg.solve(root, sides.T).T, dtype=np.float64)
    chosen = np.argsort(-needed, kind="stable")[:MAX_JOINING_ROWS]
    for _ in range(MAX_PROGRAMS):
        found = _least_distance(sides[chosen], needed[chosen])
        if found is None:
            return None
        x = found
        missed = _missed(needed - sides @ x, chosen, VIOLATED_DIAGONALS * rows.size)
        if not len(missed):
            break
        chosen = np.concatenate([chosen, missed])
    return np.asarray(basis @ (least + np.linalg.solve(root.T, x)))


def one_sided_excess(rows: SurfaceRows, T: FloatArray, free: Freedom, sign: float) -> float:
    """By how much the worst place lies on the wrong side of its limit, at the least, to first order."""
    from scipy.optimize import linprog

    values, slopes = rows.deviations(T)
    slopes = slopes @ rows.basis(T, free)
    limits = rows.low if sign > 0.0 else -rows.high
    short = np.where(np.isfinite(limits), limits, 0.0) - sign * values
    left = np.column_stack([-sign * slopes, -np.ones(len(values))])
    count = slopes.shape[1]
    found = linprog(np.r_[np.zeros(count), 1.0], A_ub=left, b_ub=-short, bounds=[(None, None)] * (count + 1))
    return float(short.max()) if found.x is None else float(found.x[-1])


def _least_distance(sides: FloatArray, needed: FloatArray) -> FloatArray | None:
    """The shortest x with ``sides x >= needed``; None where there is none."""
    from scipy.optimize import nnls

    if (needed <= 0.0).all():
        return np.zeros(sides.shape[1])
    unit = float(np.abs(needed).max())
    system = np.vstack([sides.T, needed / unit])
    target = np.r_[np.zeros(sides.shape[1]), 1.0]
    pulls, rest = nnls(system, target, maxiter=100 * len(needed))
    if rest < 1e-10:
        return None
    gap = system @ pulls - target
    x: FloatArray = -unit * gap[:-1] / gap[-1]
    return x


def _missed(short: FloatArray, chosen: IntArray, enough: float) -> IntArray:
    short = short.copy()
    short[chosen] = -np.inf
    missed = np.flatnonzero(short > enough)
    return missed[np.argsort(-short[missed], kind="stable")][:MAX_JOINING_ROWS]


def _prior_rows(
    rows: SurfaceRows, T: FloatArray, basis: FloatArray, prior: PoseCost | None
) -> tuple[FloatArray, FloatArray]:
    """Bounds of the whitened increment from the prior's pose, to first order. Shapes: (2 r, k), (2 r,)."""
    if prior is None:
        return np.zeros((0, basis.shape[1])), np.zeros(0)
    strengths, axes = np.linalg.eigh(prior.information(T, rows.centre))
    known = strengths > 1e-12 * max(float(strengths[-1]), 1e-300)
    root = np.sqrt(strengths[known])
    # The cost is |e + W d|^2 with W^T W the information: its gradient is 2 W^T e.
    away = 0.5 * axes[:, known].T @ prior.gradient(T, rows.centre) / root
    slopes = (axes[:, known] * root).T @ basis
    bounds = np.concatenate([PRIOR_SIGMAS - away, PRIOR_SIGMAS + away])
    return np.vstack([slopes, -slopes]), bounds.clip(min=0.0)
