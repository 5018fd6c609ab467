"""Which points have any of some others within reach: a search that ends at the first."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.trees.closest_triangles import DEEPEST, box_distance
from dqreg.kernels.trees.kd_order import heap_boxes


@compiled
def near_rows(
    points: FloatArray, rows: IntArray, cloud: FloatArray, others: IntArray, leaf: int, reach: float, found: BoolArray
) -> None:
    """Write which rows of the points, (m,), have one of the other rows of a cloud, (k,), nearer than reach.

    O(k + m log k) where both go along space-filling curves: boxes are made of the others as they come, so many a leaf.
    Shapes: points (n, 3), cloud (l, 3), found (m,).
    """
    places = np.zeros((len(others), 3))
    for t in range(len(others)):
        for k in range(3):
            places[t, k] = cloud[others[t], k]
    boxes, stack = heap_boxes(places, places, leaf), np.zeros(DEEPEST, np.int64)
    last, limit = len(places), reach * reach
    for i in range(len(rows)):
        x, y, z = points[rows[i], 0], points[rows[i], 1], points[rows[i], 2]
        # From where the one before had something within reach on to what lies beside the boxes above it.
        node = len(boxes) // 2 + last // leaf if last < len(places) else 1
        t = _first_near(boxes, places, leaf, stack, node, x, y, z, reach)
        while t == len(places) and node > 1:
            if box_distance(boxes, node ^ 1, x, y, z) <= limit:
                t = _first_near(boxes, places, leaf, stack, node ^ 1, x, y, z, reach)
            node = node >> 1
        found[i] = t < len(places)
        last = t if found[i] else last


@inside_kernels
def _first_near(
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    stack: IntArray,
    node: int,
    x: float,
    y: float,
    z: float,
    reach: float,
) -> int:
    """A place within reach in a node; their number where there is none."""
    half, limit, waiting = len(boxes) // 2, reach * reach, 1
    stack[0] = node
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if node < half:
            for child in range(2 * node, 2 * node + 2):
                if box_distance(boxes, child, x, y, z) <= limit:
                    stack[waiting] = child
                    waiting += 1
            continue
        for t in range((node - half) * leaf, min((node - half + 1) * leaf, len(places))):
            dx, dy, dz = places[t, 0] - x, places[t, 1] - y, places[t, 2] - z
            square = dx * dx + dy * dy + dz * dz
            if square <= limit and np.sqrt(square) < reach:
                return t
    return len(places)
