"""Neighbourhoods of points that lie to one side of them: the rim of a cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.clouds.plane_fits import ELEMENTS, diagonalise
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

Rows = NDArray[np.int32]


@compiled
def one_sided_rows(
    first: int,
    last: int,
    points: FloatArray,
    rows: IntArray,
    neighbours: Rows,
    farthest: FloatArray,
    normals: FloatArray,
    share: float,
    line: float,
    found: BoolArray,
) -> None:
    """Write which of some rows of a cloud, first to last, have their neighbours to one side, off any line. O(k) a row.

    To one side: their mean is farther off within the plane than a share of the farthest one. Shapes: points (n, 3),
    rows (m,), neighbours (m, k) with the point itself first, farthest (m,), normals (m, 3), found (m,).
    """
    count, a, v = neighbours.shape[1] - 1, np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        x, y, z = points[rows[i], 0], points[rows[i], 1], points[rows[i], 2]
        mx = my = mz = 0.0
        for j in range(1, count + 1):
            t = neighbours[i, j]
            mx, my, mz = mx + points[t, 0] - x, my + points[t, 1] - y, mz + points[t, 2] - z
        mx, my, mz = mx / count, my / count, mz / count
        height = mx * normals[i, 0] + my * normals[i, 1] + mz * normals[i, 2]
        dx, dy, dz = mx - height * normals[i, 0], my - height * normals[i, 1], mz - height * normals[i, 2]
        # By the mean first: the shape is computed only where it matters.
        found[i] = np.sqrt(dx * dx + dy * dy + dz * dz) > share * farthest[i] and not is_line(
            points, neighbours, i, line, a, v
        )


@compiled
def known_rims(rows: IntArray, is_rim: BoolArray, known: BoolArray, found: BoolArray, lines: IntArray) -> int:
    """Write which rows are of the rim, (m,), where it is known, and the lines of the others; returns how many. O(m).

    Of equal rows that follow each other the first alone.
    """
    count, before = 0, -1
    for i in range(len(rows)):
        row = rows[i]
        found[i] = is_rim[row]
        if not known[row] and row != before:
            lines[count] = i
            count += 1
        before = row
    return count


@compiled
def line_rows(first: int, last: int, points: FloatArray, neighbours: Rows, line: float, found: BoolArray) -> None:
    """Write which neighbourhoods, first to last, lie along a line: (m, k) rows of points, the point itself first."""
    a, v = np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        found[i] = is_line(points, neighbours, i, line, a, v)


@inside_kernels
def is_line(points: FloatArray, neighbours: Rows, i: int, line: float, a: FloatArray, v: FloatArray) -> bool:
    """Whether the second variance of neighbours i is at most a share of the first; a and v are room to work in."""
    count = neighbours.shape[1] - 1
    mx = my = mz = 0.0
    for j in range(1, count + 1):
        t = neighbours[i, j]
        mx, my, mz = mx + points[t, 0], my + points[t, 1], mz + points[t, 2]
    mx, my, mz = mx / count, my / count, mz / count
    for e in range(ELEMENTS):
        a[e] = 0.0
    for j in range(1, count + 1):
        t = neighbours[i, j]
        x, y, z = points[t, 0] - mx, points[t, 1] - my, points[t, 2] - mz
        a[0], a[1], a[2] = a[0] + x * x, a[1] + y * y, a[2] + z * z
        a[3], a[4], a[5] = a[3] + x * y, a[4] + x * z, a[5] + y * z
    diagonalise(a, v)
    low, high = min(a[0], a[1]), max(a[0], a[1])
    second, first = max(low, min(high, a[2])), max(high, a[2])
    return bool(second <= line * first)
