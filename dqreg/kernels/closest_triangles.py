"""The closest triangle of a tree to a place."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.triangle import closest_on, height_square

DEEPEST = 64  # no balanced heap that fits into memory is deeper
# Two faces are equally near within this share of a squared distance, or within this square of the size. Then the one
# counts that the query stands higher above; without that rule rounding would choose the normal beside every edge.
EQUAL, LEVEL, ROUNDING = 2e-12, 1e-6, 1e-30
# Equals looked at for one query: at the tip of a fan of thousands of needles there are thousands.
EQUALS = 64


@compiled
def box_distance(box: FloatArray, j: int, x: float, y: float, z: float) -> float:
    """Squared distance from a point to box j; 0 inside."""
    dx = max(box[j, 0] - x, x - box[j, 3], 0.0)
    dy = max(box[j, 1] - y, y - box[j, 4], 0.0)
    dz = max(box[j, 2] - z, z - box[j, 5], 0.0)
    square: float = dx * dx + dy * dy + dz * dz
    return square


@compiled
def descend(
    boxes: FloatArray,
    packed: FloatArray,
    leaf: int,
    faces: IntArray,
    x: float,
    y: float,
    z: float,
    best: float,
    floor: float,
    stack: IntArray,
    away: FloatArray,
) -> tuple[float, int, float, float]:
    """The closest triangle nearer than ``best``: squared distance, slot (-1 for none), u and v.

    O(log n) boxes for a query near the surface. ``floor`` is the square of a length that is rounding.
    """
    half, n = len(boxes) // 2, len(packed)
    node, waiting, u, v = 1, 0, 0.0, 0.0
    slot = waiting - 1  # a literal -1 would be a type of its own, and what takes it compiled twice
    reach, equals = best, 0
    while True:
        if node >= half:
            for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                d, a, b = closest_on(packed, t, x, y, z)
                if d >= reach:
                    continue
                # Within reach but not nearer by more than rounding it is an equal, unless nothing was found so far.
                if slot >= 0 and d > best - (best * EQUAL + floor):
                    equals += 1
                    if is_before(packed, faces, t, slot, x, y, z, floor):
                        slot, u, v = t, a, b
                    best = min(best, d)
                else:
                    best, slot, u, v = d, t, a, b
                reach = best + (best * EQUAL + floor if equals < EQUALS else 0.0)
        else:
            near, far = 2 * node, 2 * node + 1
            d0, d1 = box_distance(boxes, near, x, y, z), box_distance(boxes, far, x, y, z)
            if d1 < d0:
                near, far, d0, d1 = far, near, d1, d0
            if d0 < reach:
                if d1 < reach:
                    stack[waiting], away[waiting] = far, d1
                    waiting += 1
                node = near
                continue
        while waiting > 0 and away[waiting - 1] >= reach:
            waiting -= 1
        if waiting == 0:
            return best, slot, u, v
        waiting -= 1
        node = stack[waiting]


@compiled
def is_before(
    packed: FloatArray, faces: IntArray, t: int, other: int, x: float, y: float, z: float, floor: float
) -> bool:
    """Whether of two triangles equally near the first counts: the query is higher above it, or its number is lower."""
    mine, its = height_square(packed, t, x, y, z), height_square(packed, other, x, y, z)
    if abs(mine - its) > LEVEL * max(mine, its) + floor:
        return bool(mine > its)
    return bool(faces[t] < faces[other])
