"""Weights of correspondences between two clouds, lowered by their heights, their distances and their noise."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.selection import median_of, quantile_of


@compiled
def lower_by_height(
    moved: FloatArray, feet: FloatArray, normals: FloatArray, factor: float, smoothed: float, weights: FloatArray
) -> None:
    """Lower weights, (n,), by how far the points are off the planes through their feet, for most of them. O(n).

    Shapes: (n, 3). Half of a weight is left at a factor times the median height, to which a length is added in square.
    """
    heights, kept, count = np.zeros(len(weights)), np.zeros(len(weights)), 0
    for i in range(len(weights)):
        height = 0.0
        for k in range(3):
            height += (moved[i, k] - feet[i, k]) * normals[i, k]
        heights[i] = height
        if weights[i] > 0.0:
            kept[count] = abs(height)
            count += 1
    if count == 0:
        return
    usual = median_of(kept[:count])
    scale = factor * math.sqrt(usual * usual + smoothed * smoothed)
    if scale > 0.0:
        for i in range(len(weights)):
            ratio = heights[i] / scale
            weights[i] /= 1.0 + ratio * ratio


@compiled
def lower_by_distance(distances: FloatArray, flat: BoolArray, factor: float, weights: FloatArray) -> None:
    """Lower weights, (n,), by distances, (n,): half of one is left at a factor times their median. O(n).

    With the fourth power of the distance, and with its square where the plane was found flat far around, (n,) or (0,).
    """
    kept, count = np.zeros(len(weights)), 0
    for i in range(len(weights)):
        if weights[i] > 0.0:
            kept[count] = distances[i]
            count += 1
    scale = factor * median_of(kept[:count]) if count > 0 else 0.0
    if scale > 0.0:
        for i in range(len(weights)):
            ratio = distances[i] / scale
            square = ratio * ratio
            weights[i] /= 1.0 + (square if len(flat) and flat[i] else square * square)


@compiled
def lower_by_noise(standing: FloatArray, moving: FloatArray, least: float, share: float, weights: FloatArray) -> None:
    """Lower weights, (n,), to next to nothing where the variances of both normals, (n,) each, are large. O(n).

    Half of a weight is left where they come to the least, or to what a share of those that count is below, if more.
    """
    kept, count = np.zeros(len(weights)), 0
    for i in range(len(weights)):
        if weights[i] > 0.0:
            kept[count] = standing[i] + moving[i]
            count += 1
    if count == 0:
        return
    half = max(least, quantile_of(kept[:count], share))
    for i in range(len(weights)):
        ratio = (standing[i] + moving[i]) / half
        square = ratio * ratio
        fourth = square * square
        # Its eighth power: with half of that, errors at twice the noise were three times as large.
        weights[i] /= 1.0 + fourth * fourth
