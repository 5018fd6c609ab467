"""How far many poses put the same points from a tree of triangles: no places, and nothing of faces equally near."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.closest_triangles import DEEPEST, FIRST_BOX_DISTANCES, U, box_above, box_beside, box_distance
from dqreg.kernels.trees.triangle import closest_on
from dqreg.kernels.trees.triangles_across import walk_across


@compiled
def pose_distances(
    first: int,
    last: int,
    nodes: FloatArray,
    links: IntArray,
    packed: FloatArray,
    across: IntArray,
    faces: IntArray,
    leaves: IntArray,
    face_normals: FloatArray,
    rotations: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    bound: float,
    by_point: bool,
    distances: FloatArray,
) -> None:
    """Write distances of m points under each of n poses, (n m,), inf where none is below ``bound``: first to last.

    As `closest_places` has them, whose search this is; each query begins with the face of the one before it: in the
    order of the poses, or, by point, of one point under all of them, which is sooner done where they follow each other.
    """
    stack, away, count = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST), len(points)
    none = len(stack) - DEEPEST - 1
    slot = none
    for i in range(first, last):
        k, j = (i % len(shifts), i // len(shifts)) if by_point else (i // count, i % count)
        at, p, q, s = k * count + j, points[j, 0], points[j, 1], points[j, 2]
        r, t = rotations[k], shifts[k]
        x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + t[0]
        y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + t[1]
        z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + t[2]
        best, u, v, low = bound * bound, 0.0, 0.0, 0
        if slot >= 0:
            slot, d, a, b = walk_across(packed, across, slot, x, y, z)
            low = box_above(nodes, links, leaves[U(slot)], FIRST_BOX_DISTANCES * FIRST_BOX_DISTANCES * d)
            if d < best:
                best, u, v = d, a, b
            else:
                slot = none
        node, waiting = low, 0
        while True:
            near = links[U(node), 0]
            if links[U(node), 1] > 0:
                for other in range(near, near + links[U(node), 1]):
                    if other == slot:
                        continue
                    d, a, b = closest_on(packed, other, x, y, z)
                    if d < best:
                        best, slot, u, v = d, other, a, b
            else:
                far = near + 1
                d0, d1 = box_distance(nodes, near, x, y, z), box_distance(nodes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                if d0 < best:
                    if d1 < best:
                        stack[U(waiting)], away[U(waiting)] = far, d1
                        waiting += 1
                    node = near
                    continue
            while waiting > 0 and away[U(waiting - 1)] >= best:
                waiting -= 1
            if waiting > 0:
                waiting -= 1
                node = stack[U(waiting)]
                continue
            node, low = box_beside(nodes, links, low, x, y, z, best)
            if node == 0:
                break
        if slot < 0:
            distances[at] = np.inf
        elif u > 0.0 and v > 0.0 and u + v < 1.0:
            f = faces[U(slot)]
            x, y, z = x - packed[slot, 0], y - packed[slot, 1], z - packed[slot, 2]
            distances[at] = abs(face_normals[f, 0] * x + face_normals[f, 1] * y + face_normals[f, 2] * z)
        else:
            distances[at] = np.sqrt(best)
