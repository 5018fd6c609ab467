"""Corners of triangles that are one corner of a smooth surface: at one vertex, in one group of faces."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.components import unite


@compiled
def smooth_corners(
    normals: FloatArray, neighbours: IntArray, least: float, vertices: IntArray, count: int, numbers: IntArray
) -> int:
    """Write the number of each corner, (f, 3); corners have one number where vertex and group are one.

    Faces are in one group where a chain of neighbours joins them whose unit normals have cosines of ``least`` or more.
    Returns how many numbers there are. O(f + count), nearly.

    Shapes: normals, neighbours and vertices (f, 3), vertices below ``count``.
    """
    n = len(normals)
    groups = np.zeros(n, np.int64)
    for f in range(n):
        groups[f] = f
    for f in range(n):
        for k in range(3):
            g = neighbours[f, k]
            if normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2] < least:
                continue
            unite(groups, f, g)
    for f in range(n):
        # A root comes before all of its group, so that it is known.
        groups[f] = groups[groups[f]]
    starts, order = np.zeros(count + 1, np.int64), np.zeros(3 * n, np.int64)
    for f in range(n):
        for k in range(3):
            starts[vertices[f, k] + 1] += 1
    for v in range(count):
        starts[v + 1] += starts[v]
    for c in range(3 * n):
        vertex = vertices[c // 3, c % 3]
        order[starts[vertex]] = c
        starts[vertex] += 1
    # Vertex at which each group was met last, counted from one, and its number there.
    met, known, found = np.zeros(n, np.int64), np.zeros(n, np.int64), 0
    for i in range(3 * n):
        f, k = order[i] // 3, order[i] % 3
        group, vertex = groups[f], vertices[f, k]
        if met[group] != vertex + 1:
            met[group], known[group] = vertex + 1, found
            found += 1
        numbers[f, k] = known[group]
    return found
