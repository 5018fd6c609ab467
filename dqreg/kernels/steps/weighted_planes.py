"""Weighted point-to-plane correspondences: the sums of their cost."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.steps.newton_steps import symmetric_axes
from dqreg.kernels.steps.pose_forms import SUMS, add_pair

# Columns of the sums: those of `form_of_sums`, and after them the sums of weights, of points and of their feet, and the
# count.
COLUMNS = SUMS + 8
# A triangle of products of six motions and a height, and the count.
STEP = 29
# Columns of the sums over pairs: their weights, and with these the points and the feet, three each,
WEIGHT_COLUMN = 0
POINT_COLUMN, FOOT_COLUMN = 1, 4
# squared heights over the planes and squared distances; the pairs with a plane, and how many columns there are.
SQ_HEIGHT_COLUMN, SQ_DISTANCE_COLUMN = 7, 8
PLANE_PAIR_COLUMN, PAIR_COLUMNS = 9, 10


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
    """Add the point-to-plane cost of one chunk of correspondences, (81,), see `form_of_sums`. O(n).

    Points count from the first of the origins, (2, 3), feet from the second. A correspondence without
    weight or without a normal does not count.
    """
    total = sums[first // chunk]
    for i in range(first, last):
        w, nx, ny, nz = weights[i], normals[i, 0], normals[i, 1], normals[i, 2]
        if not w > 0.0 or (nx == 0.0 and ny == 0.0 and nz == 0.0):
            continue
        p, q, r = points[i, 0] - origins[0, 0], points[i, 1] - origins[0, 1], points[i, 2] - origins[0, 2]
        x, y, z = feet[i, 0] - origins[1, 0], feet[i, 1] - origins[1, 1], feet[i, 2] - origins[1, 2]
        xx, yy, zz, xy, xz, yz = w * nx * nx, w * ny * ny, w * nz * nz, w * nx * ny, w * nx * nz, w * ny * nz
        height = nx * x + ny * y + nz * z
        sides = w * height * nx, w * height * ny, w * height * nz
        at = add_pair((p, q, r), (xx, yy, zz, xy, xz, yz), sides, total)
        total[at] += w * height * height
        for value in (w, w * p, w * q, w * r, w * x, w * y, w * z, 1.0):
            at += 1
            total[at] += value


@compiled
def step_sums(
    first: int,
    last: int,
    moved: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    origin: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the normal equations of a short motion about an origin, (3,), from one chunk, (28,) and the count. O(n).

    Rows ``J = [(x - o) x n, n]`` of points x that stand a height over their planes: a triangle of products of J with
    itself, J times the height, and its square. What does not count for `plane_sums` does not here.
    """
    total, found = sums[first // chunk], np.zeros(STEP)
    for i in range(first, last):
        w, u, v, s = weights[i], normals[i, 0], normals[i, 1], normals[i, 2]
        if not w > 0.0 or (u == 0.0 and v == 0.0 and s == 0.0):
            continue
        x, y, z = moved[i, 0] - origin[0], moved[i, 1] - origin[1], moved[i, 2] - origin[2]
        h = u * (moved[i, 0] - feet[i, 0]) + v * (moved[i, 1] - feet[i, 1]) + s * (moved[i, 2] - feet[i, 2])
        a, b, c = y * s - z * v, z * u - x * s, x * v - y * u
        # Written out: in loops it takes half as long again.
        t = w * a
        found[0] += t * a
        found[1] += t * b
        found[2] += t * c
        found[3] += t * u
        found[4] += t * v
        found[5] += t * s
        found[6] += t * h
        t = w * b
        found[7] += t * b
        found[8] += t * c
        found[9] += t * u
        found[10] += t * v
        found[11] += t * s
        found[12] += t * h
        t = w * c
        found[13] += t * c
        found[14] += t * u
        found[15] += t * v
        found[16] += t * s
        found[17] += t * h
        t = w * u
        found[18] += t * u
        found[19] += t * v
        found[20] += t * s
        found[21] += t * h
        t = w * v
        found[22] += t * v
        found[23] += t * s
        found[24] += t * h
        t = w * s
        found[25] += t * s
        found[26] += t * h
        t = w * h
        found[27] += t * h
        found[28] += 1.0
    for k in range(STEP):
        total[k] += found[k]


@compiled
def short_twist(sums: FloatArray, flat: float, step: FloatArray) -> float:
    """Write the short motion about the origin, (6,), of least cost by `step_sums`, (k, 29); returns the cost there.

    NaN where the motion that is held the least is so by less than a share of the most. Rotations and translations are
    brought to one unit first.
    """
    a, slope, axes = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
    at, square = 0, 0.0
    for k in range(7):
        for m in range(k, 7):
            value = 0.0
            for c in range(len(sums)):
                value += sums[c, at]
            at += 1
            if m < 6:
                a[k, m] = a[m, k] = value
            elif k < 6:
                slope[k] = value
            else:
                square = value
    turned, shifted = a[0, 0] + a[1, 1] + a[2, 2], a[3, 3] + a[4, 4] + a[5, 5]
    unit = np.sqrt(shifted / turned) if turned > 0.0 and shifted > 0.0 else 1.0
    for k in range(6):
        for m in range(6):
            a[k, m] *= (unit if k < 3 else 1.0) * (unit if m < 3 else 1.0)
    symmetric_axes(a, axes)
    least, most = np.inf, 0.0
    for k in range(6):
        least, most = min(least, a[k, k]), max(most, a[k, k])
    if not least > flat * most:
        return np.nan
    for i in range(6):
        step[i] = 0.0
    for k in range(6):
        pull = 0.0
        for i in range(6):
            pull += axes[i, k] * slope[i] * (unit if i < 3 else 1.0)
        for i in range(6):
            step[i] -= axes[i, k] * pull / a[k, k]
    for i in range(6):
        step[i] *= unit if i < 3 else 1.0
        square += slope[i] * step[i]
    return square


@compiled
def pair_moments(
    first: int,
    last: int,
    points: FloatArray,
    T: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    scatter: FloatArray,
    weights: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add what one chunk of correspondences at a pose comes to, (10,). O(n).

    Their squared distances are those of the points that each row is the mean of, which scatter about it, (n,) or (0,).
    """
    total = sums[first // chunk]
    for i in range(first, last):
        w, height, directed = weights[i], 0.0, False
        if not w > 0.0:
            continue
        for k in range(3):
            moved = T[k, 0] * points[i, 0] + T[k, 1] * points[i, 1] + T[k, 2] * points[i, 2] + T[k, 3]
            height += (moved - feet[i, k]) * normals[i, k]
            directed = directed or normals[i, k] != 0.0
            total[POINT_COLUMN + k] += w * points[i, k]
            total[FOOT_COLUMN + k] += w * feet[i, k]
        total[WEIGHT_COLUMN] += w
        total[SQ_HEIGHT_COLUMN] += w * height * height
        total[SQ_DISTANCE_COLUMN] += w * (distances[i] * distances[i] + (scatter[i] if len(scatter) else 0.0))
        total[PLANE_PAIR_COLUMN] += 1.0 if directed else 0.0
