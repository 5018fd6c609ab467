"""Order of a balanced kd-tree, places cut at their median along the widest side again and again, and its boxes."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.threads import over_chunks

# Multiplier and increment of a linear congruential generator (Knuth): pivots that no input was made against.
FACTOR, STEP = 6364136223846793005, 1442695040888963407
DEEPEST = 64  # nodes that wait at a time: one a level, and no heap that fits into memory is deeper
# Places that one thread orders at a time.
CHUNK_PLACES = 16_384
# Keys of which a pivot is chosen: of a range of so many keys and more, so many.
FEW_KEYS, SOME_KEYS = (32, 3), (200, 9)
MANY_KEYS = (1_000, 21)


def kd_order(places: FloatArray, leaf: int) -> IntArray:
    """Rows of places, (n, 3), in the order of a heap of boxes with ``leaf`` rows a leaf, (n,).

    Node i of the heap has the children 2i and 2i + 1; the last level of 2^k leaves is filled from the left. O(n log n),
    also for places in line, in a grid or all in one: equal keys are split evenly. Nodes of many places are cut on all
    threads.
    """
    n, leaves, nodes = len(places), 1, 1
    order, keys = np.arange(n), np.zeros(n)
    while leaves * leaf < n:
        leaves *= 2
    while n > CHUNK_PLACES * nodes:
        over_chunks(cut_nodes, nodes, places, leaf, leaves // nodes, False, order, keys, chunk=1)
        nodes *= 2
    over_chunks(cut_nodes, nodes, places, leaf, leaves // nodes, True, order, keys, chunk=1)
    return order


@compiled
def cut_nodes(
    first: int, last: int, places: FloatArray, leaf: int, leaves: int, deep: bool, order: IntArray, keys: FloatArray
) -> None:
    """Order the rows of nodes first to last, of so many leaves each, by the plane that cuts each; and those below."""
    # First leaf and number of leaves of the nodes still to be cut.
    stack, sample = np.zeros(2 * DEEPEST, np.int64), np.zeros(MANY_KEYS[1])
    for node in range(first, last):
        stack[0], stack[1] = node * leaves, leaves
        waiting = 1
        while waiting > 0:
            waiting -= 1
            start, count = stack[2 * waiting], stack[2 * waiting + 1]
            low, high = start * leaf, min((start + count) * leaf, len(places))
            if count == 1 or low >= len(places):
                continue
            middle = (start + count // 2) * leaf
            if middle < high:
                axis = widest_side(places, order, low, high)
                for i in range(low, high):
                    keys[i] = places[order[i], axis]
                part_keys(keys, order, low, high - 1, middle, sample)
            if deep:
                # Number by number: a pair at once would compile checks of shapes for seconds.
                stack[2 * waiting], stack[2 * waiting + 1] = start, count // 2
                stack[2 * waiting + 2], stack[2 * waiting + 3] = start + count // 2, count // 2
                waiting += 2


@inside_kernels
def widest_side(places: FloatArray, order: IntArray, low: int, high: int) -> int:
    """Axis along which places spread most."""
    # All sides in one go: they lie anywhere in memory.
    row = order[low]
    x0 = x1 = places[row, 0]
    y0 = y1 = places[row, 1]
    z0 = z1 = places[row, 2]
    for i in range(low + 1, high):
        row = order[i]
        x, y, z = places[row, 0], places[row, 1], places[row, 2]
        x0, x1, y0, y1, z0, z1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y), min(z0, z), max(z1, z)
    x, y, z = x1 - x0, y1 - y0, z1 - z0
    return 0 if x >= y and x >= z else 1 if y >= z else 2


@inside_kernels
def part_keys(keys: FloatArray, order: IntArray, left: int, right: int, middle: int, sample: FloatArray) -> None:
    """Selection: afterwards no key before the middle is greater than the key there, and none behind it smaller."""
    state = np.uint64(left + 1)
    while left < right:
        count, few = right - left + 1, 1
        for least, wanted in (FEW_KEYS, SOME_KEYS, MANY_KEYS):
            few = wanted if count >= least else few
        for k in range(few):
            state = state * np.uint64(FACTOR) + np.uint64(STEP)
            key, j = keys[left + np.int64((state >> np.uint64(33)) % np.uint64(count))], k
            while j > 0 and sample[j - 1] > key:
                sample[j] = sample[j - 1]
                j -= 1
            sample[j] = key
        # The key of the sample that stands where the middle does among all.
        pivot = sample[few * (middle - left) // count]
        first = _sorted_out(keys, order, left, right, pivot)
        if middle < first:
            right = first - 1
        elif first > left:
            left = first
        else:
            # No key is smaller: those that are equal come first.
            left = _sorted_out(keys, order, left, right, np.nextafter(pivot, np.inf))
            if middle < left:
                return


@inside_kernels
def _sorted_out(keys: FloatArray, order: IntArray, left: int, right: int, pivot: float) -> int:
    """Put the keys below a pivot first; place of the first other one."""
    first = left
    for i in range(left, right + 1):
        # Swapped in any case: which are below is as good as random, and a guess that fails costs more.
        key, row = keys[i], order[i]
        keys[i], order[i] = keys[first], order[first]
        keys[first], order[first] = key, row
        first += 1 if key < pivot else 0
    return first


@compiled
def heap_boxes(low: FloatArray, high: FloatArray, leaf: int) -> FloatArray:
    """Boxes of all nodes from those of the rows, (2 L, 6); an empty one is inside out. O(n)."""
    n, leaves = len(low), 1
    while leaves * leaf < n:
        leaves *= 2
    boxes = np.zeros((2 * leaves, 6))
    for j in range(2 * leaves - 1, 0, -1):
        for k in range(3):
            least, most = np.inf, -np.inf
            if j >= leaves:
                for i in range((j - leaves) * leaf, min((j - leaves + 1) * leaf, n)):
                    least, most = min(least, low[i, k]), max(most, high[i, k])
            else:
                least, most = (
                    min(boxes[2 * j, k], boxes[2 * j + 1, k]),
                    max(boxes[2 * j, 3 + k], boxes[2 * j + 1, 3 + k]),
                )
            boxes[j, k], boxes[j, 3 + k] = least, most
    return boxes
