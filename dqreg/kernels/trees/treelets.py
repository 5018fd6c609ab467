"""Small trees from the leaves up: neighbours along the Morton curve that make the smallest boxes are joined first.

Parallel locally-ordered clustering (Meister and Bittner 2018), in blocks of a fixed size. O(n), and each block is in a
core's cache: half of what cutting from the top down by areas costs a triangle goes into its last four levels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

Singles = NDArray[np.float32]
Numbers = NDArray[np.int32]

# Triangles of a block; places along the curve within which each looks for its mate.
BLOCK, REACH = 1_024, 16
# Rounds of joining; then neighbours are joined as they stand, so that no tree is deeper than a stack.
ROUNDS = 16
# Nodes of a small tree that wait at a time, one a level.
DEEP = 64


@compiled
def boxes_in_order(first: int, last: int, corners: FloatArray, rows: IntArray, boxes: Singles) -> None:
    """Write the boxes of triangles first to last of an order, (6, n), lowest and highest corner, to single digits."""
    for i in range(first, last):
        f = rows[i]
        for k in range(3):
            a, b, c = corners[f, 0, k], corners[f, 1, k], corners[f, 2, k]
            boxes[k, i], boxes[3 + k, i] = min(a, b, c), max(a, b, c)


@compiled
def join_in_blocks(first: int, last: int, share: int, boxes: Singles, pairs: IntArray, roots: IntArray) -> None:
    """Join triangles first to last to small trees, of so many triangles on average.

    Node n + i joins the two nodes ``pairs[i]``; below n they are triangles. The roots, and their boxes, are written in
    place of the first triangles of the range, and -1 for the others. Shapes: boxes (6, n), pairs (n, 2), roots (n,).
    """
    n, left = boxes.shape[1], last - first
    own, ids, made, wanted = boxes[:, first:last].copy(), np.arange(first, last), first, max(left // share, 1)
    lengths, costs, best = np.zeros((3, left), np.float32), np.zeros(left, np.float32), np.zeros(left, np.float32)
    mates = np.zeros(left, np.int32)
    tries = 0
    while left > wanted:
        if tries < ROUNDS:
            choose_mates(own, left, lengths, costs, best, mates)
        else:
            for i in range(left):
                mates[i] = i ^ 1 if i ^ 1 < left else i
        tries += 1
        kept = 0
        for i in range(left):
            j = np.int64(mates[i])
            joined = j != i and mates[j] == i
            if joined and j < i:
                continue
            if joined:
                pairs[made, 0], pairs[made, 1] = ids[i], ids[j]
                ids[kept] = n + made
                made += 1
                for k in range(3):
                    own[k, kept] = min(own[k, i], own[k, j])
                    own[3 + k, kept] = max(own[3 + k, i], own[3 + k, j])
            else:
                ids[kept] = ids[i]
                for k in range(6):
                    own[k, kept] = own[k, i]
            kept += 1
        left = kept
    for i in range(last - first):
        roots[first + i] = ids[i] if i < left else -1
    for k in range(6):
        for i in range(left):
            boxes[k, first + i] = own[k, i]


@inside_kernels
def choose_mates(own: Singles, left: int, lengths: Singles, costs: Singles, best: Singles, mates: Numbers) -> None:
    """Write to each box the other within reach with which it makes the box of the smallest area."""
    for i in range(left):
        best[i], mates[i] = np.float32(np.inf), i
    for d in range(1, min(REACH + 1, left)):
        join_costs(own, left, d, lengths, costs)
        if d == 1:
            # Of equals the other one of a pair: boxes in one place are all joined in one round.
            for i in range(0, left - 1, 2):
                best[i], best[i + 1], mates[i], mates[i + 1] = costs[i], costs[i], i + 1, i
        count = left - d
        some, cost, ahead = best[:count], costs[:count], mates[:count]
        for i in range(count):
            closer = cost[i] < some[i]
            some[i] = cost[i] if closer else some[i]
            ahead[i] = i + d if closer else ahead[i]
        some, ahead = best[d:left], mates[d:left]
        for i in range(count):
            closer = cost[i] < some[i]
            some[i] = cost[i] if closer else some[i]
            ahead[i] = i if closer else ahead[i]


@inside_kernels
def join_costs(own: Singles, left: int, d: int, lengths: Singles, costs: Singles) -> None:
    """Write half of the area of the box around each box and the one so many places on, (left - d,)."""
    # In loops over few arrays each, which become vector instructions.
    count = left - d
    for k in range(3):
        low, lower, high, higher = own[k, :count], own[k, d:left], own[3 + k, :count], own[3 + k, d:left]
        length = lengths[k, :count]
        for i in range(count):
            bottom = low[i] if low[i] < lower[i] else lower[i]
            top = high[i] if high[i] > higher[i] else higher[i]
            length[i] = top - bottom
    x, y, z, cost = lengths[0, :count], lengths[1, :count], lengths[2, :count], costs[:count]
    for i in range(count):
        cost[i] = x[i] * y[i] + (y[i] + x[i]) * z[i]


@compiled
def hang_trees(
    tops: int, order: IntArray, roots: IntArray, pairs: IntArray, links: IntArray, slots: IntArray, leaves: IntArray
) -> int:
    """Put small trees in place of the leaves of a tree over them; returns the number of all nodes.

    The first ``tops`` links are those of `area_order` with one root a leaf. A leaf has one triangle or two; on nine
    CAD parts two took 0.7 to 0.95 of the time of four. Writes the triangle of each slot, (n,), and the leaf that holds
    it. Shapes: order and roots (m,), pairs (n, 2), links (2 n, 3).
    """
    n, count, slot = len(pairs), tops, 0
    nodes, trees = np.zeros(DEEP, np.int64), np.zeros(DEEP, np.int64)
    for top in range(tops):
        if links[top, 1] == 0:
            continue
        waiting = 1
        nodes[0], trees[0] = top, roots[order[links[top, 0]]]
        while waiting > 0:
            waiting -= 1
            node, tree = nodes[waiting], trees[waiting]
            one, two = (tree, tree) if tree < n else (pairs[tree - n, 0], pairs[tree - n, 1])
            if one >= n or two >= n:
                links[node, 0], links[node, 1] = count, 0
                links[count, 2], links[count + 1, 2] = node, node
                nodes[waiting], trees[waiting] = count + 1, two
                nodes[waiting + 1], trees[waiting + 1] = count, one
                waiting, count = waiting + 2, count + 2
                continue
            links[node, 0], links[node, 1] = slot, 1 if one == two else 2
            slots[slot], leaves[slot] = one, node
            slot += 1
            if one != two:
                slots[slot], leaves[slot] = two, node
                slot += 1
    return count


@compiled
def enclose_children(links: IntArray, nodes: FloatArray) -> None:
    """Write the boxes of all nodes, (k, 6), those of leaves being there: children come after the node above them."""
    for up in range(len(links)):
        node = len(links) - 1 - up
        if links[node, 1] > 0:
            continue
        child = links[node, 0]
        for k in range(3):
            nodes[node, k] = min(nodes[child, k], nodes[child + 1, k])
            nodes[node, 3 + k] = max(nodes[child, 3 + k], nodes[child + 1, 3 + k])
