"""What follows from the corners of triangles: normals, areas, boxes, moments."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Rows of `solid_faces` and `surface_moments` for each range of faces.
ENDS, MOMENTS = 7, 10


@compiled
def solid_faces(
    first: int,
    last: int,
    vertices: FloatArray,
    faces: IntArray,
    chunk: int,
    smallest: float,
    solid: BoolArray,
    ends: FloatArray,
) -> None:
    """Write which faces first to last have an area, (f,), and the ends of their corners to the row of their range.

    An area below ``smallest`` times the longest side and the farthest coordinate, or side, is rounding. The columns of
    the ends are the lowest and highest corner of the box, and 1 where a coordinate is not finite.
    """
    row = first // chunk
    for k in range(3):
        ends[row, k], ends[row, 3 + k] = np.inf, -np.inf
    for f in range(first, last):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        longest, farthest = 0.0, 0.0
        for k in range(3):
            x, y, z = vertices[a, k], vertices[b, k], vertices[c, k]
            low, high = min(x, y, z), max(x, y, z)
            longest, farthest = max(longest, high - low), max(farthest, high, -low)
            ends[row, k], ends[row, 3 + k] = min(ends[row, k], low), max(ends[row, 3 + k], high)
            if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
                ends[row, 6] = 1.0
        x, y, z = across(vertices, faces, f)
        solid[f] = np.sqrt(x * x + y * y + z * z) > smallest * longest * max(longest, farthest)


@inside_kernels
def across(vertices: FloatArray, faces: IntArray, f: int) -> tuple[float, float, float]:
    """The vector across a face, by the right-hand rule over its corners, as long as twice its area."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@compiled
def face_columns(
    first: int, last: int, vertices: FloatArray, faces: IntArray, normals: FloatArray, areas: FloatArray
) -> None:
    """Write the unit normals of faces first to last, (f, 3), by the right-hand rule, and their areas, (f,)."""
    for f in range(first, last):
        x, y, z = across(vertices, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        areas[f] = 0.5 * length
        normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length


@compiled
def surface_moments(
    first: int, last: int, corners: FloatArray, areas: FloatArray, about: FloatArray, chunk: int, sums: FloatArray
) -> None:
    """Write area, first and second moments of faces first to last to the row of their range, of `MOMENTS` columns.

    Of a triangle of area A with corners c and their sum s the second moment is A / 12 (sum of c c^T + s s^T). Columns
    4 to 9 are xx, xy, xz, yy, yz, zz.
    """
    row = first // chunk
    total, mx, my, mz = 0.0, 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for f in range(first, last):
        area = areas[f]
        ax, ay, az = corners[f, 0, 0] - about[0], corners[f, 0, 1] - about[1], corners[f, 0, 2] - about[2]
        bx, by, bz = corners[f, 1, 0] - about[0], corners[f, 1, 1] - about[1], corners[f, 1, 2] - about[2]
        cx, cy, cz = corners[f, 2, 0] - about[0], corners[f, 2, 1] - about[1], corners[f, 2, 2] - about[2]
        x, y, z = ax + bx + cx, ay + by + cy, az + bz + cz
        total = total + area
        mx, my, mz = mx + area * x / 3.0, my + area * y / 3.0, mz + area * z / 3.0
        xx += area * (x * x + ax * ax + bx * bx + cx * cx) / 12.0
        xy += area * (x * y + ax * ay + bx * by + cx * cy) / 12.0
        xz += area * (x * z + ax * az + bx * bz + cx * cz) / 12.0
        yy += area * (y * y + ay * ay + by * by + cy * cy) / 12.0
        yz += area * (y * z + ay * az + by * bz + cy * cz) / 12.0
        zz += area * (z * z + az * az + bz * bz + cz * cz) / 12.0
    own = sums[row]
    own[0], own[1], own[2], own[3] = total, mx, my, mz
    own[4], own[5], own[6], own[7], own[8], own[9] = xx, xy, xz, yy, yz, zz
