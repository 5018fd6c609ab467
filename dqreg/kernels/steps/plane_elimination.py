"""Normal equations of many poses whose points lie on planes that nobody knows: each plane is solved for on the way."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.clouds.plane_fits import ELEMENTS, diagonalise
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Weight of the usual variance in that of each plane, in points.
BEFOREHAND = 8.0
# A second extent below this share of the first, squared, is none.
NARROW = 1e-9


@compiled
def eliminate_planes(
    starts: IntArray,
    scans: IntArray,
    moments: FloatArray,
    variance: float,
    table: IntArray,
    blocks: FloatArray,
    slopes: FloatArray,
) -> None:
    """Add the curvature of the cost to the blocks of its matrix, and write its slope by each group.

    A group is what one scan sees of one plane: groups ``starts[f]`` to ``starts[f + 1]`` are those of plane f. Moments
    are the sums of ``(x, 1) (x, 1)^T`` over their points. The cost is a sum of squared distances from the best planes,
    that is of least eigenvalues (Liu and Zhang, "BALM", 2021); of its matrix the part above the diagonal is written.
    Shapes: scans (g,), moments (g, 4, 4), table (n, n) of blocks (m, 6, 6), slopes (g, 6).
    """
    most = 0
    for f in range(len(starts) - 1):
        most = max(most, starts[f + 1] - starts[f])
    a, v, total, rows = np.zeros(ELEMENTS), np.zeros((3, 3)), np.zeros((4, 4)), np.zeros((6, 4))
    held, crossed, numbers, plane = np.zeros((6, 4)), np.zeros((most, 6, 3)), np.zeros((3, 4)), np.zeros(4)
    for f in range(len(starts) - 1):
        first, last = starts[f], starts[f + 1]
        total[:] = 0.0
        for g in range(first, last):
            total += moments[g]
        least = fit_plane(total, a, v, numbers, plane)
        weight = (BEFOREHAND + total[3, 3] - 3.0) / (BEFOREHAND * variance + max(a[least], 0.0))
        write_rows(v, least, rows)
        for g in range(first, last):
            for i in range(6):
                slopes[g, i] = 0.0
                for j in range(4):
                    for k in range(4):
                        slopes[g, i] += weight * rows[i, j] * moments[g, j, k] * plane[k]
        add_curvature(first, last, scans, moments, rows, weight, numbers, table, blocks, held, crossed)


@inside_kernels
def fit_plane(total: FloatArray, a: FloatArray, v: FloatArray, numbers: FloatArray, plane: FloatArray) -> int:
    """Write the plane of some moments, ``plane . (x, 1) = 0``, and what its three numbers do to a distance, (3, 4).

    The numbers are scaled so that their own matrix is one. Returns the axis along the normal.
    """
    count = total[3, 3]
    x, y, z = total[0, 3] / count, total[1, 3] / count, total[2, 3] / count
    a[0], a[1], a[2] = total[0, 0] - count * x * x, total[1, 1] - count * y * y, total[2, 2] - count * z * z
    a[3], a[4], a[5] = total[0, 1] - count * x * y, total[0, 2] - count * x * z, total[1, 2] - count * y * z
    diagonalise(a, v)
    least = 0
    for k in range(1, 3):
        if a[k] < a[least]:
            least = k
    for m in range(2):
        axis = (least + 1 + m) % 3
        length = np.sqrt(a[axis]) if a[axis] > NARROW * max(a[0], a[1], a[2]) else np.inf
        for k in range(3):
            numbers[m, k] = v[k, axis] / length
        numbers[m, 3] = -(v[0, axis] * x + v[1, axis] * y + v[2, axis] * z) / length
    numbers[2, 3] = 1.0 / np.sqrt(count)
    for k in range(3):
        plane[k] = v[k, least]
    plane[3] = -(v[0, least] * x + v[1, least] * y + v[2, least] * z)
    return least


@inside_kernels
def write_rows(v: FloatArray, axis: int, rows: FloatArray) -> None:
    """Write what an increment of a pose does to ``n . x``, for a column of v: ``(x cross n, n)`` of (x, 1), (6, 4)."""
    p, q, r = v[0, axis], v[1, axis], v[2, axis]
    rows[0, 1], rows[0, 2], rows[1, 0], rows[1, 2], rows[2, 0], rows[2, 1] = r, -q, -r, p, q, -p
    rows[3, 3], rows[4, 3], rows[5, 3] = p, q, r


@inside_kernels
def add_curvature(
    first: int,
    last: int,
    scans: IntArray,
    moments: FloatArray,
    rows: FloatArray,
    weight: float,
    numbers: FloatArray,
    table: IntArray,
    blocks: FloatArray,
    held: FloatArray,
    crossed: FloatArray,
) -> None:
    """Add the weighted squares of the rows of some groups, without what the numbers of the plane take up.

    The Schur complement of the plane's numbers. Room: held (6, 4), crossed (groups of a plane at most, 6, 3).
    """
    for g in range(first, last):
        for i in range(6):
            for j in range(4):
                held[i, j] = 0.0
                for k in range(4):
                    held[i, j] += rows[i, k] * moments[g, k, j]
            for m in range(3):
                crossed[g - first, i, m] = 0.0
                for j in range(4):
                    crossed[g - first, i, m] += held[i, j] * numbers[m, j]
        own = blocks[table[scans[g], scans[g]]]
        for i in range(6):
            for k in range(i, 6):
                for j in range(4):
                    own[i, k] += weight * held[i, j] * rows[k, j]
    for g in range(first, last):
        for h in range(g, last):
            block, left, right = blocks[table[scans[g], scans[h]]], crossed[g - first], crossed[h - first]
            for i in range(6):
                for k in range(i if g == h else 0, 6):
                    block[i, k] -= weight * (
                        left[i, 0] * right[k, 0] + left[i, 1] * right[k, 1] + left[i, 2] * right[k, 2]
                    )
