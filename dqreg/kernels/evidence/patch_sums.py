"""Sums of a least-squares fit over patches of neighbouring rows."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled

# Columns after the scores: weight, and weighted points, normals and residuals.
BESIDE = 8
# The least weight to divide by.
TINY = float(np.finfo(np.float64).tiny)


@compiled
def patch_sums(
    first: int,
    last: int,
    rows: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    starts: IntArray,
    sums: FloatArray,
) -> None:
    """Add what patches first to last hold: scores ``w J r``, then weights, points, normals and residuals. O(n k).

    Patches reach from their start to the next. Shapes: rows (k, n), points and normals (n, 3), sums (m, k + 8), zeros.
    """
    many = len(rows)
    for g in range(first, last):
        end = starts[g + 1] if g + 1 < len(starts) else len(weights)
        for i in range(starts[g], end):
            w = weights[i]
            pull = w * residuals[i]
            for k in range(many):
                sums[g, k] += rows[k, i] * pull
            sums[g, many] += w
            sums[g, many + 7] += pull
            for k in range(3):
                sums[g, many + 1 + k] += w * points[i, k]
                sums[g, many + 4 + k] += w * normals[i, k]


@compiled
def joined_sums(places: IntArray, sums: FloatArray, columns: IntArray, found: FloatArray) -> None:
    """Add some columns of the sums of patches, (g, k), those of a larger one from its place to the next.

    O(g c). Shapes: places (m,), ascending, columns (c,), found (m, c), zeros.
    """
    for m in range(len(places)):
        end = places[m + 1] if m + 1 < len(places) else len(sums)
        for g in range(places[m], end):
            for k in range(len(columns)):
                found[m, k] += sums[g, columns[k]]


@compiled
def patch_means(
    sums: FloatArray,
    lightest: float,
    steps: int,
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
) -> tuple[float, float]:
    """Write means over patches; their mean square residual, and how patches up to some steps apart agree. O(m steps).

    Of a patch of less than the lightest share of the heaviest weight, normal and residual are zero. They agree by the
    sum of the products of both residuals with the cosine of their normals, in standard errors of independent noise.
    Shapes: sums (m, BESIDE), points and normals (m, 3), residuals and weights (m,).
    """
    count, heaviest, square, many = len(sums), 0.0, 0.0, 0
    for g in range(count):
        weights[g] = max(sums[g, 0], TINY)
        heaviest = max(heaviest, weights[g])
    for g in range(count):
        total, is_light = weights[g], weights[g] < lightest * heaviest
        for k in range(3):
            points[g, k] = sums[g, 1 + k] / total
            normals[g, k] = 0.0 if is_light else sums[g, 4 + k] / total
        residuals[g] = 0.0 if is_light else sums[g, 7] / total
        square += residuals[g] * residuals[g]
        many += 0 if is_light else 1
    variance, agreement, alike = square / many, 0.0, 0.0
    for g in range(count):
        for other in range(max(g - steps, 0), g):
            same = normals[g, 0] * normals[other, 0] + normals[g, 1] * normals[other, 1]
            same += normals[g, 2] * normals[other, 2]
            agreement += residuals[g] * residuals[other] * same
            alike += same * same
    scale = variance * np.sqrt(alike)
    return variance, agreement / scale if scale > 0.0 else 0.0
