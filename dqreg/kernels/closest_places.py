"""Closest points on triangles: from the short lists of cells where these are made, else from the tree."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.closest_triangles import DEEPEST, EQUAL, EQUALS, ROUNDING, descend, is_before
from dqreg.kernels.compiled import compiled
from dqreg.kernels.triangle import closest_on

# A first guess is a bound a little wider than its own distance, so that the search finds what it would find without.
WIDER = 1.0 + 1e-9
# Cells along each edge of a brick, as a power of two, and in all of it.
BITS, BRICK = 3, 512
# Edges from the surface beyond which no cell is asked for.
FAR = 2.0


@compiled
def cell_of(frame: FloatArray, shape: IntArray, x: float, y: float, z: float) -> int:
    """Number of the cell that a place is in, by bricks; -1 outside."""
    a, b, c = (x - frame[0]) * frame[4], (y - frame[1]) * frame[4], (z - frame[2]) * frame[4]
    side = 1 << BITS
    if not (0.0 <= a < shape[0] * side and 0.0 <= b < shape[1] * side and 0.0 <= c < shape[2] * side):
        return -1
    i, j, k = int(a), int(b), int(c)
    brick = ((i >> BITS) * shape[1] + (j >> BITS)) * shape[2] + (k >> BITS)
    inside = (((i & (side - 1)) << BITS | (j & (side - 1))) << BITS) | (k & (side - 1))
    number: int = brick * BRICK + inside
    return number


@compiled
def closest_of_list(
    packed: FloatArray,
    faces: IntArray,
    slots: IntArray,
    floors: FloatArray,
    first: int,
    last: int,
    off: float,
    x: float,
    y: float,
    z: float,
    best: float,
    floor: float,
) -> tuple[float, int, float, float]:
    """`descend` among the faces of a list, from a place so far off the middle of its cell."""
    u, v, reach, equals = 0.0, 0.0, best, 0
    slot = equals - 1  # no literal, as in `descend`
    for j in range(first, last):
        gap = floors[j] - off
        if gap > 0.0 and gap * gap > reach:
            break
        t = slots[j]
        d, a, b = closest_on(packed, t, x, y, z)
        if d >= reach:
            continue
        if slot >= 0 and d > best - (best * EQUAL + floor):
            equals += 1
            if is_before(packed, faces, t, slot, x, y, z, floor):
                slot, u, v = t, a, b
            best = min(best, d)
        else:
            best, slot, u, v = d, t, a, b
        reach = best + (best * EQUAL + floor if equals < EQUALS else 0.0)
    return best, slot, u, v


@compiled
def closest_places(
    first: int,
    last: int,
    boxes: FloatArray,
    packed: FloatArray,
    leaf: int,
    faces: IntArray,
    slots: IntArray,
    face_normals: FloatArray,
    queries: FloatArray,
    guesses: IntArray,
    bound: float,
    size: float,
    frame: FloatArray,
    shape: IntArray,
    top: IntArray,
    bricks: IntArray,
    heads: IntArray,
    cell_slots: IntArray,
    floors: FloatArray,
    wanted: IntArray,
    points: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    found: IntArray,
) -> None:
    """Write the closest place nearer than ``bound`` for queries first to last: NaN, inf and -1 where there is none.

    Guesses are faces to begin with, one a query, or none at all: then each query begins with the face of the one
    before it. The cells are those of `Made`; ``wanted``, (n,), takes those that were not made and would have served, or
    is of no row where none is asked.
    """
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    slot, floor, edge = -1, ROUNDING * size * size, frame[3]
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        most = best = bound * bound
        cell = cell_of(frame, shape, x, y, z) if len(wanted) else -1
        row = top[cell >> (3 * BITS)] if 0 <= cell < len(top) * BRICK else -1
        state = bricks[row, cell & (BRICK - 1)] if row >= 0 else 0
        if 0 < state <= shape[3]:
            head, end = heads[state - 1], heads[state]
            # How far it is off the middle of the cell.
            dx = (x - frame[0]) * frame[4]
            dy = (y - frame[1]) * frame[4]
            dz = (z - frame[2]) * frame[4]
            dx, dy, dz = dx - np.floor(dx) - 0.5, dy - np.floor(dy) - 0.5, dz - np.floor(dz) - 0.5
            off = edge * np.sqrt(dx * dx + dy * dy + dz * dz)
            best, slot, u, v = closest_of_list(packed, faces, cell_slots, floors, head, end, off, x, y, z, best, floor)
        else:
            if len(guesses):
                slot = slots[guesses[i]]
            if slot >= 0:
                best = min(best, closest_on(packed, slot, x, y, z)[0] * WIDER + 2.0 * floor)
            best, slot, u, v = descend(boxes, packed, leaf, faces, x, y, z, best, floor, stack, away)
            if slot < 0 and best < most:
                # Very near to the guess, its distance and that of its box differ by more than either is of itself.
                best, slot, u, v = descend(boxes, packed, leaf, faces, x, y, z, most, floor, stack, away)
            if cell >= 0:
                wanted[i] = cell if state == 0 and slot >= 0 and best <= FAR * FAR * edge * edge else -1
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
