"""Places on triangles that are near a crease: a side at which the surface turns."""

from __future__ import annotations

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiled import compiled


@compiled
def near_creases(
    first: int,
    last: int,
    places: FloatArray,
    faces: IntArray,
    weights: FloatArray,
    corners: FloatArray,
    normals: FloatArray,
    neighbours: IntArray,
    cosine: float,
    margin: float,
    near: BoolArray,
) -> None:
    """Write which places with a weight are nearer than a margin to a crease of their face, (n,). O(n).

    There the normals of the two faces have a lower cosine. Shapes: places (n, 3), faces (n,); of all m faces corners
    (m, 3, 3), normals (m, 3) and the one across each side (m, 3).
    """
    for i in range(first, last):
        face = faces[i]
        if not weights[i] > 0.0 or face < 0:
            continue
        for k in range(3):
            other, turn = neighbours[face, k], 0.0
            for a in range(3):
                turn += normals[face, a] * normals[other, a]
            if other == face or turn >= cosine:
                continue
            # Off the line of the side, in the plane of the face: the places are on it.
            size, along, away = 0.0, 0.0, 0.0
            for a in range(3):
                side = corners[face, (k + 1) % 3, a] - corners[face, k, a]
                off = places[i, a] - corners[face, k, a]
                size, along, away = size + side * side, along + side * off, away + off * off
            if size > 0.0 and away - along * along / size < margin * margin:
                near[i] = True
