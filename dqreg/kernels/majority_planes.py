"""Planes through three of some neighbours that most of these lie near: of one face, where there are two."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels


@compiled
def majority_plane_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    triples: IntArray,
    most: int,
    least: float,
    found: FloatArray,
) -> None:
    """Write how far so many of the k neighbours of rows first to last, (m, k), lie from a plane at most, (m,).

    The least over planes through triples, (t, 3), of them; NaN where each has less than a share of the mean square
    extent as its area. O(t k) a row.
    """
    count = neighbours.shape[1]
    local, nearest = np.zeros((count, 3)), np.zeros(most)
    for i in range(first, last):
        x, y, z = 0.0, 0.0, 0.0
        for j in range(count):
            t = neighbours[i, j]
            x, y, z = x + points[t, 0], y + points[t, 1], z + points[t, 2]
        x, y, z = x / count, y / count, z / count
        extent = 0.0
        for j in range(count):
            t = neighbours[i, j]
            local[j, 0], local[j, 1], local[j, 2] = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
            extent += local[j, 0] ** 2 + local[j, 1] ** 2 + local[j, 2] ** 2
        best = math.inf
        for k in range(len(triples)):
            best = min(best, _reach(local, triples[k], most, least * extent / count, best, nearest))
        found[i] = best if best < math.inf else math.nan


@inside_kernels
def _reach(local: FloatArray, triple: IntArray, most: int, least: float, best: float, nearest: FloatArray) -> float:
    """Distance from the plane of three points within which so many lie; infinite where that is not below the best."""
    p, q, r = triple[0], triple[1], triple[2]
    ax, ay, az = local[q, 0] - local[p, 0], local[q, 1] - local[p, 1], local[q, 2] - local[p, 2]
    bx, by, bz = local[r, 0] - local[p, 0], local[r, 1] - local[p, 1], local[r, 2] - local[p, 2]
    u, v, w = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    area = math.sqrt(u * u + v * v + w * w)
    if not area > least:
        return math.inf
    limit, held = best * area, 0
    for j in range(len(local)):
        if held + len(local) - j < most:
            return math.inf
        apart = abs(u * (local[j, 0] - local[p, 0]) + v * (local[j, 1] - local[p, 1]) + w * (local[j, 2] - local[p, 2]))
        if not apart < limit:
            continue
        # The nearest so many, in order.
        k = min(held, most - 1)
        if held == most and not apart < nearest[k]:
            continue
        while k > 0 and nearest[k - 1] > apart:
            nearest[k] = nearest[k - 1]
            k -= 1
        nearest[k] = apart
        held = min(held + 1, most)
    return nearest[most - 1] / area if held == most else math.inf
