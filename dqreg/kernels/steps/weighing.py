"""Correspondences at another pose; their rejectors, weights and energy under the mixture, in one pass."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled

# Sums of a chunk: points represented, energy over ``-2 scale^2``, weights, weighted squares, rows with a weight.
SUMS = 5
# Densities that are multiplied before their logarithm is taken.
TOGETHER = 8


@compiled
def weigh_rows(
    first: int,
    last: int,
    distances: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    R: FloatArray,
    counts: FloatArray,
    scatter: FloatArray,
    kept: FloatArray,
    limits: FloatArray,
    chunk: int,
    weights: FloatArray,
    sums: FloatArray,
) -> None:
    """Write the weights of correspondences first to last, (n,), and add to the sums of their chunk, (k, 5). O(n).

    A row beyond the largest distance, or whose normals differ by too much, has no weight, and costs as much as one at
    that distance; without a normal on either side it passes. Counts, scatter and further factors are of each row, or
    none at all. Limits: largest distance, least cosine of the normals, whether their signs count, scale, odds.
    """
    farthest, cosine, signed, scale, odds = limits[0], limits[1], limits[2] != 0.0, limits[3], limits[4]
    total, squares, energy, represented, used = 0.0, 0.0, 0.0, 0.0, 0.0
    beyond, product, waiting = math.log(math.exp(-0.5 * (farthest / scale) ** 2) + odds), 1.0, 0
    for i in range(first, last):
        d, count = distances[i], counts[i] if len(counts) else 1.0
        represented += count
        passes = d <= farthest and (len(kept) == 0 or kept[i] > 0.0)
        if passes and (own[i, 0] != 0.0 or own[i, 1] != 0.0 or own[i, 2] != 0.0):
            across = 0.0
            for k in range(3):
                turned = R[k, 0] * own[i, 0] + R[k, 1] * own[i, 1] + R[k, 2] * own[i, 2]
                across += normals[i, k] * turned
            known = normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0
            passes = not known or (across if signed else abs(across)) >= cosine
        weights[i] = 0.0
        if not passes:
            energy += count * beyond
            continue
        ratio = d / scale
        density = math.exp(-0.5 * ratio * ratio)
        w = density / (density + odds) * (kept[i] if len(kept) else 1.0)
        if len(counts):
            energy += count * math.log(density + odds)
        else:
            product *= density + odds
            waiting += 1
            if waiting == TOGETHER:
                energy += math.log(product)
                product, waiting = 1.0, 0
        w *= count
        weights[i] = w
        total += w
        squares += w * (d * d + (scatter[i] if len(scatter) else 0.0))
        used += 1.0 if w > 0.0 else 0.0
    c = first // chunk
    sums[c, 0] += represented
    sums[c, 1] += energy + (math.log(product) if waiting else 0.0)
    sums[c, 2] += total
    sums[c, 3] += squares
    sums[c, 4] += used


@compiled
def move_rows(first: int, last: int, points: FloatArray, T: FloatArray, moved: FloatArray) -> None:
    """Write points first to last at a pose, (n, 3). O(n). Shapes: T (4, 4)."""
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            moved[i, k] = T[k, 0] * x + T[k, 1] * y + T[k, 2] * z + T[k, 3]


@compiled
def slide_rows(
    first: int,
    last: int,
    points: FloatArray,
    T: FloatArray,
    before: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    chosen: IntArray,
    moved: FloatArray,
    slid: FloatArray,
    distances: FloatArray,
) -> None:
    """Write the points at a pose, their feet slid along the tangent planes, (m, 3), and their distances, (m,). O(m).

    Of chosen rows, (m,), or of all, (0,). Shapes: T (4, 4); before (n, 3), the points where the feet were found; the
    first two (0, 3) where they are not asked for.
    """
    place, foot = np.zeros(3), np.zeros(3)
    for j in range(first, last):
        i, across, square = chosen[j] if len(chosen) else j, 0.0, 0.0
        for k in range(3):
            place[k] = T[k, 0] * points[i, 0] + T[k, 1] * points[i, 1] + T[k, 2] * points[i, 2] + T[k, 3]
            across += (place[k] - before[i, k]) * normals[i, k]
        for k in range(3):
            foot[k] = feet[i, k] + (place[k] - before[i, k]) - across * normals[i, k]
            gap = place[k] - foot[k]
            square += gap * gap
        for k in range(3 if len(moved) else 0):
            moved[j, k], slid[j, k] = place[k], foot[k]
        distances[j] = math.sqrt(square)


@compiled
def place_rows(
    first: int,
    last: int,
    points: FloatArray,
    T: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    moved: FloatArray,
    heights: FloatArray,
) -> None:
    """Write the points at a pose, (n, 3), and their heights over the planes through feet held fixed, (n,). O(n)."""
    for i in range(first, last):
        height = 0.0
        for k in range(3):
            moved[i, k] = T[k, 0] * points[i, 0] + T[k, 1] * points[i, 1] + T[k, 2] * points[i, 2] + T[k, 3]
            height += (moved[i, k] - feet[i, k]) * normals[i, k]
        heights[i] = height
