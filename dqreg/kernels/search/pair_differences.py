"""Differences of points with equal normals, counted in the cells of a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def pair_differences(
    points: FloatArray,
    normals: FloatArray,
    limits: FloatArray,
    side: int,
    counts: NDArray[np.int32],
    asked: BoolArray,
    differences: FloatArray,
    cells: IntArray,
) -> int:
    """Count the differences of pairs in each cell; or, where cells are asked for, write those in them or opposite ones.

    Each pair is taken one way, the later point less the earlier one. Limits: least cosine of two equal normals, squares
    of the shortest and of the longest difference, and the size of a cell. Returns how many were written. Shapes:
    points, normals (n, 3), counts or asked (side^3,). O(n^2).
    """
    here, written = side * side * side // 2, 0
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            if not cosine > limits[0]:
                continue
            x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            square = x * x + y * y + z * z
            if not limits[1] < square < limits[2]:
                continue
            a, b, c = np.rint(x / limits[3]), np.rint(y / limits[3]), np.rint(z / limits[3])
            cell = (np.int64(a) * side + np.int64(b)) * side + np.int64(c) + here
            if len(asked) == 0:
                counts[cell] += 1
            elif asked[cell] or asked[2 * here - cell]:
                differences[written, 0], differences[written, 1], differences[written, 2] = x, y, z
                cells[written] = cell
                written += 1
    return written
