"""Nearest points of a cloud followed from one place of the queries to another, and what stands at them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.nearest_points import WIDER, nearest_points

Candidates = NDArray[np.int32]


@compiled
def follow_rows(
    first: int,
    last: int,
    points: FloatArray,
    before: FloatArray,
    candidates: Candidates,
    others: FloatArray,
    cloud: FloatArray,
    shrink: float,
    rows: IntArray,
    distances: FloatArray,
    bounds: FloatArray,
) -> None:
    """Write the nearest candidate of queries first to last, how far it is, and what all other points are beyond. O(k).

    From where they were before, (n, 3), when no point but the candidates, (n, k) rows of the cloud, was nearer than the
    others, (n,). Bounds are shrunk by a factor, and zero where two candidates are as near but for that.
    """
    for i in range(first, last):
        nearest, second, row, way = np.inf, np.inf, candidates[i, 0], 0.0
        for k in range(candidates.shape[1]):
            t, square = candidates[i, k], 0.0
            for axis in range(3):
                gap = points[i, axis] - cloud[t, axis]
                square += gap * gap
            if square < nearest:
                nearest, second, row = square, nearest, t
            elif square < second:
                second = square
        for axis in range(3):
            step = points[i, axis] - before[i, axis]
            way += step * step
        rows[i], distances[i] = row, math.sqrt(nearest)
        is_clear = second * shrink > nearest or len(candidates[i]) == 1
        bounds[i] = (others[i] - math.sqrt(way)) * shrink if is_clear else 0.0


@compiled
def look_up_rows(
    first: int,
    last: int,
    rows: IntArray,
    cloud: FloatArray,
    all_normals: FloatArray,
    all_variances: FloatArray,
    order: IntArray,
    points: FloatArray,
    normals: FloatArray,
    variances: FloatArray,
    elements: IntArray,
) -> None:
    """Write what stands at rows first to last of a cloud: points, normals, their variances, numbers. O(n)."""
    for i in range(first, last):
        row = rows[i]
        for k in range(3):
            points[i, k], normals[i, k] = cloud[row, k], all_normals[row, k]
        variances[i], elements[i] = all_variances[row], order[row]


@compiled
def follow_in_tree(
    first: int,
    last: int,
    points: FloatArray,
    before: FloatArray,
    candidates: Candidates,
    others: FloatArray,
    shrink: float,
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    rows_of_places: IntArray,
    cloud: FloatArray,
    all_normals: FloatArray,
    all_variances: FloatArray,
    order: IntArray,
    rows: IntArray,
    distances: FloatArray,
    bounds: FloatArray,
    found: Candidates,
    feet: FloatArray,
    normals: FloatArray,
    variances: FloatArray,
    elements: IntArray,
) -> None:
    """The same, asking the tree of the cloud where a candidate may not be the nearest, and what stands there. O(k).

    The candidates from now on, (n, k), are of the tree where it was asked; no more than those before are nearer.
    """
    follow_rows(first, last, points, before, candidates, others, cloud, shrink, rows, distances, bounds)
    count, total = candidates.shape[1], len(cloud)
    nearest, away, nowhere = np.zeros((1, count), np.int64), np.zeros((1, count)), np.zeros(0, np.int64)
    for i in range(first, last):
        if distances[i] < bounds[i]:
            for k in range(count):
                found[i, k] = candidates[i, k]
            continue
        farthest, begin = 0.0, i - i  # a literal 0 would be a type of its own
        for k in range(count):
            square = 0.0
            for axis in range(3):
                gap = points[i, axis] - cloud[candidates[i, k], axis]
                square += gap * gap
            farthest = max(farthest, square)
        tree = boxes, places, leaf, rows_of_places
        within = math.sqrt(farthest) * WIDER * WIDER
        nearest_points(begin, begin + 1, *tree, points[i : i + 1], within, nearest, away, nowhere)
        for k in range(count):
            found[i, k] = nearest[0, k]
        rows[i], distances[i] = nearest[0, 0], away[0, 0]
        bounds[i] = np.inf if count == total else away[0, count - 1]
    if len(feet):
        look_up_rows(first, last, rows, cloud, all_normals, all_variances, order, feet, normals, variances, elements)
