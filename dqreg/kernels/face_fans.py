"""The triangles around triangles that are asked for: across their sides, and about their corners."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.corner_lists import Numbers

# Triangles about a corner beyond which they are no piece of a round surface but the hub of a plane or the tip of a
# cone: such a corner has the normal of its face.
MANY = 256


@compiled
def fans_of_faces(
    first: int,
    last: int,
    asked: IntArray,
    faces: IntArray,
    welded: Numbers,
    heads: Numbers,
    following: Numbers,
    corners: FloatArray,
    face_normals: FloatArray,
    least: float,
    flat: float,
    neighbours: IntArray,
    corner_normals: FloatArray,
    is_round: BoolArray,
) -> None:
    """Write what is around the faces asked for, from first to last, to their rows of what is known of all faces.

    Neighbours, (m, 3), are those of `number_sides`. Normals of corners, (m, 3, 3), are means of the faces there that a
    chain of sides at the corner joins, with cosines of ``least`` or more between neighbours, weighted by the angles; of
    unit length. They are written where a face is round: where one of them differs from its own by more than ``flat``.
    Lists of corners: see
    `list_corners`.
    """
    fan, found = np.zeros((MANY, 5), np.int64), np.zeros((3, 3))
    for row in range(first, last):
        f = asked[row]
        a, b, c = welded[faces[f, 0]], welded[faces[f, 1]], welded[faces[f, 2]]
        is_real, turned = a != b and b != c and c != a, False
        for k in range(3):
            neighbours[f, k] = side_across(f, k, faces, welded, heads, following) // 3 if is_real else f
            count = fan_of(f, k, faces, welded, heads, following, fan) if is_real else 0
            is_joined = join_fan(f, fan, count, face_normals, least, flat)
            if is_joined:
                mean_of_fan(fan, count, corners, face_normals, found[k])
            for i in range(3):
                found[k, i] = found[k, i] if is_joined else face_normals[f, i]
                turned = turned or abs(found[k, i] - face_normals[f, i]) > flat
        is_round[f] = turned
        if turned:
            corner_normals[f] = found


@inside_kernels
def side_across(f: int, k: int, faces: IntArray, welded: Numbers, heads: Numbers, following: Numbers) -> int:
    """The side met across side k of a face: of those of its edge, in their order, the one before it, or the second."""
    own = 3 * f + k
    one, two = welded[faces[f, k]], welded[faces[f, (k + 1) % 3]]
    # Looked for where fewer meet: at the tip of a fan of needles there are thousands.
    here, there = (one, two) if heads[one, 1] <= heads[two, 1] else (two, one)
    before, after, corner = -1, -1, heads[here, 0]
    while corner >= 0 and after < 0:
        g, j = corner // 3, corner % 3
        a, b = welded[faces[g, (j + 1) % 3]], welded[faces[g, (j + 2) % 3]]
        if g != f and (a == there or b == there) and a != b and a != here and b != here:
            side = corner if a == there else 3 * g + (j + 2) % 3
            if side < own:
                before = side
            else:
                after = side
        corner = following[corner]
    return before if before >= 0 else after if after >= 0 else own


@inside_kernels
def fan_of(f: int, k: int, faces: IntArray, welded: Numbers, heads: Numbers, following: Numbers, fan: IntArray) -> int:
    """Write the faces at a corner of a face, itself too, and return how many; 0 where they are too many.

    Columns of the fan, (MANY, 5): the face, its corner there, its two other vertices, and 1 for the face itself.
    """
    vertex, count = welded[faces[f, k]], 0
    if heads[vertex, 1] > MANY:
        return 0
    corner = heads[vertex, 0]
    while corner >= 0:
        g, j = corner // 3, corner % 3
        a, b = welded[faces[g, (j + 1) % 3]], welded[faces[g, (j + 2) % 3]]
        if a != b and a != vertex and b != vertex:
            fan[count, 0], fan[count, 1], fan[count, 2], fan[count, 3], fan[count, 4] = g, j, a, b, g == f
            count += 1
        corner = following[corner]
    return count


@inside_kernels
def join_fan(f: int, fan: IntArray, count: int, face_normals: FloatArray, least: float, flat: float) -> bool:
    """Mark which faces of a fan a chain joins with face f; False where none that may be is turned against it."""
    turned = False
    for i in range(count):
        g = fan[i, 0]
        if g != f and cosine_of(face_normals, f, g) >= least:
            for a in range(3):
                turned = turned or abs(face_normals[f, a] - face_normals[g, a]) > 0.1 * flat
    if not turned:
        return False
    joined = 1
    while joined > 0:
        joined = 0
        for i in range(count):
            if fan[i, 4] == 0:
                continue
            for j in range(count):
                is_met = fan[j, 4] == 0 and shares_side(fan, i, j)
                if is_met and cosine_of(face_normals, fan[i, 0], fan[j, 0]) >= least:
                    fan[j, 4], joined = 1, joined + 1
    return True


@inside_kernels
def shares_side(fan: IntArray, i: int, j: int) -> bool:
    """Whether two faces of a fan have another vertex in common."""
    for a in range(2, 4):
        for b in range(2, 4):
            if fan[i, a] == fan[j, b]:
                return True
    return False


@inside_kernels
def cosine_of(normals: FloatArray, f: int, g: int) -> float:
    """Cosine between the normals of two faces."""
    cosine: float = normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
    return cosine


@inside_kernels
def mean_of_fan(fan: IntArray, count: int, corners: FloatArray, face_normals: FloatArray, normal: FloatArray) -> None:
    """Write the unit mean of the normals of the faces of a fan that are marked, weighted by their angles."""
    normal[:] = 0.0
    for i in range(count):
        if fan[i, 4] == 1:
            angle = angle_at(corners, fan[i, 0], fan[i, 1])
            for a in range(3):
                normal[a] += angle * face_normals[fan[i, 0], a]
    length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    for a in range(3):
        normal[a] /= length if length > 0.0 else 1.0


@inside_kernels
def angle_at(corners: FloatArray, f: int, k: int) -> float:
    """Angle at a corner of a face, radians."""
    x, y, z, u, v, w = side_from(corners, f, k, (k + 1) % 3) + side_from(corners, f, k, (k + 2) % 3)
    p, q, r = y * w - z * v, z * u - x * w, x * v - y * u
    angle: float = np.arctan2(np.sqrt(p * p + q * q + r * r), x * u + y * v + z * w)
    return angle


@inside_kernels
def side_from(corners: FloatArray, f: int, k: int, j: int) -> tuple[float, float, float]:
    """The way from one corner of a face to another."""
    return (
        corners[f, j, 0] - corners[f, k, 0],
        corners[f, j, 1] - corners[f, k, 1],
        corners[f, j, 2] - corners[f, k, 2],
    )
