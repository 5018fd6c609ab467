"""Points of the last level, sampled by their information gain: those that reduce the uncertainty of the pose most."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, product
from dqreg.icp.correspondences import Correspondences
from dqreg.solvers.quadratic import plane_rows

# Every part of the scan keeps this fraction of an even choice: a misfit there must show.
EVEN_SHARE = 0.25
# Information below this fraction of the largest counts as that much: an unconstrained motion must not draw all points.
MIN_INFORMATION_SHARE = 1e-6
# Gains below this fraction of the largest are none.
MIN_GAIN_SHARE = 1e-9


def information_gain(pairs: Correspondences, weights: FloatArray) -> FloatArray:
    """Decrease of the mean squared displacement of the part by one more correspondence like each, (n,); mean one.

    With point-to-plane rows ``J``, scaled so that rotations and translations are displacements, it is ``tr(M^-1)``,
    ``M = sum w J^T J``; one more like i lowers it by ``w J_i M^-2 J_i^T``.
    """
    points, normals = pairs.moved, pairs.closest.normals
    centre = points.mean(axis=0)
    centred = points - centre
    lever = float(np.sqrt(np.einsum("ij,ij->", centred, centred) / len(centred)))
    rows = plane_rows(points, normals, centre, lever)
    values, vectors = np.linalg.eigh(product(rows * weights, rows.T))
    if not values[-1] > 0.0:
        return np.ones(len(weights))
    held = np.maximum(values, MIN_INFORMATION_SHARE * values[-1])
    gain = weights * ((product(vectors.T, rows) / held[:, None]) ** 2).sum(axis=0)
    mean = float(gain.mean())
    return gain / mean if mean > 0.0 else np.ones(len(weights))


def sample_by_gain(values: FloatArray, places: IntArray, total: int, count: int) -> IntArray:
    """Rows to take, more of them where the gain is high. Shapes: values (m,), places (m,)."""
    if count >= total:
        return np.arange(total)
    return sample_runs_by_gain(values, np.diff(np.r_[0, (places[1:] + places[:-1] + 1) // 2, total]), count)


def sample_runs_by_gain(
    values: FloatArray, lengths: IntArray, count: int, left_out: BoolArray | None = None
) -> IntArray:
    """Rows to take out of consecutive runs, more of them where the gain is high.

    Shapes: values (m,), lengths (m,), of rows that are not left out; left_out (n,).
    """
    from dqreg.kernels.steps.systematic_rows import systematic_rows

    total = int(lengths.sum())
    out = np.zeros(0, dtype=bool) if left_out is None else left_out
    if count >= total or not count:
        rows = np.flatnonzero(~out) if len(out) else np.arange(total)
        return rows[: min(count, total)]
    even = count / total
    # A sure outlier has a weight of 1e-300, and numbers that small do not divide.
    values = np.where(values > MIN_GAIN_SHARE * values.max(), values, 0.0)
    rates = np.minimum(_filled(values, lengths, (1.0 - EVEN_SHARE) * count) + EVEN_SHARE * even, 1.0)
    rows = np.zeros(int(rates @ lengths) + 2, dtype=np.int64)
    return rows[: systematic_rows(rates, lengths, out, rows)]


def _filled(values: FloatArray, lengths: IntArray, count: float) -> FloatArray:
    # Rates in proportion to the values, none above one: what is cut off there goes to the others.
    full = np.zeros(len(values), dtype=bool)
    rates = np.ones(len(values))
    for _ in range(len(values)):
        left = count - lengths[full].sum()
        open_ = float(values[~full] @ lengths[~full])
        if left <= 0.0 or open_ <= 0.0:
            break
        rates = np.where(full, 1.0, values * left / open_)
        more = rates > 1.0
        if not more.any():
            break
        full |= more
    return np.minimum(rates, 1.0)
