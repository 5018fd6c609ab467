"""Planes through neighbouring points."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.clouds.many_axes import AXES, LANES, ROUNDS, ROWS, diagonalise_lanes
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Elements of a symmetric 3 x 3 matrix: xx, yy, zz, xy, xz, yz.
ELEMENTS = 6
# A second extent below this share of the largest, squared, is a line.
LINE = 1e-6


@compiled
def fit_plane_rows(
    first: int,
    last: int,
    points: FloatArray,
    neighbours: IntArray,
    normals: FloatArray,
    residuals: FloatArray,
    levers: FloatArray,
) -> None:
    """Write normal, residual and lever of the planes through the k neighbours of rows first to last, (m, k).

    O(k) a row. On a line the normal is NaN and the lever zero.
    """
    count, lanes = neighbours.shape[1], np.zeros((ROWS, LANES))
    for start in range(first, last, LANES):
        many = min(LANES, last - start)
        for lane in range(many):
            i = start + lane
            mx = my = mz = 0.0
            for j in range(count):
                t = neighbours[i, j]
                mx, my, mz = mx + points[t, 0], my + points[t, 1], mz + points[t, 2]
            mx, my, mz = mx / count, my / count, mz / count
            xx = yy = zz = xy = xz = yz = 0.0
            for j in range(count):
                t = neighbours[i, j]
                x, y, z = points[t, 0] - mx, points[t, 1] - my, points[t, 2] - mz
                xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
                xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
            lanes[0, lane], lanes[1, lane], lanes[2, lane] = xx, yy, zz
            lanes[3, lane], lanes[4, lane], lanes[5, lane] = xy, xz, yz
        diagonalise_lanes(many, lanes)
        for lane in range(many):
            i = start + lane
            least, small, large = least_of_lane(lanes, lane)
            residuals[i] = np.sqrt(max(lanes[least, lane], 0.0) / (count - 3))
            if small <= LINE * large:
                normals[i, 0] = normals[i, 1] = normals[i, 2] = np.nan
                levers[i] = 0.0
            else:
                for k in range(3):
                    normals[i, k] = lanes[AXES + 3 * least + k, lane]
                levers[i] = 1.0 / (count / small + count / large)


@inside_kernels
def least_of_lane(lanes: FloatArray, lane: int) -> tuple[int, float, float]:
    """Number of the least eigenvalue of one of the matrices of `diagonalise_lanes`, and the two others, ascending."""
    least = 0
    for k in range(1, 3):
        if lanes[k, lane] < lanes[least, lane]:
            least = k
    one, two = lanes[(least + 1) % 3, lane], lanes[(least + 2) % 3, lane]
    return least, min(one, two), max(one, two)


@inside_kernels
def diagonalise(a: FloatArray, v: FloatArray) -> None:
    """Turn a symmetric matrix (xx, yy, zz, xy, xz, yz) into its eigenvalues, in xx, yy, zz, and v into their axes.

    Cyclic rotations by Jacobi: small eigenvalues keep their digits. Shapes: a (6,), v (3, 3), one axis a column.
    """
    # By name: elements of arrays would be written and read again after every product.
    xx, yy, zz, xy, xz, yz = a[0], a[1], a[2], a[3], a[4], a[5]
    x0, x1, x2, y0, y1, y2, z0, z1, z2 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(ROUNDS):
        if xy == 0.0 and xz == 0.0 and yz == 0.0:
            break
        if _adds_nothing(xx, yy, xy):
            xy = 0.0
        else:
            t, c, s = _rotation(xx, yy, xy)
            xx, yy, xy = xx - t * xy, yy + t * xy, 0.0
            xz, yz = c * xz - s * yz, s * xz + c * yz
            x0, y0, x1, y1 = c * x0 - s * y0, s * x0 + c * y0, c * x1 - s * y1, s * x1 + c * y1
            x2, y2 = c * x2 - s * y2, s * x2 + c * y2
        if _adds_nothing(xx, zz, xz):
            xz = 0.0
        else:
            t, c, s = _rotation(xx, zz, xz)
            xx, zz, xz = xx - t * xz, zz + t * xz, 0.0
            xy, yz = c * xy - s * yz, s * xy + c * yz
            x0, z0, x1, z1 = c * x0 - s * z0, s * x0 + c * z0, c * x1 - s * z1, s * x1 + c * z1
            x2, z2 = c * x2 - s * z2, s * x2 + c * z2
        if _adds_nothing(yy, zz, yz):
            yz = 0.0
        else:
            t, c, s = _rotation(yy, zz, yz)
            yy, zz, yz = yy - t * yz, zz + t * yz, 0.0
            xy, xz = c * xy - s * xz, s * xy + c * xz
            y0, z0, y1, z1 = c * y0 - s * z0, s * y0 + c * z0, c * y1 - s * z1, s * y1 + c * z1
            y2, z2 = c * y2 - s * z2, s * y2 + c * z2
    a[0], a[1], a[2], a[3], a[4], a[5] = xx, yy, zz, xy, xz, yz
    v[0, 0], v[1, 0], v[2, 0], v[0, 1], v[1, 1], v[2, 1] = x0, x1, x2, y0, y1, y2
    v[0, 2], v[1, 2], v[2, 2] = z0, z1, z2


@inside_kernels
def _adds_nothing(p: float, q: float, off: float) -> bool:
    """Whether an element off the diagonal changes the sum of neither of its two on the diagonal."""
    return abs(p) + abs(off) == abs(p) and abs(q) + abs(off) == abs(q)


@inside_kernels
def _rotation(p: float, q: float, off: float) -> tuple[float, float, float]:
    """Tangent, cosine and sine of the rotation that makes an element zero."""
    h = 0.5 * (q - p)
    r = np.sqrt(h * h + off * off)
    t = off / (h + r) if h >= 0.0 else off / (h - r)
    if r == 0.0:
        # So small beside the rest that their squares are none.
        t = 1.0
    c = 1.0 / np.sqrt(1.0 + t * t)
    return t, c, t * c
