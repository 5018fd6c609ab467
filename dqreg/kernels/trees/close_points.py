"""The nearest point of a tree to points that move a little at a time, and what their planes say of each match."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.closest_triangles import DEEPEST, box_distance

# Points are looked for so much farther off than asked, so that small motions ask for no second look.
FARTHER = 1.5


@compiled
def close_points(
    first: int,
    last: int,
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    rows: IntArray,
    targets: FloatArray,
    points: FloatArray,
    motion: FloatArray,
    moved: float,
    reach: float,
    found: IntArray,
    others: FloatArray,
) -> None:
    """Write the row of the nearest target within reach of each point in motion, (3, 4), -1 without one. O(log n) each.

    ``found`` and ``others`` keep the answer of the call before, since which no point has moved by more than ``moved``:
    all targets but the one found are farther off than ``others``. A match that still is nearer is the match still.
    """
    n, half = len(places), len(boxes) // 2
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    for i in range(first, last):
        p, q, s = points[i, 0], points[i, 1], points[i, 2]
        x = motion[0, 0] * p + motion[0, 1] * q + motion[0, 2] * s + motion[0, 3]
        y = motion[1, 0] * p + motion[1, 1] * q + motion[1, 2] * s + motion[1, 3]
        z = motion[2, 0] * p + motion[2, 1] * q + motion[2, 2] * s + motion[2, 3]
        slack, old = others[i] - moved, found[i]
        bound = FARTHER * reach
        if old >= 0:
            dx, dy, dz = targets[old, 0] - x, targets[old, 1] - y, targets[old, 2] - z
            if np.sqrt(dx * dx + dy * dy + dz * dz) < slack:
                others[i] = slack
                continue
        elif slack > reach:
            others[i] = slack
            continue
        # The two nearest within the bound; of equally near ones those with the lower rows.
        best, second = bound * bound, bound * bound
        row = n
        node, waiting = 1, 0
        while True:
            if node >= half:
                for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                    dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
                    d = dx * dx + dy * dy + dz * dz
                    if d < best or (d == best and rows[t] < row):
                        second, best, row = best, d, rows[t]
                    elif d < second:
                        second = d
            else:
                near, far = 2 * node, 2 * node + 1
                d0, d1 = box_distance(boxes, near, x, y, z), box_distance(boxes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                if d0 <= second:
                    if d1 <= second:
                        stack[waiting], away[waiting] = far, d1
                        waiting += 1
                    node = near
                    continue
            while waiting > 0 and away[waiting - 1] > second:
                waiting -= 1
            if waiting == 0:
                break
            waiting -= 1
            node = stack[waiting]
        found[i] = row if row < n else -1
        others[i] = np.sqrt(second)


@compiled
def facing_matches(
    points: FloatArray,
    normals: FloatArray,
    motion: FloatArray,
    found: IntArray,
    targets: FloatArray,
    target_normals: FloatArray,
    barred: BoolArray,
    reach: float,
    least: float,
    signed: bool,
    kept: IntArray,
    distances: FloatArray,
    aside: FloatArray,
) -> int:
    """Write the rows of the points whose match counts, how far off it is, and how far off its plane; how many. O(n).

    Matches within reach whose normals agree to a cosine of at least ``least``, and that are not barred.
    """
    count = 0
    for i in range(len(points)):
        row = found[i]
        if row < 0 or barred[row]:
            continue
        cosine, square, along = 0.0, 0.0, 0.0
        for k in range(3):
            turned, place = 0.0, motion[k, 3]
            for j in range(3):
                turned += motion[k, j] * normals[i, j]
                place += motion[k, j] * points[i, j]
            gap = place - targets[row, k]
            cosine += turned * target_normals[row, k]
            square += gap * gap
            along += gap * target_normals[row, k]
        if square <= reach * reach and (cosine if signed else abs(cosine)) >= least:
            kept[count], distances[count], aside[count] = i, np.sqrt(square), along
            count += 1
    return count
