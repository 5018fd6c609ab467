"""A tree of boxes by the surface area heuristic: MacDonald and Booth 1990, tried in bins as by Wald 2007.

A query visits a box about as often as the box is large, so that a cut costs the area times the rows of both sides.
Where boxes are cut at their median place instead, faces of very different sizes make boxes that overlap: a query near a
CAD part looks at twice as many of them, and takes 2.2 times as long.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

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
    n, waiting = len(spans), 1
    # Node, first row, the row after the last, level.
    stack, slabs, beyond = np.zeros((LEVELS + 64, 4), np.int64), np.zeros((3 * SLABS, 7)), np.zeros((SLABS + 1, 7))
    stack[0, 2] = n
    # From the array: literal numbers would be types of their own, and what takes them compiled once more.
    root: int = stack[0, 0]
    count = root + 1
    for i in range(n):
        order[i] = i
    box_of(spans, root, n, nodes, root)
    while waiting > 0:
        waiting -= 1
        node, first, last, level = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3]
        if last - first <= leaf:
            links[node, 0], links[node, 1] = first, last - first
            continue
        middle = cut(spans, order, first, last, slabs, beyond, nodes, count) if level < LEVELS else -1
        if middle < 0:
            middle = (first + last) // 2
            box_of(spans, first, middle, nodes, count)
            box_of(spans, middle, last, nodes, count + 1)
        links[node, 0], links[count, 2], links[count + 1, 2] = count, node, node
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3] = count, first, middle, level + 1
        waiting += 1
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3] = count + 1, middle, last, level + 1
        waiting += 1
        count += 2
    return count


@inside_kernels
def box_of(spans: FloatArray, first: int, last: int, nodes: FloatArray, node: int) -> None:
    """Write the box around rows first to last."""
    for k in range(3):
        nodes[node, k], nodes[node, 3 + k] = np.inf, -np.inf
    for i in range(first, last):
        for k in range(3):
            nodes[node, k] = min(nodes[node, k], spans[i, k])
            nodes[node, 3 + k] = max(nodes[node, 3 + k], spans[i, 3 + k])


@inside_kernels
def cut(
    spans: FloatArray,
    order: IntArray,
    first: int,
    last: int,
    slabs: FloatArray,
    beyond: FloatArray,
    nodes: FloatArray,
    node: int,
) -> int:
    """Sort rows first to last to both sides of the cheapest cut, and write the boxes of both, a node and the next.

    Returns the first row of the second side; -1, and nothing is done, where all middles are in one place.
    """
    # Few rows need no more slabs than they are.
    count = min(SLABS, last - first)
    x0, y0, z0, x1, y1, z1 = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for i in range(first, last):
        x, y, z = spans[i, 0] + spans[i, 3], spans[i, 1] + spans[i, 4], spans[i, 2] + spans[i, 5]
        x0, y0, z0, x1, y1, z1 = min(x0, x), min(y0, y), min(z0, z), max(x1, x), max(y1, y), max(z1, z)
    xs = count * INSIDE / (x1 - x0) if x1 > x0 else 0.0
    ys = count * INSIDE / (y1 - y0) if y1 > y0 else 0.0
    zs = count * INSIDE / (z1 - z0) if z1 > z0 else 0.0
    for j in range(3 * count):
        empty(slabs, j)
    for i in range(first, last):
        add(spans, i, slabs, np.int64((spans[i, 0] + spans[i, 3] - x0) * xs))
        add(spans, i, slabs, count + np.int64((spans[i, 1] + spans[i, 4] - y0) * ys))
        add(spans, i, slabs, 2 * count + np.int64((spans[i, 2] + spans[i, 5] - z0) * zs))
    least, axis, place = np.inf, 0, 0
    for k in range(3):
        least, found = cheapest(slabs, k * count, count, beyond, least, nodes, node)
        if found > 0:
            axis, place = k, found
    if place == 0:
        return -1
    start, scale = (x0, xs) if axis == 0 else (y0, ys) if axis == 1 else (z0, zs)
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


@inside_kernels
def cheapest(
    slabs: FloatArray, first: int, count: int, beyond: FloatArray, limit: float, nodes: FloatArray, node: int
) -> tuple[float, int]:
    """Least cost of a cut between slabs of an axis, and the first slab behind it: the limit and 0 where none is less.

    Writes the boxes of both sides, a node and the next. Each slab is joined to those before it.
    """
    least, place = limit, 0
    # From the far end, a slab together with all beyond it.
    empty(beyond, count)
    for j in range(count - 1, -1, -1):
        join(slabs, first + j, beyond, j + 1, beyond, j)
    for j in range(1, count):
        before = first + j - 1
        if slabs[before, 6] > 0.0 and beyond[j, 6] > 0.0:
            cost = cost_of(slabs, before) + cost_of(beyond, j)
            if cost < least:
                least, place = cost, j
                for k in range(6):
                    nodes[node, k], nodes[node + 1, k] = slabs[before, k], beyond[j, k]
        join(slabs, first + j, slabs, before, slabs, first + j)
    return least, place


@inside_kernels
def empty(slabs: FloatArray, j: int) -> None:
    """Make a slab one without rows."""
    for k in range(3):
        slabs[j, k], slabs[j, 3 + k] = np.inf, -np.inf
    slabs[j, 6] = 0.0


@inside_kernels
def add(spans: FloatArray, i: int, slabs: FloatArray, j: int | np.int64) -> None:
    """Add row i to a slab."""
    for k in range(3):
        slabs[j, k] = min(slabs[j, k], spans[i, k])
        slabs[j, 3 + k] = max(slabs[j, 3 + k], spans[i, 3 + k])
    slabs[j, 6] += 1.0


@inside_kernels
def join(one: FloatArray, j: int, other: FloatArray, i: int, both: FloatArray, k: int) -> None:
    """Write box and rows of two slabs together to a third."""
    for m in range(3):
        both[k, m] = min(one[j, m], other[i, m])
        both[k, 3 + m] = max(one[j, 3 + m], other[i, 3 + m])
    both[k, 6] = one[j, 6] + other[i, 6]


@inside_kernels
def cost_of(slabs: FloatArray, j: int) -> float:
    """Half of the area of a box times its rows."""
    x, y, z = slabs[j, 3] - slabs[j, 0], slabs[j, 4] - slabs[j, 1], slabs[j, 5] - slabs[j, 2]
    cost: float = (x * y + y * z + z * x) * slabs[j, 6]
    return cost
