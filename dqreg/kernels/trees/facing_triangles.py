"""Closest points on those triangles of a tree that look to a direction."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.trees.closest_triangles import DEEPEST, U, box_distance
from dqreg.kernels.trees.triangle import closest_on


@compiled
def facing_places(
    first: int,
    last: int,
    nodes: FloatArray,
    links: IntArray,
    packed: FloatArray,
    faces: IntArray,
    face_normals: FloatArray,
    queries: FloatArray,
    directions: FloatArray,
    cosine: float,
    bound: float,
    points: FloatArray,
    distances: FloatArray,
    found: IntArray,
) -> None:
    """Write the closest place nearer than ``bound`` on faces whose normal has more than a cosine with a direction.

    Where there is none the distance stays infinite and the face -1. As `closest_places`, without a first guess: O(log
    n) boxes and those of the faces that look elsewhere.
    """
    stack, away = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        along, up, on = directions[i, 0], directions[i, 1], directions[i, 2]
        best = bound * bound
        waiting = 1
        stack[0], away[0] = 0, 0.0
        while waiting > 0:
            waiting -= 1
            if away[U(waiting)] >= best:
                continue
            node = stack[U(waiting)]
            near = links[U(node), 0]
            if links[U(node), 1] > 0:
                for t in range(near, near + links[U(node), 1]):
                    f = faces[t]
                    looks = face_normals[f, 0] * along + face_normals[f, 1] * up + face_normals[f, 2] * on
                    if not looks > cosine:
                        continue
                    d, u, v = closest_on(packed, t, x, y, z)
                    if d < best:
                        best, found[i], distances[i] = d, f, np.sqrt(d)
                        for k in range(3):
                            points[i, k] = packed[t, k] + (u * packed[t, 3 + k] + v * packed[t, 6 + k])
            else:
                far = near + 1
                d0, d1 = box_distance(nodes, near, x, y, z), box_distance(nodes, far, x, y, z)
                if d1 < d0:
                    near, far, d0, d1 = far, near, d1, d0
                # The nearer one is looked at first.
                if d1 < best:
                    stack[U(waiting)], away[U(waiting)] = far, d1
                    waiting += 1
                if d0 < best:
                    stack[U(waiting)], away[U(waiting)] = near, d0
                    waiting += 1
