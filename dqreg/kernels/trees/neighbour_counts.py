"""Which points of a tree have enough neighbours within a radius: counted until there are enough, nearest or not."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.closest_triangles import DEEPEST, box_distance


@compiled
def rows_with_neighbours(
    first: int, last: int, boxes: FloatArray, places: FloatArray, leaf: int, count: int, within: float, found: BoolArray
) -> None:
    """Write which points of a tree, first to last, have ``count`` within a distance, themselves among them.

    Most have them in their own leaf. O(count) a point, O(count + log n) where there are none.
    """
    n, half, square = len(places), len(boxes) // 2, within * within
    stack = np.zeros(DEEPEST, np.int64)
    for i in range(first, last):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        low = half + i // leaf
        stack[0], waiting, near = low, 1, 0
        while near < count:
            if waiting == 0:
                if low == 1:
                    break
                # What lies beside the box that has been looked through.
                stack[0], low, waiting = low ^ 1, low >> 1, 1
            waiting -= 1
            node = stack[waiting]
            if box_distance(boxes, node, x, y, z) > square:
                continue
            if node < half:
                stack[waiting], stack[waiting + 1] = 2 * node, 2 * node + 1
                waiting += 2
                continue
            for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
                near += dx * dx + dy * dy + dz * dz <= square
        found[i] = near >= count
