"""A tree of boxes by the surface area heuristic: MacDonald and Booth 1990, tried in bins as by Wald 2007.

A query visits a box about as often as the box is large, so that a cut costs the area times the rows of both sides.
Where boxes are cut at their median place instead, faces of very different sizes make boxes that overlap: a query near a
CAD part looks at twice as many of them, and takes 2.2 times as long.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels

# Slabs along an axis between which a cut is tried.
SLABS = 8
# Levels that are cut like this; below them rows are halved as they stand, so that no tree is deeper than a stack.
LEVELS = 32
# Just below one, so that the farthest middle is in the last slab.
INSIDE = 1.0 - 1e-9


@compiled
def area_order(spans: FloatArray, leaf: int, order: IntArray, nodes: FloatArray, links: IntArray) -> int:
    """Sort boxes, (n, 6), lowest and highest corner, and write a tree over them; returns the number of its nodes.

    Order, (n,), is the row that each box had. Nodes, (2 n, 6), are boxes, the first of all; links, (2 n, 3), are the
    first of two children that follow each other and 0, or the first row of a leaf and how many it has; then the node
    above, 0 of the first. O(n) a level, of which there are 32 + log2 n at most.
    """
    n, count, waiting = len(spans), 1, 1
    # Node, first row, the row after the last, level.
    stack, slabs, beyond = np.zeros((LEVELS + 64, 4), np.int64), np.zeros((SLABS, 7)), np.zeros((SLABS + 1, 7))
    stack[0, 2] = n
    # Beyond the last slab there is nothing.
    for k in range(3):
        beyond[SLABS, k], beyond[SLABS, 3 + k] = np.inf, -np.inf
    for i in range(n):
        order[i] = i
    while waiting > 0:
        waiting -= 1
        node, first, last, level = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3]
        for k in range(3):
            least, most = np.inf, -np.inf
            for i in range(first, last):
                least, most = min(least, spans[i, k]), max(most, spans[i, 3 + k])
            nodes[node, k], nodes[node, 3 + k] = least, most
        if last - first <= leaf:
            links[node, 0], links[node, 1] = first, last - first
            continue
        middle = cut(spans, order, first, last, slabs, beyond) if level < LEVELS else (first + last) // 2
        links[node, 0], links[count, 2], links[count + 1, 2] = count, node, node
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3] = count, first, middle, level + 1
        waiting += 1
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3] = count + 1, middle, last, level + 1
        waiting += 1
        count += 2
    return count


@compiled
def cut(spans: FloatArray, order: IntArray, first: int, last: int, slabs: FloatArray, beyond: FloatArray) -> int:
    """Sort rows first to last to both sides of the cheapest cut; returns the first row of the second side."""
    least, axis, place, start, scale = np.inf, 0, 0, 0.0, 0.0
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(first, last):
            middle = spans[i, k] + spans[i, 3 + k]
            low, high = min(low, middle), max(high, middle)
        each = SLABS * INSIDE / (high - low) if high > low else 0.0
        cost, behind = cheapest(spans, first, last, k, low, each, slabs, beyond)
        if cost < least:
            least, axis, place, start, scale = cost, k, behind, low, each
    if place == 0:
        # All middles are in one place.
        return (first + last) // 2
    i, j = first, last - 1
    while i <= j:
        # The slab in which its middle is.
        if np.int64((spans[i, axis] + spans[i, 3 + axis] - start) * scale) < place:
            i += 1
            continue
        order[i], order[j] = order[j], order[i]
        for k in range(6):
            spans[i, k], spans[j, k] = spans[j, k], spans[i, k]
        j -= 1
    return i


@compiled
def cheapest(
    spans: FloatArray,
    first: int,
    last: int,
    axis: int,
    start: float,
    scale: float,
    slabs: FloatArray,
    beyond: FloatArray,
) -> tuple[float, int]:
    """Least cost of a cut along an axis, and the first slab behind it; infinite and 0 where all are in one slab."""
    least, place = np.inf, 0
    for j in range(SLABS):
        for k in range(3):
            slabs[j, k], slabs[j, 3 + k] = np.inf, -np.inf
        slabs[j, 6] = 0.0
    for i in range(first, last):
        slab = np.int64((spans[i, axis] + spans[i, 3 + axis] - start) * scale)
        for k in range(3):
            slabs[slab, k] = min(slabs[slab, k], spans[i, k])
            slabs[slab, 3 + k] = max(slabs[slab, 3 + k], spans[i, 3 + k])
        slabs[slab, 6] += 1.0
    # From either end, a slab together with all beyond it.
    for j in range(SLABS - 1, -1, -1):
        join(slabs, j, beyond, j + 1, beyond)
    for j in range(1, SLABS):
        if slabs[j - 1, 6] > 0.0 and beyond[j, 6] > 0.0:
            cost = cost_of(slabs, j - 1) + cost_of(beyond, j)
            if cost < least:
                least, place = cost, j
        join(slabs, j, slabs, j - 1, slabs)
    return least, place


@inside_kernels
def join(one: FloatArray, j: int, other: FloatArray, i: int, both: FloatArray) -> None:
    """Write box and rows of two slabs together to that of the first."""
    for k in range(3):
        both[j, k] = min(one[j, k], other[i, k])
        both[j, 3 + k] = max(one[j, 3 + k], other[i, 3 + k])
    both[j, 6] = one[j, 6] + other[i, 6]


@inside_kernels
def cost_of(slabs: FloatArray, j: int) -> float:
    """Half of the area of a box times its rows."""
    x, y, z = slabs[j, 3] - slabs[j, 0], slabs[j, 4] - slabs[j, 1], slabs[j, 5] - slabs[j, 2]
    cost: float = (x * y + y * z + z * x) * slabs[j, 6]
    return cost
