"""The sides of triangles: which of them are one edge, and what lies across each."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def number_sides(
    corners: IntArray, count: int, real: BoolArray, edges: IntArray, across: IntArray, neighbours: IntArray
) -> None:
    """Write the edge of each side, and the side met across it, which is itself where there is none: (f, 3) each.

    Side ``3 f + k`` runs from corner k of face f to the next. Edges are numbered by their lower, then their higher
    vertex. Faces that are not real join nothing. Where more than two sides are one edge, each meets the one before it.
    Neighbours, (n, 3), are the faces across the sides of the first n; a face itself where there is none among them.
    O(f + count): sorted by counting, whatever number of sides a vertex has.

    Shapes: corners (f, 3), numbers below ``count``; real (f,).
    """
    total = 3 * len(corners)
    starts, ends = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    half, order = np.zeros(total, np.int64), np.zeros(total, np.int64)
    for s in range(total):
        a, b = corners[s // 3, s % 3], corners[s // 3, (s + 1) % 3]
        starts[min(a, b) + 1] += 1
        ends[max(a, b) + 1] += 1
    for v in range(count):
        starts[v + 1] += starts[v]
        ends[v + 1] += ends[v]
    for s in range(total):
        high = max(corners[s // 3, s % 3], corners[s // 3, (s + 1) % 3])
        half[ends[high]] = s
        ends[high] += 1
    for i in range(total):
        s = half[i]
        low = min(corners[s // 3, s % 3], corners[s // 3, (s + 1) % 3])
        order[starts[low]] = s
        starts[low] += 1
    number, low, high, last = -1, -1, -1, -1
    for i in range(total):
        s = order[i]
        f, k = s // 3, s % 3
        a, b = corners[f, k], corners[f, (k + 1) % 3]
        if min(a, b) != low or max(a, b) != high:
            number, low, high, last = number + 1, min(a, b), max(a, b), -1
        edges[f, k], across[f, k] = number, s
        if not real[f]:
            continue
        if last >= 0:
            across[f, k] = last
            if across[last // 3, last % 3] == last:
                across[last // 3, last % 3] = s
        last = s
    for f in range(len(neighbours)):
        for k in range(3):
            other = across[f, k] // 3
            neighbours[f, k] = other if other < len(neighbours) else f
