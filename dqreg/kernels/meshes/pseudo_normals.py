"""Pseudo-normals of a mesh: sums over the faces that meet at sides and vertices, and which of them a place has."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.meshes.face_fans import angle_at


@compiled
def corner_angles(first: int, last: int, corners: FloatArray, angles: FloatArray) -> None:
    """Write the angle at each corner of faces first to last, (f, 3), radians. Shapes: corners (f, 3, 3)."""
    for f in range(first, last):
        for k in range(3):
            angles[f, k] = angle_at(corners, f, k)


@compiled
def add_scaled_rows(rows: FloatArray, every: int, scales: FloatArray, places: IntArray, sums: FloatArray) -> None:
    """Add each row, which serves ``every`` places in turn, times the scale of the place: ``sums[places]``. O(m).

    Shapes: rows (n, 3), scales and places (n every,), sums (p, 3).
    """
    for i in range(len(places)):
        row, place, scale = i // every, places[i], scales[i]
        for k in range(3):
            sums[place, k] += scale * rows[row, k]


@compiled
def pseudo_normals_at(
    first: int,
    last: int,
    points: FloatArray,
    feet: FloatArray,
    faces: IntArray,
    corners: FloatArray,
    sides: FloatArray,
    welded: IntArray,
    vertices: FloatArray,
    on_face: float,
    outside: float,
    normals: FloatArray,
    values: FloatArray,
) -> None:
    """Turn the face normals at the feet of points first to last into pseudo-normals, and distances into signed ones.

    Those of points on the other side of the pseudo-normals than ``outside``, 1 or -1, says become negative. A foot
    whose barycentric coordinates are all above ``on_face`` keeps its face's normal. O(1) a point. Shapes: points, feet,
    normals (n, 3), faces, values (n,), corners (f, 3, 3), sides (f, 3, 3), welded (f, 3), vertices (w, 3).
    """
    for i in range(first, last):
        f = faces[i]
        if _least_share(feet, i, corners, f, normals) < on_face:
            _turn(points, i, corners, f, sides, welded, vertices, normals)
        above = 0.0
        for k in range(3):
            above += (points[i, k] - feet[i, k]) * normals[i, k]
        if outside * above < 0.0:
            values[i] = -values[i]


@inside_kernels
def _turn(
    points: FloatArray,
    i: int,
    corners: FloatArray,
    f: int,
    sides: FloatArray,
    welded: IntArray,
    vertices: FloatArray,
    normals: FloatArray,
) -> None:
    """Write the pseudo-normal of what of face f is closest to point i: the face, a side or a corner."""
    inside, side, share, least = True, 0, 0.0, np.inf
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    for k in range(3):
        a = (k + 1) % 3
        x, y, z = (
            corners[f, a, 0] - corners[f, k, 0],
            corners[f, a, 1] - corners[f, k, 1],
            corners[f, a, 2] - corners[f, k, 2],
        )
        u, v, w = points[i, 0] - corners[f, k, 0], points[i, 1] - corners[f, k, 1], points[i, 2] - corners[f, k, 2]
        inside = inside and (ny * z - nz * y) * u + (nz * x - nx * z) * v + (nx * y - ny * x) * w >= 0.0
        along = min(max((u * x + v * y + w * z) / (x * x + y * y + z * z), 0.0), 1.0)
        u, v, w = u - along * x, v - along * y, w - along * z
        gap = u * u + v * v + w * w
        if gap < least:
            side, share, least = k, along, gap
    if inside:
        return
    at_end = share == 0.0 or share == 1.0
    vertex = welded[f, (side + 1) % 3 if share == 1.0 else side]
    for k in range(3):
        normals[i, k] = vertices[vertex, k] if at_end else sides[f, side, k]


@inside_kernels
def _least_share(feet: FloatArray, i: int, corners: FloatArray, f: int, normals: FloatArray) -> float:
    """Least barycentric coordinate of foot i on face f."""
    x, y, z = corners[f, 0, 0], corners[f, 0, 1], corners[f, 0, 2]
    ax, ay, az = corners[f, 1, 0] - x, corners[f, 1, 1] - y, corners[f, 1, 2] - z
    bx, by, bz = corners[f, 2, 0] - x, corners[f, 2, 1] - y, corners[f, 2, 2] - z
    px, py, pz = feet[i, 0] - x, feet[i, 1] - y, feet[i, 2] - z
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    area = (ay * bz - az * by) * nx + (az * bx - ax * bz) * ny + (ax * by - ay * bx) * nz
    v = ((py * bz - pz * by) * nx + (pz * bx - px * bz) * ny + (px * by - py * bx) * nz) / area
    w = ((ay * pz - az * py) * nx + (az * px - ax * pz) * ny + (ax * py - ay * px) * nz) / area
    least: float = min(1.0 - v - w, v, w)
    return least


@compiled
def smooth_normals_at(
    first: int,
    last: int,
    places: FloatArray,
    faces: IntArray,
    is_round: BoolArray,
    corners: FloatArray,
    corner_normals: FloatArray,
    normals: FloatArray,
) -> None:
    """Write the normals of corners, interpolated at places of round faces, (n, 3); those of others stay. O(n).

    Shapes: places (n, 3), faces (n,), is_round (f,), corners and their normals (f, 3, 3).
    """
    for i in range(first, last):
        f = faces[i]
        if not is_round[f]:
            continue
        aa, ab, bb, ao, bo = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            a, b = corners[f, 1, k] - corners[f, 0, k], corners[f, 2, k] - corners[f, 0, k]
            o = places[i, k] - corners[f, 0, k]
            aa, ab, bb, ao, bo = aa + a * a, ab + a * b, bb + b * b, ao + a * o, bo + b * o
        area = aa * bb - ab * ab
        second, third = (bb * ao - ab * bo) / area, (aa * bo - ab * ao) / area
        # Rounding may leave the triangle.
        one, two = min(max(1.0 - second - third, 0.0), 1.0), min(max(second, 0.0), 1.0)
        three = min(max(third, 0.0), 1.0)
        square = 0.0
        for k in range(3):
            mixed = one * corner_normals[f, 0, k] + two * corner_normals[f, 1, k] + three * corner_normals[f, 2, k]
            normals[i, k], square = mixed, square + mixed * mixed
        length = np.sqrt(square)
        for k in range(3):
            normals[i, k] /= length if length > 0.0 else 1.0
