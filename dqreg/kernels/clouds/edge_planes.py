"""Planes that most neighbours of a point by an edge lie in with it, and which places have others on their face."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.clouds.plane_fits import ELEMENTS, diagonalise
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@compiled
def edge_plane_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    nearest: int,
    sine: float,
    within: float,
    rounds: int,
    fewest: int,
    normals: FloatArray,
    residuals: FloatArray,
    found: BoolArray,
) -> None:
    """Write normal and residual of the planes of rows first to last, (m, k), the point itself first; and which are any.

    Planes through the point and two of the nearest, in directions that far apart, are tried, and the best is fitted
    anew in some rounds to what lies within a distance of it. O(k) a row.
    """
    count = neighbours.shape[1]
    arms, held, a, v = np.zeros((count, 3)), np.zeros(count, np.bool_), np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        for j in range(count):
            for k in range(3):
                arms[j, k] = points[neighbours[i, j], k] - points[neighbours[i, 0], k]
        _hold_best_of_three(arms, min(nearest + 1, count), sine, within, held)
        for left in range(rounds - 1, -1, -1):
            x, y, z, kept = _fit_held(arms, held, a)
            diagonalise(a, v)
            least = 0
            for k in range(1, 3):
                if a[k] < a[least]:
                    least = k
            for j in range(count if left > 0 else 0):
                aside = (arms[j, 0] - x) * v[0, least] + (arms[j, 1] - y) * v[1, least] + (arms[j, 2] - z) * v[2, least]
                held[j] = abs(aside) <= within
        for k in range(3):
            normals[i, k] = v[k, least]
        residuals[i] = np.sqrt(max(a[least], 0.0) / max(kept - 3, 1))
        found[i] = kept >= fewest and held[0]


@inside_kernels
def _hold_best_of_three(arms: FloatArray, nearest: int, sine: float, within: float, held: BoolArray) -> None:
    """Write which arms, (k, 3), the best plane through their origin and two of the nearest holds; none for no plane."""
    best = np.inf
    held[:] = False
    for p in range(1, nearest):
        for q in range(p + 1, nearest):
            x = arms[p, 1] * arms[q, 2] - arms[p, 2] * arms[q, 1]
            y = arms[p, 2] * arms[q, 0] - arms[p, 0] * arms[q, 2]
            z = arms[p, 0] * arms[q, 1] - arms[p, 1] * arms[q, 0]
            area = np.sqrt(x * x + y * y + z * z)
            one = arms[p, 0] * arms[p, 0] + arms[p, 1] * arms[p, 1] + arms[p, 2] * arms[p, 2]
            two = arms[q, 0] * arms[q, 0] + arms[q, 1] * arms[q, 1] + arms[q, 2] * arms[q, 2]
            # Neighbours on a line are in many planes.
            if not area > sine * np.sqrt(one * two):
                continue
            x, y, z, cost = x / area, y / area, z / area, 0.0
            for j in range(len(arms)):
                aside = min(abs(x * arms[j, 0] + y * arms[j, 1] + z * arms[j, 2]), within)
                cost += aside * aside
                if cost >= best:
                    break
            if cost < best:
                best = cost
                for j in range(len(arms)):
                    held[j] = abs(x * arms[j, 0] + y * arms[j, 1] + z * arms[j, 2]) <= within


@inside_kernels
def _fit_held(arms: FloatArray, held: BoolArray, a: FloatArray) -> tuple[float, float, float, int]:
    """Write the scatter of the arms that are held about their mean; that, and how many they are."""
    x = y = z = 0.0
    kept = 0
    for j in range(len(arms)):
        if held[j]:
            x, y, z, kept = x + arms[j, 0], y + arms[j, 1], z + arms[j, 2], kept + 1
    x, y, z = x / max(kept, 1), y / max(kept, 1), z / max(kept, 1)
    a[:] = 0.0
    for j in range(len(arms)):
        if held[j]:
            u, v, w = arms[j, 0] - x, arms[j, 1] - y, arms[j, 2] - z
            a[0], a[1], a[2] = a[0] + u * u, a[1] + v * v, a[2] + w * w
            a[3], a[4], a[5] = a[3] + u * v, a[4] + u * w, a[5] + v * w
    return x, y, z, kept


@compiled
def with_others_rows(
    first: int,
    last: int,
    asked: IntArray,
    points: FloatArray,
    normals: FloatArray,
    within: float,
    slope: float,
    cosine: float,
    fewest: int,
    found: BoolArray,
) -> None:
    """Write which of the rows asked, (m,), have more than so many others on their plane, themselves among them.

    Those are as far from it as a distance and a slope allow, and their normals, up to sign, as near to its own. O(n) a
    row at most. Shapes: points, normals (n, 3).
    """
    for i in range(first, last):
        row, count = asked[i], 0
        for j in range(len(points)):
            x, y, z = points[j, 0] - points[row, 0], points[j, 1] - points[row, 1], points[j, 2] - points[row, 2]
            aside = abs(x * normals[row, 0] + y * normals[row, 1] + z * normals[row, 2])
            if aside >= within + slope * np.sqrt(x * x + y * y + z * z):
                continue
            alike = normals[j, 0] * normals[row, 0] + normals[j, 1] * normals[row, 1] + normals[j, 2] * normals[row, 2]
            count += abs(alike) > cosine
            if count > fewest:
                break
        found[i] = count > fewest
