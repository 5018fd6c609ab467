"""The nearest points of the points of a tree themselves: those of a leaf look for theirs among the same few leaves."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.trees.kd_order import DEEPEST

# What stands between brackets counts from the end where it is below zero, which each access asks of a signed number.
U = np.uint64
# Places that the points of a leaf look among at most, and how often they look farther.
MAX_PLACES, MAX_TRIES = 512, 6
# Squares that are ranked are filled up to a multiple of so many, which processors compare at a time.
LANES = 8
# They look a little farther than those of the leaf before had to, and by so much farther where that is not enough.
FIRST_REACH_FACTOR, REACH_FACTOR = 1.15, 1.4
# A bound that leaves more than so many times what is wanted is lowered to leave so many times that, about.
MAX_KEPT_RATIO, AIMED_KEPT_RATIO = 1.5, 1.25
# The square of a bound is rounded up, so that nothing within it is lost.
WIDER = 1.0 + 1e-12


@compiled
def own_neighbours(
    first: int,
    last: int,
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    rows: IntArray,
    lines: IntArray,
    found: IntArray,
    distances: FloatArray,
) -> None:
    """Write rows of the k nearest points of those in leaves first to last, and how far they are: (m, k) each.

    They are those of `nearest_points`, in half of its time where many points of each leaf are asked about: O(k^2) a
    point. Each row has a line to write to, (n,), or -1 where it is not asked about. A line begins with -1 where nothing
    is known: there are too many others near a leaf, or too few within what it looks among.
    """
    stack, some, of_some = np.zeros(2 * DEEPEST, np.int64), np.zeros((3, MAX_PLACES)), np.zeros(MAX_PLACES, np.int64)
    squares, near, at = np.zeros(MAX_PLACES), np.zeros(MAX_PLACES + LANES), np.zeros(MAX_PLACES + 1, np.int64)
    order = np.zeros(MAX_PLACES, np.int64)
    half, reach = len(boxes) // 2, 0.0
    for node in range(half + first, half + last):
        start, end, asked, farthest = (node - half) * leaf, min((node - half + 1) * leaf, len(places)), 0, -1.0
        for t in range(start, end):
            asked += lines[rows[t]] >= 0
        if asked == 0:
            continue
        if not reach > 0.0:
            for axis in range(3):
                reach = max(reach, boxes[node, 3 + axis] - boxes[node, axis])
        for _ in range(MAX_TRIES):
            count = _gathered(boxes, places, leaf, node, reach * reach * WIDER, stack, some, of_some)
            if count < 0:
                break
            farthest = 0.0
            for t in range(start, end):
                line = lines[rows[t]]
                if line >= 0 and farthest >= 0.0:
                    kept = _kept(places, t, count, reach * reach, found.shape[1], some, squares, near, at)
                    ranked = _ranked(kept, near, at, of_some, rows, order, line, found, distances)
                    farthest = max(farthest, ranked) if ranked >= 0.0 else -1.0
            if farthest >= 0.0:
                break
            reach *= REACH_FACTOR
        reach = FIRST_REACH_FACTOR * max(farthest, 0.0)
        for t in range(start, end):
            if farthest < 0.0 and lines[rows[t]] >= 0:
                found[lines[rows[t]], 0] = -1


@inside_kernels
def _gathered(
    boxes: FloatArray,
    places: FloatArray,
    leaf: int,
    asking: int,
    limit: float,
    stack: IntArray,
    some: FloatArray,
    of_some: IntArray,
) -> int:
    """Write the places of the leaves within the root of a limit of one, axis by axis; how many, or -1 for too many."""
    n, half, count, waiting = len(places), len(boxes) // 2, 0, 1
    stack[0] = 1
    while waiting > 0:
        waiting -= 1
        node, square = stack[U(waiting)], 0.0
        for axis in range(3):
            gap = max(boxes[node, axis] - boxes[asking, 3 + axis], boxes[asking, axis] - boxes[node, 3 + axis])
            square += max(gap, 0.0) ** 2
        if square > limit:
            continue
        if node < half:
            stack[U(waiting)], stack[U(waiting + 1)] = 2 * node + 1, 2 * node
            waiting += 2
            continue
        if count + leaf > MAX_PLACES:
            return -1
        for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
            for axis in range(3):
                some[axis, U(count)] = places[U(t), axis]
            of_some[U(count)] = t
            count += 1
    return count


@inside_kernels
def _kept(
    places: FloatArray,
    asking: int,
    count: int,
    limit: float,
    wanted: int,
    some: FloatArray,
    squares: FloatArray,
    near: FloatArray,
    at: IntArray,
) -> int:
    """Write the squared distances of the nearest places, more than wanted where they are within a limit, and which."""
    x, y, z = places[asking, 0], places[asking, 1], places[asking, 2]
    for j in range(count):
        dx, dy, dz = some[0, j] - x, some[1, j] - y, some[2, j] - z
        squares[j] = dx * dx + dy * dy + dz * dz
    within = _within(squares, count, limit)
    while within > MAX_KEPT_RATIO * wanted:
        lower = limit * (AIMED_KEPT_RATIO * wanted / within)
        left = _within(squares, count, lower)
        if left < wanted or left == within:
            break
        limit, within = lower, left
    kept = 0
    for j in range(count):
        # Written each time: which are within is as good as random.
        near[U(kept)], at[U(kept)] = squares[U(j)], j
        kept += 1 if squares[U(j)] <= limit else 0
    return kept


@inside_kernels
def _within(squares: FloatArray, count: int, limit: float) -> int:
    """How many of the first squares are within a limit."""
    within = 0
    for j in range(count):
        within += 1 if squares[j] <= limit else 0
    return within


@inside_kernels
def _ranked(
    kept: int,
    near: FloatArray,
    at: IntArray,
    of_some: IntArray,
    rows: IntArray,
    order: IntArray,
    line: int,
    found: IntArray,
    distances: FloatArray,
) -> float:
    """Write rows of the nearest of those kept, and how far they are, closest first; how far the last is, -1 for none.

    The rank of each is how many are nearer; of equally near ones those with lower rows come first.
    """
    wanted, padded = found.shape[1], kept + (-kept) % LANES
    if kept < wanted:
        return -1.0
    for j in range(kept, padded):
        near[j] = np.inf
    for j in range(kept):
        order[j] = -1
    for i in range(kept):
        square, rank = near[i], 0
        for j in range(padded):
            rank += 1 if near[j] < square else 0
        # As many ranks as there are equally near ones are free from there on.
        j = first = rank
        while order[U(j)] >= 0:
            j += 1
        order[U(j)] = i
        while j > first and rows[of_some[at[order[U(j - 1)]]]] > rows[of_some[at[i]]]:
            order[U(j)], order[U(j - 1)] = order[U(j - 1)], i
            j -= 1
    for j in range(wanted):
        k = U(order[U(j)])
        found[line, j], distances[line, j] = rows[U(of_some[U(at[k])])], np.sqrt(near[k])
    return float(distances[line, wanted - 1])
