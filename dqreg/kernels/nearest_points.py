"""The nearest points of a tree of points, closest first; of equally near ones those with the lower rows."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.closest_triangles import DEEPEST, box_distance
from dqreg.kernels.compiled import compiled

# A bound from the query before is rounded up, so that nothing within it is lost.
WIDER = 1.0 + 1e-12


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

    O(k + log n) a query near the points. The k points found for one query are no farther from the next than their
    distance and the way between the two, so that neighbouring queries hardly look around; nor are they farther than the
    k around a place of the tree, (m,) where one near each query is known, (0,) else: there the search begins, and goes
    up from box to box instead of down to it.
    """
    n, half, count = len(places), len(boxes) // 2, found.shape[1]
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    kept, best = np.zeros(count, np.int64), np.zeros(count)
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        reach = within * within
        if i > first:
            dx, dy, dz = x - queries[i - 1, 0], y - queries[i - 1, 1], z - queries[i - 1, 2]
            reach = (distances[i - 1, count - 1] + np.sqrt(dx * dx + dy * dy + dz * dz)) * WIDER
            # The next number above, so that what is at the bound is within it.
            reach = min(reach * reach * WIDER + 1e-300, within * within)
        top = 1
        if len(at) > 0:
            low, farthest = max(min(at[i] - count // 2, n - count), 0), 0.0
            for t in range(low, low + count):
                dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
                farthest = max(farthest, dx * dx + dy * dy + dz * dz)
            reach, top = min(reach, farthest), half + at[i] // leaf
        for j in range(count):
            best[j], kept[j] = reach, n
        node, waiting = top, 0
        while node > 0:
            if node >= half:
                for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                    dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
                    d, row = dx * dx + dy * dy + dz * dz, rows[t]
                    j = count - 1
                    if d > best[j] or (d == best[j] and row > kept[j]):
                        continue
                    while j > 0 and (d < best[j - 1] or (d == best[j - 1] and row < kept[j - 1])):
                        best[j], kept[j] = best[j - 1], kept[j - 1]
                        j -= 1
                    best[j], kept[j] = d, row
            else:
                near, far = 2 * node, 2 * node + 1
                d0, d1 = box_distance(boxes, near, x, y, z), box_distance(boxes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                if d0 <= best[count - 1]:
                    if d1 <= best[count - 1]:
                        stack[waiting], away[waiting] = far, d1
                        waiting += 1
                    node = near
                    continue
            while waiting > 0 and away[waiting - 1] > best[count - 1]:
                waiting -= 1
            node = 0
            if waiting > 0:
                waiting -= 1
                node = stack[waiting]
            while node == 0 and top > 1:
                # All below the top is done: what is beside it comes next.
                if box_distance(boxes, top ^ 1, x, y, z) <= best[count - 1]:
                    node = top ^ 1
                top //= 2
        for j in range(count):
            found[i, j], distances[i, j] = kept[j], np.sqrt(best[j])
