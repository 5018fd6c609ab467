"""A tree of boxes over points that takes more of them: its leaves have room, and what is too full is spread anew."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.kd_order import DEEPEST, MANY_KEYS, part_keys, widest_side
from dqreg.kernels.point_tree import PointTree
from dqreg.kernels.threads import as_plain

# Places a leaf; the share of its places that a large part of the tree holds at most; and the share of all from which on
# the tree is made anew, twice as large: nearly as full as its parts may be, these would be spread at every turn.
LEAF, FULL, MOST = 12, 0.8, 0.6
# Row of a place that holds no point: behind all others.
NO_ROW = 2**62


class GrowingTree:
    """Tree of points that are appended to; what is asked of it is a `PointTree` whose leaves have free places.

    Free places lie at infinity. A part of the tree takes points until it is too full, the fuller the smaller it is;
    then the smallest part around it that has room is ordered anew.
    """

    def __init__(self) -> None:
        self._order, self._keys, self._room = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0, dtype=np.int64)
        self._make(1)

    def _make(self, leaves: int) -> None:
        height = leaves.bit_length() - 1
        shares = 1.0 - (1.0 - FULL) * np.arange(height + 1) / max(height, 1)
        self._limits: IntArray = (LEAF * 2 ** np.arange(height + 1) * shares).astype(np.int64)
        boxes, places = np.tile([np.inf] * 3 + [-np.inf] * 3, (2 * leaves, 1)), np.full((LEAF * leaves, 3), np.inf)
        self.tree = PointTree(boxes, places, np.full(len(places), NO_ROW), LEAF)
        self._counts, self._cuts = np.zeros(2 * leaves, dtype=np.int64), np.zeros((leaves, 2))
        self.count = 0

    @property
    def standing(self) -> IntArray:
        """Place of each point in the tree, (n,)."""
        return self._room[: self.count]

    def grow(self, points: FloatArray, count: int) -> None:
        """Take the points, (n, 3), up to a count, of which those taken before are the first."""
        if count > MOST * LEAF * len(self._cuts):
            leaves = 1
            while MOST * LEAF * leaves < 2 * count:
                leaves *= 2
            self._make(leaves)
        if len(self._keys) < count:
            self._order, self._keys = np.zeros(2 * count, dtype=np.int64), np.zeros(2 * count)
            self._room = np.concatenate([self._room[: self.count], np.zeros(2 * count - self.count, dtype=np.int64)])
        tree, some = self.tree, np.arange(self.count, count)
        state = self._limits, tree.boxes, self._counts, self._cuts, tree.places, tree.rows, self._room
        grow_tree(as_plain(points), LEAF, *state, some, self._order, self._keys)
        self.count = count


@compiled
def grow_tree(
    points: FloatArray,
    leaf: int,
    limits: IntArray,
    boxes: FloatArray,
    counts: IntArray,
    cuts: FloatArray,
    places: FloatArray,
    rows: IntArray,
    standing: IntArray,
    added: IntArray,
    order: IntArray,
    keys: FloatArray,
) -> None:
    """Put rows of points that were added into a tree, all at once; at a node of height h it holds ``limits[h]`` points.

    ``cuts``, (leaves, 2), are the axis across which a node is cut, and where; ``standing`` are the places of the rows.

    O(log n) a point, and O(m log m) for parts of m points that are spread anew. The order and the keys are room for as
    many as there are points.
    """
    leaves, stack = len(boxes) // 2, np.zeros((2 * DEEPEST, 4), np.int64)
    sample = np.zeros(MANY_KEYS[1])
    # Nodes that are to take some of the rows: node, height, first and last of the rows.
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 1, len(limits) - 1, 0, len(added)
    # From the stack: for a constant of its own the function would be compiled once more.
    _take(stack[0, 0], stack[0, 2], stack[0, 3], points, added, boxes, counts)
    waiting = 1 if len(added) > 0 else 0
    while waiting > 0:
        waiting -= 1
        node, height, start, end = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3]
        if height == 0:
            first = (node - leaves) * leaf + counts[node] - (end - start)
            for i in range(start, end):
                _put(first + i - start, added[i], points, places, rows, standing)
            continue
        middle = _lower_first(node, start, end, points, added, cuts)
        left, right, most = counts[2 * node] + middle - start, counts[2 * node + 1] + end - middle, limits[height - 1]
        if left > most or right > most:
            _spread(
                node,
                height,
                start,
                end,
                points,
                leaf,
                boxes,
                counts,
                cuts,
                places,
                rows,
                standing,
                added,
                order,
                keys,
                sample,
            )
            continue
        for child in range(2):
            low, high = (start, middle) if child == 0 else (middle, end)
            if low < high:
                _take(2 * node + child, low, high, points, added, boxes, counts)
                stack[waiting, 0], stack[waiting, 1] = 2 * node + child, height - 1
                stack[waiting, 2], stack[waiting, 3] = low, high
                waiting += 1


@inside_kernels
def _take(
    node: int, start: int, end: int, points: FloatArray, added: IntArray, boxes: FloatArray, counts: IntArray
) -> None:
    counts[node] += end - start
    for i in range(start, end):
        for k in range(3):
            value = points[added[i], k]
            boxes[node, k], boxes[node, 3 + k] = min(boxes[node, k], value), max(boxes[node, 3 + k], value)


@inside_kernels
def _put(place: int, row: int, points: FloatArray, places: FloatArray, rows: IntArray, standing: IntArray) -> None:
    rows[place], standing[row] = row, place
    places[place, 0], places[place, 1], places[place, 2] = points[row, 0], points[row, 1], points[row, 2]


@inside_kernels
def _lower_first(node: int, start: int, end: int, points: FloatArray, added: IntArray, cuts: FloatArray) -> int:
    """Put the rows first whose points lie below the cut of a node; place of the first other one."""
    axis, cut, first = np.int64(cuts[node, 0]), cuts[node, 1], start
    for i in range(start, end):
        row = added[i]
        if points[row, axis] < cut:
            added[i], added[first] = added[first], row
            first += 1
    return first


@inside_kernels
def _spread(
    node: int,
    height: int,
    start: int,
    end: int,
    points: FloatArray,
    leaf: int,
    boxes: FloatArray,
    counts: IntArray,
    cuts: FloatArray,
    places: FloatArray,
    rows: IntArray,
    standing: IntArray,
    added: IntArray,
    order: IntArray,
    keys: FloatArray,
    sample: FloatArray,
) -> None:
    """Order the points below a node anew, with those that are added, as many in each leaf."""
    leaves, stack = len(boxes) // 2, np.zeros((2 * DEEPEST, 3), np.int64)
    total = _gather(node << height, (node + 1) << height, leaves, leaf, counts, rows, order)
    for i in range(start, end):
        order[total + i - start] = added[i]
    total += end - start
    stack[0, 0], stack[0, 1], stack[0, 2] = node, 0, total
    waiting = 1
    while waiting > 0:
        waiting -= 1
        j, low, high = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2]
        counts[j] = high - low
        if j >= leaves:
            for i in range(leaf):
                place = (j - leaves) * leaf + i
                if low + i < high:
                    _put(place, order[low + i], points, places, rows, standing)
                else:
                    rows[place], places[place, 0], places[place, 1], places[place, 2] = NO_ROW, np.inf, np.inf, np.inf
            continue
        middle = low + (high - low) // 2
        if low < high:
            axis = widest_side(points, order, low, high)
            for i in range(low, high):
                keys[i] = points[order[i], axis]
            part_keys(keys, order, low, high - 1, middle, sample)
            cuts[j, 0], cuts[j, 1] = axis, keys[middle]
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = 2 * j, low, middle
        stack[waiting + 1, 0], stack[waiting + 1, 1], stack[waiting + 1, 2] = 2 * j + 1, middle, high
        waiting += 2
    for up in range(height + 1):
        for j in range(node << (height - up), (node + 1) << (height - up)):
            _bound(j, leaves, leaf, boxes, counts, places)


@inside_kernels
def _gather(first: int, last: int, leaves: int, leaf: int, counts: IntArray, rows: IntArray, order: IntArray) -> int:
    """Write the rows in the leaves first to last; how many they are."""
    total = 0
    for j in range(first, last):
        for i in range((j - leaves) * leaf, (j - leaves) * leaf + counts[j]):
            order[total] = rows[i]
            total += 1
    return total


@inside_kernels
def _bound(j: int, leaves: int, leaf: int, boxes: FloatArray, counts: IntArray, places: FloatArray) -> None:
    """Write the box of a node, from its points or from the boxes below it."""
    for k in range(3):
        least, most = np.inf, -np.inf
        if j >= leaves:
            for i in range((j - leaves) * leaf, (j - leaves) * leaf + counts[j]):
                least, most = min(least, places[i, k]), max(most, places[i, k])
        else:
            least = min(boxes[2 * j, k], boxes[2 * j + 1, k])
            most = max(boxes[2 * j, 3 + k], boxes[2 * j + 1, 3 + k])
        boxes[j, k], boxes[j, 3 + k] = least, most
