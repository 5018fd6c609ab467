"""The nearest points of a tree of points, closest first; of equally near ones those with the lower rows."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.trees.closest_triangles import DEEPEST, FIRST_BOX_DISTANCES, box_distance

# What stands between brackets counts from the end where it is below zero, which each access asks of a signed number.
U = np.uint64
# A bound from the query before is rounded up, so that nothing within it is lost.
WIDER = 1.0 + 1e-12


@inside_kernels
def leaf_above(boxes: FloatArray, places: FloatArray, leaf: int, t: int, x: float, y: float, z: float) -> int:
    """Node that holds place t, or the first above it that is long enough, see `FIRST_BOX_DISTANCES`. O(log n)."""
    node = len(boxes) // 2 + t // leaf
    dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
    square = FIRST_BOX_DISTANCES * FIRST_BOX_DISTANCES * (dx * dx + dy * dy + dz * dz)
    while node > 1:
        dx, dy, dz = boxes[node, 3] - boxes[node, 0], boxes[node, 4] - boxes[node, 1], boxes[node, 5] - boxes[node, 2]
        if dx * dx + dy * dy + dz * dz >= square:
            break
        node = node >> 1
    return node


@compiled
def nearest_points(
    first: int,
    last: int,
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    rows: IntArray,
    queries: FloatArray,
    within: float,
    found: IntArray,
    distances: FloatArray,
    at: IntArray,
) -> None:
    """Write the rows of the k nearest points, and how far they are, for queries first to last: (m, k) each.

    Where fewer are nearer than ``within``, the row is n and the distance that.

    O(k + log n) a query near the points. It begins at a place of the tree near each query, (m,), or, where none is
    known, (0,), at the nearest of the query before, and from the leaf of that place it goes on to those beside the
    boxes above it. The k of the query before are no farther from this one than their distance and the way between them.
    """
    n, half, count = len(places), len(boxes) // 2, found.shape[1]
    stack, away, last_of = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST), U(count - 1)
    kept, best = np.zeros(count, np.int64), np.zeros(count)
    place = n
    for i in range(first, last):
        x, y, z, low = queries[i, 0], queries[i, 1], queries[i, 2], 1
        if len(at) > 0:
            place = at[i]
        if place < n:
            low = leaf_above(boxes, places, leaf, place, x, y, z)
        limit = within * within
        if i > first:
            dx, dy, dz = x - queries[i - 1, 0], y - queries[i - 1, 1], z - queries[i - 1, 2]
            farthest = (distances[i - 1, count - 1] + np.sqrt(dx * dx + dy * dy + dz * dz)) * WIDER
            # The next number above, so that what is at the bound is within it.
            limit = min(farthest * farthest * WIDER + 1e-300, limit)
        for j in range(count):
            best[j], kept[j] = limit, n
        node, waiting = low, 0
        while True:
            if node >= half:
                for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                    dx, dy, dz = places[U(t), 0] - x, places[U(t), 1] - y, places[U(t), 2] - z
                    d, row, j = dx * dx + dy * dy + dz * dz, rows[U(t)], count - 1
                    if d > limit or (d == limit and row > kept[last_of]):
                        continue
                    while j > 0 and (d < best[U(j - 1)] or (d == best[U(j - 1)] and row < kept[U(j - 1)])):
                        best[U(j)], kept[U(j)] = best[U(j - 1)], kept[U(j - 1)]
                        j -= 1
                    best[U(j)], kept[U(j)] = d, row
                    limit = best[last_of]
                    if j == 0:
                        place = t
            else:
                near, far = 2 * node, 2 * node + 1
                d0, d1 = box_distance(boxes, near, x, y, z), box_distance(boxes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                if d0 <= limit:
                    if d1 <= limit:
                        stack[U(waiting)], away[U(waiting)] = far, d1
                        waiting += 1
                    node = near
                    continue
            while waiting > 0 and away[U(waiting - 1)] > limit:
                waiting -= 1
            if waiting > 0:
                waiting -= 1
                node = stack[U(waiting)]
                continue
            beyond = True
            while low > 1 and beyond:
                node, low = low ^ 1, low >> 1
                beyond = box_distance(boxes, node, x, y, z) > limit
            if beyond:
                break
        for j in range(count):
            found[i, j], distances[i, j] = kept[j], np.sqrt(best[j])
