"""One triangle: the place on it that is closest to a point."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Columns of a packed triangle: first corner, the sides from it to the second and third, and their products.
COLUMNS = 12


@compiled
def pack(
    first: int,
    last: int,
    corners: FloatArray,
    faces: IntArray,
    links: IntArray,
    leaves: IntArray,
    packed: FloatArray,
    slots: IntArray,
    nodes: FloatArray,
) -> None:
    """Write the triangles of slots first to last, (n, 12), zeros; the slot of each; and the boxes of their leaves.

    A leaf is written where its first slot is. O(n). Shapes: corners (m, 3, 3), faces and leaves of the slots (n,),
    slots (m,), nodes (k, 6).
    """
    for i in range(first, last):
        o, node = faces[i], leaves[i]
        slots[o] = i
        for k in range(3):
            a, b, c = corners[o, 0, k], corners[o, 1, k], corners[o, 2, k]
            packed[i, k], packed[i, 3 + k], packed[i, 6 + k] = a, b - a, c - a
        for k in range(3):
            packed[i, 9] += packed[i, 3 + k] * packed[i, 3 + k]
            packed[i, 10] += packed[i, 3 + k] * packed[i, 6 + k]
            packed[i, 11] += packed[i, 6 + k] * packed[i, 6 + k]
        if links[node, 0] != i:
            continue
        for k in range(3):
            low, high = np.inf, -np.inf
            for other in range(i, i + links[node, 1]):
                f = faces[other]
                for corner in range(3):
                    low, high = min(low, corners[f, corner, k]), max(high, corners[f, corner, k])
            nodes[node, k], nodes[node, 3 + k] = low, high


@inside_kernels
def closest_on(packed: FloatArray, t: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Squared distance from a point and the place ``a + u (b - a) + v (c - a)``: Ericson 2005, section 5.1.5."""
    # See `closest_triangles.U`.
    k = np.uint64(t)
    ax, ay, az = x - packed[k, 0], y - packed[k, 1], z - packed[k, 2]
    bx, by, bz, cx, cy, cz = packed[k, 3], packed[k, 4], packed[k, 5], packed[k, 6], packed[k, 7], packed[k, 8]
    bb, bc, cc = packed[k, 9], packed[k, 10], packed[k, 11]
    d1 = bx * ax + by * ay + bz * az
    d2 = cx * ax + cy * ay + cz * az
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    u = v = 0.0
    if d1 > 0.0 or d2 > 0.0:
        if d3 >= 0.0 and d4 <= d3:
            u = 1.0
        elif d6 >= 0.0 and d5 <= d6:
            v = 1.0
        else:
            vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
            if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
                u = d1 / bb
            elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
                v = d2 / cc
            elif va <= 0.0 and d4 >= d3 and d5 >= d6:
                v = (d4 - d3) / ((d4 - d3) + (d5 - d6))
                u = 1.0 - v
            else:
                share = 1.0 / (va + vb + vc)
                u, v = vb * share, vc * share
    gx, gy, gz = ax - u * bx - v * cx, ay - u * by - v * cy, az - u * bz - v * cz
    return gx * gx + gy * gy + gz * gz, u, v


@inside_kernels
def height_square(packed: FloatArray, t: int, x: float, y: float, z: float) -> float:
    """Square of the height of a point above the plane of a triangle; 0 for one without area."""
    bx, by, bz = packed[t, 3], packed[t, 4], packed[t, 5]
    cx, cy, cz = packed[t, 6], packed[t, 7], packed[t, 8]
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    height = nx * (x - packed[t, 0]) + ny * (y - packed[t, 1]) + nz * (z - packed[t, 2])
    square = nx * nx + ny * ny + nz * nz
    found: float = height * height / square if square > 0.0 else 0.0
    return found
