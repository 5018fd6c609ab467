"""Boundary and interior of points in a plane: their density, what is beside each, and which have others all around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.trees.nearest_points import U

Rows = NDArray[np.int32]
# What is certain of a place by its distance is so after rounding too.
RELATIVE_ROUNDING = 1e-9


@compiled
def near_fractions(
    first: int, last: int, lines: IntArray, table: Rows, count: int, near: BoolArray, shares: FloatArray
) -> None:
    """Write the share of so many neighbours that is near, for places first to last. O(k) a place.

    Shapes: lines (m,) of the table, (l, k), of rows of a cloud; near (n,), shares (m,).
    """
    count = min(count, table.shape[1])
    for i in range(first, last):
        held, line = 0, U(lines[i])
        for j in range(count):
            held += near[U(table[line, U(j)])]
        shares[i] = held / count


@compiled
def in_plane_sq_distances(
    points: FloatArray, heights: FloatArray, rows: IntArray, asked: IntArray, window: int, last: int, found: FloatArray
) -> None:
    """Write the square of the distance in the plane from the rows asked to one of those next to each, so many of them.

    To the nearest but ``last`` others of the window: the point itself is in it. O(window last) a row. Shapes: points
    (n, 3), heights over the plane (n,), rows of these (m,), asked (k,) of those, found (k,).
    """
    nearest = np.zeros(last + 1)
    for i in range(len(asked)):
        own, first = rows[asked[i]], max(min(asked[i] - window // 2, len(rows) - window), 0)
        nearest[:] = np.inf
        for t in range(first, first + window):
            # Along the plane: what is left without the difference in height.
            square, j = -((heights[rows[t]] - heights[own]) ** 2), last
            for k in range(3):
                square += (points[rows[t], k] - points[own, k]) ** 2
            if not square < nearest[last]:
                continue
            while j > 0 and square < nearest[j - 1]:
                nearest[j] = nearest[j - 1]
                j -= 1
            nearest[j] = square
        found[i] = nearest[last]


@compiled
def interior_rows(
    first: int,
    last: int,
    asked: IntArray,
    flat: FloatArray,
    held: IntArray,
    places: IntArray,
    points: FloatArray,
    lines: IntArray,
    table: Rows,
    beside: int,
    count: int,
    thick: float,
    cosine: float,
    found: BoolArray,
) -> None:
    """Write which of the points asked have others all around, no wider angle without any than an obtuse one's cosine.

    By the first neighbours in space, so many, itself among them; else by those that are among so many nearest in the
    plane for certain: whatever is no neighbour in space is as far from the point as the last of these, and in the plane
    by less only as far as the two stand on different heights, which is at most how thick the plane is. O(k) a point.

    Shapes: asked (m,), rows of flat, (n, 2), the points in the plane; held (n,), their rows in the cloud, and places
    (N,), the way back, -1 for none; points (N, 3); lines (m,) of the table, (l, k), of neighbours, closest first.
    """
    most = min(count, table.shape[1])
    arms = np.zeros((3, most))
    for i in range(first, last):
        known = _neighbour_arms(flat, asked[i], places, table, lines[i], min(beside, most), np.inf, arms)
        found[i] = _no_wide_gap(arms, known, cosine)
        if found[i]:
            continue
        own, end, square = held[asked[i]], table[lines[i], most - 1], 0.0
        for k in range(3):
            square += (points[end, k] - points[own, k]) ** 2
        limit = (1.0 - RELATIVE_ROUNDING) * square - (1.0 + RELATIVE_ROUNDING) * thick * thick
        if limit > 0.0:
            known = _neighbour_arms(flat, asked[i], places, table, lines[i], most, limit, arms)
            found[i] = _no_wide_gap(arms, known, cosine)


@inside_kernels
def _neighbour_arms(
    flat: FloatArray, own: int, places: IntArray, table: Rows, line: int, count: int, limit: float, arms: FloatArray
) -> int:
    """Write x, y and square of the arms from a place to those of its first neighbours nearer than a limit, squared.

    Returns how many they are.
    """
    known = 0
    for j in range(1, count):
        place = places[U(table[U(line), U(j)])]
        if place < 0:
            continue
        x, y = flat[U(place), 0] - flat[U(own), 0], flat[U(place), 1] - flat[U(own), 1]
        square = x * x + y * y
        if not square < limit:
            continue
        if square == 0.0:
            # What stands above the point has the direction that `arctan2` gives it.
            x, square = 1.0, 1.0
        arms[0, U(known)], arms[1, U(known)], arms[2, U(known)] = x, y, square
        known += 1
    return known


@inside_kernels
def _no_wide_gap(arms: FloatArray, known: int, cosine: float) -> bool:
    """Whether after each of so many arms, (3, k), another one follows within an obtuse angle, counterclockwise.

    A walk in steps of no wider an angle passes over no wider one: it comes round, or ends before it. O(k).
    """
    now = 0
    for _ in range(known):
        x, y, length, follows = arms[0, U(now)], arms[1, U(now)], cosine * cosine * arms[2, U(now)], known
        for j in range(known):
            u, v = arms[0, U(j)], arms[1, U(j)]
            along = x * u + y * v
            if (x * v - y * u > 0.0) & ((along >= 0.0) | (along * along <= length * arms[2, U(j)])):
                follows = j
                break
        if follows == known:
            return False
        if follows == 0:
            return True
        now = follows
    return known > 0
