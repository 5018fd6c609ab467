"""Sums of a least-squares fit over patches of neighbouring rows."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled

# Columns after the scores: weight, and weighted points, normals and residuals.
BESIDE = 8


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
def joined_sums(places: IntArray, sums: FloatArray, first: int, last: int, found: FloatArray) -> None:
    """Add columns first to last of the sums of patches, (g, k), those of a larger one from its place to the next.

    O(g k). Shapes: places (m,), ascending, found (m, last - first), zeros.
    """
    for m in range(len(places)):
        end = places[m + 1] if m + 1 < len(places) else len(sums)
        for g in range(places[m], end):
            for k in range(last - first):
                found[m, k] += sums[g, first + k]
