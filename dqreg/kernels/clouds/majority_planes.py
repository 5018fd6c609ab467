"""Planes through three of some neighbours that most of these lie near: of one face, where there are two."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@compiled
def majority_plane_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    normals: FloatArray,
    triples: IntArray,
    most: int,
    least: float,
    upright: float,
    found: FloatArray,
) -> None:
    """Write how far so many of the k neighbours of rows first to last, (m, k), lie from a plane at most, (m,).

    The least over planes through triples, (t, 3), of them; NaN where each has less than a share of the mean square
    extent as its area, or a normal whose cosine with the row's, (m, 3), is below a limit. O(t k) a row.
    """
    count = neighbours.shape[1]
    local, apart, nearest = np.zeros((3, count)), np.zeros(count), np.zeros(most)
    for i in range(first, last):
        x, y, z = 0.0, 0.0, 0.0
        for j in range(count):
            t = neighbours[i, j]
            x, y, z = x + points[t, 0], y + points[t, 1], z + points[t, 2]
        x, y, z = x / count, y / count, z / count
        extent = 0.0
        for j in range(count):
            t = neighbours[i, j]
            local[0, j], local[1, j], local[2, j] = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
            extent += local[0, j] ** 2 + local[1, j] ** 2 + local[2, j] ** 2
        best = math.inf
        for k in range(len(triples)):
            best = min(
                best, _reach(local, triples[k], least * extent / count, normals[i], upright, best, apart, nearest)
            )
        found[i] = best if best < math.inf else math.nan


@inside_kernels
def _reach(
    local: FloatArray,
    triple: IntArray,
    least: float,
    normal: FloatArray,
    upright: float,
    best: float,
    apart: FloatArray,
    nearest: FloatArray,
) -> float:
    """Distance from the plane of three points within which so many lie; infinite where that is not below the best."""
    p, q, r = triple[0], triple[1], triple[2]
    x, y, z, most = local[0, p], local[1, p], local[2, p], len(nearest)
    ax, ay, az = local[0, q] - x, local[1, q] - y, local[2, q] - z
    bx, by, bz = local[0, r] - x, local[1, r] - y, local[2, r] - z
    u, v, w = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    area = math.sqrt(u * u + v * v + w * w)
    if not area > least or abs(u * normal[0] + v * normal[1] + w * normal[2]) < upright * area:
        return math.inf
    # Side by side, and without a question in between: few planes are better than the best.
    limit, within, held = best * area, 0, 0
    for j in range(len(apart)):
        apart[j] = abs(u * (local[0, j] - x) + v * (local[1, j] - y) + w * (local[2, j] - z))
        within += 1 if apart[j] < limit else 0
    if within < most:
        return math.inf
    for j in range(len(apart)):
        if not apart[j] < limit:
            continue
        # The nearest so many, in order.
        k = min(held, most - 1)
        if held == most and not apart[j] < nearest[k]:
            continue
        while k > 0 and nearest[k - 1] > apart[j]:
            nearest[k] = nearest[k - 1]
            k -= 1
        nearest[k] = apart[j]
        held = min(held + 1, most)
    reach: float = nearest[most - 1] / area
    return reach
