"""Many poses at once: their gains on a grid, those that differ, and likelihoods of distances under them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def mean_gains(
    first: int,
    last: int,
    rotations: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    shape: IntArray,
    gains: NDArray[np.float32],
    means: FloatArray,
) -> None:
    """Write the mean gain of all points under poses first to last; the last gain is that outside of the grid.

    Rotations and shifts lead to cells, half a cell further, so that cutting off rounds. O(1) a point and pose.
    """
    a, b, c = float(shape[0]), float(shape[1]), float(shape[2])
    rows, columns, outside = shape[1], shape[2], len(gains) - 1
    for k in range(first, last):
        r, t, total = rotations[k], shifts[k], 0.0
        for i in range(len(points)):
            p, q, s = points[i, 0], points[i, 1], points[i, 2]
            x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + t[0]
            y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + t[1]
            z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + t[2]
            node = outside
            if x >= 0.0 and y >= 0.0 and z >= 0.0 and x < a and y < b and z < c:
                node = (np.int64(x) * rows + np.int64(y)) * columns + np.int64(z)
            total += gains[node]
        means[k] = total / len(points)


@compiled
def distinct_rows(rotations: FloatArray, places: FloatArray, chord: float, offset: float, most: int) -> IntArray:
    """Rows of the first poses that differ from all kept before them, in rotation or place; so many at most. O(n most).

    Two differ where the Frobenius norm between their rotations is ``chord`` or more, or their places are ``offset``
    apart or more.
    """
    n, count = len(rotations), 0
    kept, gone = np.zeros(max(min(most, n), 0), np.int64), np.zeros(n, np.bool_)
    for k in range(n):
        if gone[k]:
            continue
        if count == len(kept):
            break
        kept[count] = k
        count += 1
        for j in range(k + 1, n):
            apart, turned = 0.0, 0.0
            for i in range(3):
                apart += (places[j, i] - places[k, i]) ** 2
            if gone[j] or apart >= offset * offset:
                continue
            for i in range(3):
                for m in range(3):
                    turned += (rotations[j, i, m] - rotations[k, i, m]) ** 2
            gone[j] = turned < chord * chord
    return kept[:count]


@compiled
def log_likelihoods(
    first: int, last: int, inliers: FloatArray, outlier: float, fraction: float, least: float, rounds: int
) -> None:
    """Turn densities of inliers, (n, m), into log-likelihoods of rows first to last.

    The fraction of inliers of each row comes from so many EM rounds, within ``least`` of none and of all; what a round
    leaves as it was stays. O(m rounds).
    """
    m = inliers.shape[1]
    for k in range(first, last):
        row, share = inliers[k], fraction
        for _ in range(rounds):
            total = 0.0
            for i in range(m):
                total += share * row[i] / (share * row[i] + (1.0 - share) * outlier)
            before = share
            share = min(max(total / m, least), 1.0 - least)
            if share == before:
                break
        for i in range(m):
            row[i] = np.log(share * row[i] + (1.0 - share) * outlier)


@compiled
def poses_within(
    first: int,
    last: int,
    rotations: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    shape: IntArray,
    distances: NDArray[np.float32],
    limit: float,
    within: NDArray[np.bool_],
) -> None:
    """Write whether all points lie nearer than a limit under poses first to last, by the distance of the nearest node.

    Rotations and shifts lead to cells, half a cell further. Outside of the grid nothing is near. O(1) a point and pose.
    """
    for k in range(first, last):
        r, t, i, near = rotations[k], shifts[k], 0, True
        while near and i < len(points):
            p, q, s = points[i, 0], points[i, 1], points[i, 2]
            x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + t[0]
            y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + t[1]
            z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + t[2]
            near = x >= 0.0 and y >= 0.0 and z >= 0.0 and x < shape[0] and y < shape[1] and z < shape[2]
            if near:
                near = distances[(np.int64(x) * shape[1] + np.int64(y)) * shape[2] + np.int64(z)] < limit
            i += 1
        within[k] = near
