"""Nearest points of a cloud followed from one place of the queries to another, and what stands at them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.nearest_points import nearest_points

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

    Where nothing is known of the queries, no candidates, (0, k), it is asked about all. The candidates from now on are
    of the tree, (n, k), where it was asked; no more than those before are nearer.
    """
    count, total, asked, waiting = found.shape[1], len(cloud), np.zeros(last - first, np.int64), first - first
    if len(candidates):
        follow_rows(first, last, points, before, candidates, others, cloud, shrink, rows, distances, bounds)
    for i in range(first, last):
        if len(candidates) and distances[i] < bounds[i]:
            for k in range(count):
                found[i, k] = candidates[i, k]
        else:
            asked[waiting] = i
            waiting += 1
    queries = np.zeros((waiting, 3))
    for j in range(waiting):
        for axis in range(3):
            queries[j, axis] = points[asked[j], axis]
    nearest, away = np.zeros((waiting, count), np.int64), np.zeros((waiting, count))
    begin, within, nowhere = first - first, np.inf, np.zeros(0, np.int64)  # a literal 0 would be a type of its own
    nearest_points(begin, waiting, boxes, places, leaf, rows_of_places, queries, within, nearest, away, nowhere)
    for j in range(waiting):
        i = asked[j]
        for k in range(count):
            found[i, k] = nearest[j, k]
        rows[i], distances[i] = nearest[j, 0], away[j, 0]
        bounds[i] = np.inf if count == total else away[j, count - 1]
    if len(feet):
        look_up_rows(first, last, rows, cloud, all_normals, all_variances, order, feet, normals, variances, elements)
