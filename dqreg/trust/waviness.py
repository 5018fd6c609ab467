"""What the residuals of neighbouring points have in common, and their noise from point to point."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray, IntArray, quantile

# Points after each other along the curve that are compared, and pairs of them without which nothing is said.
CURVE_LAGS, MIN_LAG_PAIRS = (1, 3), 200
# Normals of one face are within this angle.
SAME_FACE_COS = 0.95
# Share of the variance that neighbours have in common from which on it is no chance. Right poses of generated scans
# came to 0.05, where clamps stand near by to 0.32.
COMMON_VARIANCE_SHARE = 0.3
# Quantile of the differences between neighbours that tells the noise: larger ones are between two sheets, or of
# outliers. That quantile of the differences of two numbers with a standard deviation of 1.
NOISE_QUANTILE, NORMAL_QUANTILE = 0.3, 0.545


def waviness_of(residuals: FloatArray, normals: FloatArray, beside: IntArray | None = None) -> tuple[float, float]:
    """What neighbouring residuals have in common, 0 where that is little of them, and their noise from point to point.

    Noise differs from point to point, and a wave, a dent or a face laid beside its place does not: neither is measured
    by how well the whole scan fits. One standard deviation each; the noise is NaN for few points.

    Shapes: residuals (n,), normals (n, 3), both in the order of a space-filling curve; beside (n, k): the neighbours of
    each point, those on the curve where none are given.
    """
    apart, together, alone = _differences(
        residuals, normals, _along_curve(len(residuals)) if beside is None else beside
    )
    count = len(apart)
    if count < MIN_LAG_PAIRS:
        return 0.0, np.nan
    shared = math.sqrt(together / count) if together > COMMON_VARIANCE_SHARE * alone else 0.0
    return shared, quantile(apart, NOISE_QUANTILE) / NORMAL_QUANTILE


def common_share(residuals: FloatArray, normals: FloatArray) -> float:
    """Share of the variance of residuals, (n,), that neighbours on the curve have in common: about 0 of noise alone.

    It is 1 of few points, which do not tell. Normals are (n, 3).
    """
    apart, together, alone = _differences(residuals, normals)
    return together / alone if len(apart) >= MIN_LAG_PAIRS and alone > 0.0 else 1.0


def _differences(
    residuals: FloatArray, normals: FloatArray, beside: IntArray | None = None
) -> tuple[FloatArray, float, float]:
    """How far the residuals of neighbours differ, (m,), and the sums of their products and of their squares."""
    from dqreg.kernels.evidence.neighbour_differences import neighbour_differences
    from dqreg.kernels.threads import as_plain

    beside = _along_curve(len(residuals)) if beside is None else beside
    apart, sums = np.zeros(beside.size), np.zeros(2)
    columns = as_plain(residuals), as_plain(normals), np.ascontiguousarray(beside, dtype=np.int64)
    count = neighbour_differences(*columns, SAME_FACE_COS, apart, sums)
    together, alone = sums.tolist()
    return apart[:count], together, alone


@lru_cache(maxsize=4)
def _along_curve(count: int) -> IntArray:
    """Rows that stand so many places before each, (n, lags); below zero before the first. The same for every scan."""
    return np.asarray(np.arange(count)[:, None] - np.array(CURVE_LAGS), dtype=np.int64)
