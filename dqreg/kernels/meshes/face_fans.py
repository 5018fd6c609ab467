"""The triangles around triangles that are asked for: across their sides, and about their corners."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.meshes.corner_lists import Numbers

# Triangles about a corner beyond which they are no piece of a round surface but the hub of a plane or the tip of a
# cone: such a corner has the normal of its face.
MANY = 256


@compiled
def normals_of_corners(
    first: int,
    last: int,
    vertices: IntArray,
    faces: IntArray,
    welded: Numbers,
    heads: Numbers,
    following: Numbers,
    corners: FloatArray,
    face_normals: FloatArray,
    least: float,
    flat: float,
    corner_normals: FloatArray,
) -> None:
    """Write the unit normals, (f, 3, 3), that faces have in their corners at some vertices, from first to last.

    Each is the mean of the faces there that a chain of sides at the corner joins, with cosines of ``least`` or more
    between neighbours, weighted by the angles; that of the face where none of these is turned against it by more than a
    tenth of ``flat``. A chain's mean is made once, not once a face: O(faces at the vertex), squared where it is round.
    Lists of corners: see `list_corners`.
    """
    fan, mean = np.zeros((MANY, 6), np.int64), np.zeros(3)
    for row in range(first, last):
        count = fan_of(vertices[row], faces, welded, heads, following, fan)
        if count < 0:
            own_normals(vertices[row], heads, following, face_normals, corner_normals)
        # Each number is written once: another thread may be reading those that are known.
        for i in range(count):
            fan[i, 5] = is_turned(fan, count, i, face_normals, least, flat)
            if fan[i, 5] == 0:
                corner_normals[fan[i, 0], fan[i, 1]] = face_normals[fan[i, 0]]
        for i in range(count):
            if fan[i, 5] == 1 and fan[i, 4] == 0:
                join_fan(fan, count, i, face_normals, least)
                mean_of_fan(fan, count, i, corners, face_normals, mean)
                for j in range(i, count):
                    if fan[j, 5] == 1 and fan[j, 4] == i + 1:
                        corner_normals[fan[j, 0], fan[j, 1]] = mean


@compiled
def neighbours_of_faces(
    first: int,
    last: int,
    asked: IntArray,
    faces: IntArray,
    welded: Numbers,
    heads: Numbers,
    following: Numbers,
    face_normals: FloatArray,
    flat: float,
    neighbours: IntArray,
    corner_normals: FloatArray,
    is_round: BoolArray,
) -> None:
    """Write what is around the faces asked for, from first to last, to their rows of what is known of all faces.

    Neighbours, (f, 3), are those of `number_sides`. A face is round where the normal of one of its corners, made
    beforehand, differs from its own by more than ``flat``.
    """
    for row in range(first, last):
        f = asked[row]
        a, b, c = welded[faces[f, 0]], welded[faces[f, 1]], welded[faces[f, 2]]
        is_real, turned = a != b and b != c and c != a, False
        for k in range(3):
            neighbours[f, k] = side_across(f, k, faces, welded, heads, following) // 3 if is_real else f
            for i in range(3):
                turned = turned or (is_real and abs(corner_normals[f, k, i] - face_normals[f, i]) > flat)
        is_round[f] = turned


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
def fan_of(vertex: int, faces: IntArray, welded: Numbers, heads: Numbers, following: Numbers, fan: IntArray) -> int:
    """Write the faces at a vertex and return how many; -1 where they are too many.

    Columns of the fan, (MANY, 6): the face, its corner there, its two other vertices; the number of its chain, 0, and
    whether it is turned against others in it, which are for the caller to fill.
    """
    if heads[vertex, 1] > MANY:
        return -1
    count, corner = 0, heads[vertex, 0]
    while corner >= 0:
        g, j = corner // 3, corner % 3
        a, b = welded[faces[g, (j + 1) % 3]], welded[faces[g, (j + 2) % 3]]
        if a != b and a != vertex and b != vertex:
            fan[count, 0], fan[count, 1], fan[count, 2], fan[count, 3], fan[count, 4] = g, j, a, b, 0
            count += 1
        corner = following[corner]
    return count


@inside_kernels
def own_normals(
    vertex: int, heads: Numbers, following: Numbers, face_normals: FloatArray, corner_normals: FloatArray
) -> None:
    """Write the normals of the faces at a vertex to their corners there."""
    corner = heads[vertex, 0]
    while corner >= 0:
        corner_normals[corner // 3, corner % 3] = face_normals[corner // 3]
        corner = following[corner]


@inside_kernels
def is_turned(fan: IntArray, count: int, i: int, face_normals: FloatArray, least: float, flat: float) -> bool:
    """Whether a face that may be in the same chain is turned against the one in row i of a fan."""
    f = fan[i, 0]
    for j in range(count):
        g = fan[j, 0]
        if g != f and cosine_of(face_normals, f, g) >= least:
            for a in range(3):
                if abs(face_normals[f, a] - face_normals[g, a]) > 0.1 * flat:
                    return True
    return False


@inside_kernels
def join_fan(fan: IntArray, count: int, i: int, face_normals: FloatArray, least: float) -> None:
    """Give number i + 1 to the faces of a fan that a chain joins with the one in row i."""
    fan[i, 4], joined = i + 1, 1
    while joined > 0:
        joined = 0
        for j in range(count):
            if fan[j, 4] != i + 1:
                continue
            for k in range(count):
                is_met = fan[k, 4] == 0 and shares_side(fan, j, k)
                if is_met and cosine_of(face_normals, fan[j, 0], fan[k, 0]) >= least:
                    fan[k, 4], joined = i + 1, joined + 1


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
def mean_of_fan(
    fan: IntArray, count: int, i: int, corners: FloatArray, face_normals: FloatArray, normal: FloatArray
) -> None:
    """Write the unit mean of the normals of the faces of chain i + 1 of a fan, weighted by their angles."""
    normal[:] = 0.0
    for j in range(count):
        if fan[j, 4] == i + 1:
            angle = angle_at(corners, fan[j, 0], fan[j, 1])
            for a in range(3):
                normal[a] += angle * face_normals[fan[j, 0], a]
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
