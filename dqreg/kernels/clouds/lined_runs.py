"""Neighbourhoods amid runs of points in an order of space: whether they are lines, and along which axes they lie."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.clouds.plane_fits import ELEMENTS, diagonalise
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@compiled
def lined_runs(
    first: int,
    last: int,
    points: FloatArray,
    order: IntArray,
    begins: IntArray,
    length: int,
    count: int,
    line: float,
    lined: BoolArray,
    axes: FloatArray,
    sums: FloatArray,
) -> None:
    """Write which points amid runs first to last have their neighbours along a line, and their least and longest axis.

    The nearest of the run, so many; a line is where their second variance is at most a share of the first. The axes are
    NaN of copies of one point. The sums are those of squares along the least and the second axis. O(length) a run.
    Shapes: points (n, 3), order (n,), begins (m,), lined (m,), axes (m, 2, 3), sums (m, 2).
    """
    rows, squares = np.zeros(count, np.int64), np.zeros(count)
    a, v = np.zeros(ELEMENTS), np.zeros((3, 3))
    for i in range(first, last):
        _nearest_of_run(points, order, begins[i], length, rows, squares)
        if not squares[count - 1] > 0.0:
            axes[i] = np.nan
            continue
        _scatter(points, rows, a)
        diagonalise(a, v)
        least, most = 0, 0
        for k in range(1, 3):
            least, most = k if a[k] < a[least] else least, k if a[k] >= a[most] else most
        sums[i, 0], sums[i, 1] = a[least], a[3 - least - most]
        lined[i] = sums[i, 1] <= line * a[most]
        for k in range(3):
            axes[i, 0, k], axes[i, 1, k] = v[k, least], v[k, most]


@inside_kernels
def _nearest_of_run(
    points: FloatArray, order: IntArray, begin: int, length: int, rows: IntArray, squares: FloatArray
) -> None:
    """Write the nearest points of a run to the one in its middle, and their squared distances, ascending."""
    middle, held, most = begin + length // 2, 0, len(rows)
    x, y, z = points[order[middle], 0], points[order[middle], 1], points[order[middle], 2]
    for place in range(begin, begin + length):
        t = order[place]
        dx, dy, dz = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if place == middle or (held == most and squared >= squares[most - 1]):
            continue
        k = held if held < most else most - 1
        while k > 0 and squares[k - 1] > squared:
            rows[k], squares[k] = rows[k - 1], squares[k - 1]
            k -= 1
        rows[k], squares[k] = t, squared
        held = min(held + 1, most)


@inside_kernels
def _scatter(points: FloatArray, rows: IntArray, a: FloatArray) -> None:
    """Write the sums of products of some points' offsets from their mean: xx, yy, zz, xy, xz, yz."""
    mx = my = mz = 0.0
    for t in rows:
        mx, my, mz = mx + points[t, 0], my + points[t, 1], mz + points[t, 2]
    mx, my, mz = mx / len(rows), my / len(rows), mz / len(rows)
    for e in range(ELEMENTS):
        a[e] = 0.0
    for t in rows:
        x, y, z = points[t, 0] - mx, points[t, 1] - my, points[t, 2] - mz
        a[0], a[1], a[2] = a[0] + x * x, a[1] + y * y, a[2] + z * z
        a[3], a[4], a[5] = a[3] + x * y, a[4] + x * z, a[5] + y * z
