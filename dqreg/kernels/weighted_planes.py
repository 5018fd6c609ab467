"""Weighted point-to-plane correspondences: the sums of their cost, and the scatter of each orientation."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled

# Numbers of a pose, (vec R, t, 1), and columns of the sums of weights, of points and of their feet, and the count.
NUMBERS, COLUMNS = 13, 8


@compiled
def mean_sums(
    first: int,
    last: int,
    points: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Write the sums of weights, points, feet and rows that count, (8,), of one chunk of correspondences. O(n).

    A correspondence without weight or without a normal does not count.
    """
    c = first // chunk
    for i in range(first, last):
        w = weights[i]
        if w > 0.0 and (normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0):
            sums[c, 0] += w
            sums[c, 7] += 1.0
            for k in range(3):
                sums[c, 1 + k] += w * points[i, k]
                sums[c, 4 + k] += w * feet[i, k]


@compiled
def plane_sums(
    first: int,
    last: int,
    points: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    origins: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the cost of one chunk as a quadratic form of the numbers of a pose, its upper half, (13, 13). O(n).

    Points count from the first of the origins, (2, 3), feet from the second.
    """
    form, row = sums[first // chunk], np.zeros(NUMBERS)
    for i in range(first, last):
        w = weights[i]
        if not w > 0.0:
            continue
        row[12] = 0.0
        for k in range(3):
            n = normals[i, k]
            row[9 + k] = n
            row[12] += n * (origins[1, k] - feet[i, k])
            for j in range(3):
                row[3 * k + j] = n * (points[i, j] - origins[0, j])
        for a in range(NUMBERS):
            weighted = w * row[a]
            for b in range(a, NUMBERS):
                form[a, b] += weighted * row[b]


@compiled
def cell_of(normals: FloatArray, i: int, cells: int) -> np.int64:
    """Cell of a unit normal in the cube around it, so many along each axis and one more."""
    cell = np.int64(0)
    for k in range(3):
        place = (normals[i, k] + 1.0) * (0.5 * cells) + 0.5
        # Rounding may leave the cube, and what is no number has no cell of its own.
        cell = cell * (cells + 1) + (np.int64(place) if 0.0 < place < cells + 1.0 else np.int64(0))
    return cell


@compiled
def orientation_precisions(
    normals: FloatArray,
    squares: FloatArray,
    weights: FloatArray,
    cells: int,
    beforehand: float,
    least: float,
    bins: FloatArray,
    precisions: FloatArray,
) -> None:
    """Write one over the variance of all rows with the same normal, (n,); the weighted mean is one. O(n).

    Squares are the residuals', (n,); ``beforehand`` is the weight of the usual variance in each cell of normals, and
    ``least`` the least variance, in usual ones. Rows without weight get one. Shapes: bins (2, m), zeros.
    """
    total, weight, scale = 0.0, 0.0, 0.0
    for i in range(len(weights)):
        if weights[i] > 0.0:
            mine = cell_of(normals, i, cells)
            bins[0, mine] += weights[i] * squares[i]
            bins[1, mine] += weights[i]
    for cell in range(bins.shape[1]):
        total, weight = total + bins[0, cell], weight + bins[1, cell]
    usual = total / weight if weight > 0.0 else 0.0
    for cell in range(bins.shape[1]):
        held = bins[1, cell]
        if held > 0.0 and usual > 0.0:
            variance = (bins[0, cell] + beforehand * usual) / (held + beforehand)
            bins[0, cell] = 1.0 / max(variance, least * usual)
            scale += held * bins[0, cell]
    for i in range(len(weights)):
        precisions[i] = 1.0
        if weights[i] > 0.0 and scale > 0.0:
            precisions[i] = bins[0, cell_of(normals, i, cells)] * (weight / scale)
