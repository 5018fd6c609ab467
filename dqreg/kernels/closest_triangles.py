"""Closest points on a tree of triangles, with a bound and a first guess."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.triangle import closest_on, height_square

DEEPEST = 96  # no tree of boxes that fits into memory is deeper
# Two faces are equally near within this share of a squared distance, or within this square of the size. Then the one
# counts that the query stands higher above; without that rule rounding would choose the normal beside every edge.
EQUAL, LEVEL, ROUNDING = 2e-12, 1e-6, 1e-30
# Equals looked at for one query: at the tip of a fan of thousands of needles there are thousands.
EQUALS = 64
# A first guess is a bound a little wider than its own distance, so that the search finds what it would find without.
WIDER = 1.0 + 1e-9
# Of so many queries a face, and more, neighbours mostly share a face: one of them looks around itself by so many of its
# steps, and those within the room that it finds up to the next face need no search. Where fewer than so many did, so
# many queries do without, twice as many each time up to the longest. The widest look, in spacings of evenly spread
# queries, finds few faces, and so many end it: at the tip of a fan there are thousands.
DENSE, STEPS, SERVED, WITHOUT, LONGEST, WIDEST, MANY = 2.0, 2.5, 2, 4, 128, 7.0, 256
# A face is nearer than the next by more than rounding on a needle.
CLEAR = 1.0 - 1e-6


@inside_kernels
def box_distance(box: FloatArray, j: int, x: float, y: float, z: float) -> float:
    """Squared distance from a point to box j; 0 inside."""
    dx = max(box[j, 0] - x, x - box[j, 3], 0.0)
    dy = max(box[j, 1] - y, y - box[j, 4], 0.0)
    dz = max(box[j, 2] - z, z - box[j, 5], 0.0)
    square: float = dx * dx + dy * dy + dz * dz
    return square


@inside_kernels
def farther(square: float, length: float) -> float:
    """Square of a distance that is longer by a length."""
    longer: float = square + length * (length + 2.0 * np.sqrt(square)) if length > 0.0 else square
    return longer


@inside_kernels
def descend(
    nodes: FloatArray,
    links: IntArray,
    packed: FloatArray,
    faces: IntArray,
    x: float,
    y: float,
    z: float,
    best: float,
    floor: float,
    around: float,
    stack: IntArray,
    away: FloatArray,
) -> tuple[float, int, float, float, float]:
    """The closest triangle nearer than ``best``: squared distance, slot (-1 for none), u and v; the next one's square.

    O(log n) boxes for a query near the surface. ``floor`` is the square of a length that is rounding. The next triangle
    is known as far as the closest and ``around`` beyond: no other is nearer. Where there are many, nothing is known.
    """
    node, waiting, u, v = 0, 0, 0.0, 0.0
    slot = waiting - 1  # a literal -1 would be a type of its own, and what takes it compiled twice
    reach, equals = best, 0
    wide, other, others, here = farther(best, around), np.inf, 0, 0.0
    while True:
        near = links[node, 0]
        if links[node, 1] > 0:
            # On a needle rounding may bring a face nearer than its box, which alone would not be looked at.
            is_beyond = here >= reach
            for t in range(near, near + links[node, 1]):
                d, a, b = closest_on(packed, t, x, y, z)
                if d >= reach or is_beyond:
                    others += 1
                    other = min(other, d) if others < MANY else 0.0
                    continue
                # Within reach but not nearer by more than rounding it is an equal, unless nothing was found so far.
                if slot >= 0 and d > best - (best * EQUAL + floor):
                    equals += 1
                    other = best
                    if is_before(packed, faces, t, slot, x, y, z, floor):
                        slot, u, v = t, a, b
                    best = min(best, d)
                else:
                    other = min(other, best) if slot >= 0 else other
                    best, slot, u, v = d, t, a, b
                # Only on its border has a face equals; boxes of its neighbours in one plane are as near as itself.
                border = u == 0.0 or v == 0.0 or u + v >= 1.0
                reach = best + (best * EQUAL + floor if border and equals < EQUALS else 0.0)
                wide = max(reach, farther(best, around)) if others < MANY else reach
        else:
            far = near + 1
            d0, d1 = box_distance(nodes, near, x, y, z), box_distance(nodes, far, x, y, z)
            if d1 < d0:
                near, far, d0, d1 = far, near, d1, d0
            if d0 < wide:
                if d1 < wide:
                    stack[waiting], away[waiting] = far, d1
                    waiting += 1
                node, here = near, d0
                continue
        while waiting > 0 and away[waiting - 1] >= wide:
            waiting -= 1
        if waiting == 0:
            return best, slot, u, v, min(other, wide)
        waiting -= 1
        node, here = stack[waiting], away[waiting]


@inside_kernels
def is_before(
    packed: FloatArray, faces: IntArray, t: int, other: int, x: float, y: float, z: float, floor: float
) -> bool:
    """Whether of two triangles equally near the first counts: the query is higher above it, or its number is lower."""
    mine, its = height_square(packed, t, x, y, z), height_square(packed, other, x, y, z)
    if abs(mine - its) > LEVEL * max(mine, its) + floor:
        return bool(mine > its)
    return bool(faces[t] < faces[other])


@inside_kernels
def length(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    found: float = np.sqrt(x * x + y * y + z * z)
    return found


@compiled
def closest_places(
    first: int,
    last: int,
    nodes: FloatArray,
    links: IntArray,
    packed: FloatArray,
    faces: IntArray,
    slots: IntArray,
    face_normals: FloatArray,
    queries: FloatArray,
    guesses: IntArray,
    bound: float,
    size: float,
    every: int,
    points: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    found: IntArray,
) -> None:
    """Write the closest place nearer than ``bound`` for queries first to last: NaN, inf and -1 where there is none.

    Guesses are faces to begin with, one a query, or none at all: then each query begins with the face of the one
    before it. The queries are a run of ``every`` many, evenly spread along a curve. O(log n) a query; O(1) within the
    room around one, where no other face is as near as its own.
    """
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    floor, most = ROUNDING * size * size, bound * bound
    widest = WIDEST * size / np.sqrt(every) if every >= DENSE * len(faces) else 0.0
    # The query that looked around, and how far the next face is from it; what it served, and how many go without.
    ax, ay, az, room, served, without = 0.0, 0.0, 0.0, -1.0, 0, 1
    pause = WITHOUT
    slot = served - 1  # see `descend`
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        left, best, u, v = room, np.inf, 0.0, 0.0
        if room >= 0.0:
            left -= length(x - ax, y - ay, z - az)
            best, u, v = closest_on(packed, slot, x, y, z)
            served += 1
        # No number is not within it.
        if not (left > 0.0 and best < min(left * left * CLEAR, most)):
            if room >= 0.0:
                is_worth = served > SERVED
                pause = WITHOUT if is_worth else min(2 * pause, LONGEST)
                without = 0 if is_worth else pause
            around = 0.0
            if widest > 0.0 and without == 0:
                step = length(x - queries[i - 1, 0], y - queries[i - 1, 1], z - queries[i - 1, 2])
                around = min(STEPS * step, widest)
            without = max(without - 1, 0)
            if len(guesses):
                slot = slots[guesses[i]]
            best = most
            if slot >= 0:
                best = min(best, closest_on(packed, slot, x, y, z)[0] * WIDER + 2.0 * floor)
            if best >= min(around * around, most):
                # Far from the guess there are many others as near.
                around = 0.0
            given = best
            best, slot, u, v, other = descend(nodes, links, packed, faces, x, y, z, best, floor, around, stack, away)
            if around > 0.0 and not (u > 0.0 and v > 0.0 and u + v < 1.0):
                around = 0.0
                best, slot, u, v, other = descend(nodes, links, packed, faces, x, y, z, given, floor, 0.0, stack, away)
            if slot < 0 and best < most:
                # Very near to the guess, its distance and that of its box differ by more than either is of itself.
                best, slot, u, v, other = descend(nodes, links, packed, faces, x, y, z, most, floor, 0.0, stack, away)
            ax, ay, az, room, served = x, y, z, np.sqrt(other) / WIDER if around > 0.0 else -1.0, 0
        if slot < 0:
            points[i], normals[i], distances[i], found[i] = np.nan, np.nan, np.inf, -1
            continue
        face = faces[slot]
        found[i] = face
        nx, ny, nz = face_normals[face, 0], face_normals[face, 1], face_normals[face, 2]
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
        if u > 0.0 and v > 0.0 and u + v < 1.0:
            # The height above the plane, and the foot by it, keep the digits that u and v lose on a needle.
            height = nx * (x - packed[slot, 0]) + ny * (y - packed[slot, 1]) + nz * (z - packed[slot, 2])
            points[i, 0], points[i, 1], points[i, 2] = x - height * nx, y - height * ny, z - height * nz
            distances[i] = abs(height)
        else:
            for k in range(3):
                points[i, k] = packed[slot, k] + (u * packed[slot, 3 + k] + v * packed[slot, 6 + k])
            distances[i] = np.sqrt(best)
