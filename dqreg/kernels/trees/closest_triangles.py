"""Closest points on a tree of triangles, with a bound and a first guess."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.trees.triangle import closest_on, height_square
from dqreg.kernels.trees.triangles_across import walk_across

DEEPEST = 96  # no tree of boxes that fits into memory is deeper
# Two faces are equally near within this share of a squared distance, or within this square of the size.
EQUAL_SHARE, ROUNDING_SHARE = 2e-12, 1e-30
# Then the one counts that the query stands higher above, by this share; without that rule rounding would choose the
# normal beside every edge.
EQUAL_HEIGHT_SHARE = 1e-6
# Equals looked at for one query: at the tip of a fan of thousands of needles there are thousands.
MAX_EQUAL_FACES = 64
# A search begins at the box of its first guess, or at one above it that is that many times as long as the guess is far:
# from the box of a guess that is no neighbour it would look at everything in between.
FIRST_BOX_DISTANCES = 6.0
# What stands between brackets counts from the end where it is below zero, which each access asks of a signed number:
# five per cent of a query. Guesses may be -1, and stay signed.
U = np.uint64


@inside_kernels
def box_distance(box: FloatArray, j: int, x: float, y: float, z: float) -> float:
    """Squared distance from a point to box j; 0 inside."""
    k = U(j)
    dx = max(box[k, 0] - x, x - box[k, 3], 0.0)
    dy = max(box[k, 1] - y, y - box[k, 4], 0.0)
    dz = max(box[k, 2] - z, z - box[k, 5], 0.0)
    square: float = dx * dx + dy * dy + dz * dz
    return square


@inside_kernels
def box_above(nodes: FloatArray, links: IntArray, j: int, square: float) -> int:
    """Box j, or the first one above it whose squared diagonal is no less than a square. O(log n)."""
    while j > 0:
        k = U(j)
        dx, dy, dz = nodes[k, 3] - nodes[k, 0], nodes[k, 4] - nodes[k, 1], nodes[k, 5] - nodes[k, 2]
        if dx * dx + dy * dy + dz * dz >= square:
            break
        j = links[k, 2]
    return j


@inside_kernels
def box_beside(
    nodes: FloatArray, links: IntArray, low: int, x: float, y: float, z: float, reach: float
) -> tuple[int, int]:
    """Box beside a box, or beside one above it, that is within reach, and the box that holds both; 0 where none is."""
    while low > 0:
        # Children follow each other, the first one odd.
        node, low = low + 1 if low & 1 else low - 1, links[U(low), 2]
        if not box_distance(nodes, node, x, y, z) >= reach:
            return node, low
    return low, low


@inside_kernels
def is_before(
    packed: FloatArray, faces: IntArray, t: int, other: int, x: float, y: float, z: float, floor: float
) -> bool:
    """Whether of two triangles equally near the first counts: the query is higher above it, or its number is lower."""
    mine, its = height_square(packed, t, x, y, z), height_square(packed, other, x, y, z)
    if abs(mine - its) > EQUAL_HEIGHT_SHARE * max(mine, its) + floor:
        return bool(mine > its)
    return bool(faces[t] < faces[other])


@compiled
def closest_places(
    first: int,
    last: int,
    nodes: FloatArray,
    links: IntArray,
    packed: FloatArray,
    across: IntArray,
    faces: IntArray,
    slots: IntArray,
    leaves: IntArray,
    face_normals: FloatArray,
    queries: FloatArray,
    guesses: IntArray,
    bound: float,
    size: float,
    points: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    found: IntArray,
) -> None:
    """Write the closest place nearer than ``bound`` for queries first to last: NaN, inf and -1 where there is none.

    Guesses are faces to begin with, one a query, or none at all: then each query begins with the face of the one before
    it. From there it walks across sides while it comes nearer, and from the box of where that ends the search goes on
    to those beside the boxes above. O(log n) boxes for a query near the surface, half as many as from the first box,
    and the processor foresees that few are near. The search is in one function: a call for each query would be a tenth
    of its time.
    """
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    floor = ROUNDING_SHARE * size * size
    none = len(stack) - DEEPEST - 1  # a literal -1 would be a type of its own, and what takes it compiled twice
    slot = none
    for i in range(first, last):
        x, y, z, low = queries[i, 0], queries[i, 1], queries[i, 2], 0
        if len(guesses) > 0:
            slot = slots[guesses[i]]
        best, reach, u, v = bound * bound, bound * bound, 0.0, 0.0
        if slot >= 0:
            slot, d, a, b = walk_across(packed, across, slot, x, y, z)
            low = box_above(nodes, links, leaves[U(slot)], FIRST_BOX_DISTANCES * FIRST_BOX_DISTANCES * d)
            if d < reach:
                # What is farther than the guess is not looked at from the first box on.
                best, u, v = d, a, b
                border = u == 0.0 or v == 0.0 or u + v >= 1.0
                reach = best + (best * EQUAL_SHARE + floor if border else 0.0)
            else:
                slot = none
        node, waiting, equals = low, 0, 0
        while True:
            near = links[U(node), 0]
            if links[U(node), 1] > 0:
                for t in range(near, near + links[U(node), 1]):
                    if t == slot:
                        continue
                    d, a, b = closest_on(packed, t, x, y, z)
                    if not d < reach:
                        continue
                    # Within reach but not nearer by more than rounding it is an equal, unless nothing was found so far.
                    if slot >= 0 and d > best - (best * EQUAL_SHARE + floor):
                        equals += 1
                        if is_before(packed, faces, t, slot, x, y, z, floor):
                            slot, u, v = t, a, b
                        best = min(best, d)
                    else:
                        best, slot, u, v = d, t, a, b
                    # Only on its border has a face equals; boxes of its neighbours in one plane are as near as itself.
                    border = u == 0.0 or v == 0.0 or u + v >= 1.0
                    reach = best + (best * EQUAL_SHARE + floor if border and equals < MAX_EQUAL_FACES else 0.0)
            else:
                far = near + 1
                d0, d1 = box_distance(nodes, near, x, y, z), box_distance(nodes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                if d0 < reach:
                    if d1 < reach:
                        stack[U(waiting)], away[U(waiting)] = far, d1
                        waiting += 1
                    node = near
                    continue
            while waiting > 0 and away[U(waiting - 1)] >= reach:
                waiting -= 1
            if waiting > 0:
                waiting -= 1
                node = stack[U(waiting)]
                continue
            node, low = box_beside(nodes, links, low, x, y, z, reach)
            if node == 0:
                break
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
