"""Places on triangles that are near a crease: a side at which the surface turns."""

from __future__ import annotations

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.evidence.motion_sums import add_products, motion_row

# Sums of the points near creases, and of the others: their weights, and the products of the motions among themselves.
PRODUCTS = 21
COLUMNS = 2 * (1 + PRODUCTS)
# The least of one and a cosine to divide by.
ROUNDING = 1e-12


@compiled
def near_creases(
    first: int,
    last: int,
    points: FloatArray,
    places: FloatArray,
    faces: IntArray,
    weights: FloatArray,
    corners: FloatArray,
    normals: FloatArray,
    turns: FloatArray,
    centre: FloatArray,
    lever: float,
    cosine: float,
    margin: float,
    chunk: int,
    near: BoolArray,
    sums: FloatArray,
) -> None:
    """Write which places with a weight are nearer than a margin to a crease of their face, (n,), and add to the sums.

    There the normals of the two faces have a lower cosine; of an acute edge it is wider, by the tangent of half that
    turn. The sums are of what the points near creases, and the
    others, tell of the six motions, see `motion_sums`. O(n). Shapes: points and places (n, 3), faces (n,); of all m
    faces corners (m, 3, 3), normals (m, 3) and the cosine across each side (m, 3); sums (chunks, 44), zeros.
    """
    own = sums[first // chunk]
    for i in range(first, last):
        face, weight = faces[i], weights[i]
        if not weight > 0.0 or face < 0:
            continue
        for k in range(3):
            turn = turns[face, k]
            if turn >= cosine:
                continue
            # Squared, half the angle's tangent: as far from a blade as the noise is high its other side is as near.
            wider = max(1.0, (1.0 - turn) / max(1.0 + turn, ROUNDING))
            # Off the line of the side, in the plane of the face: the places are on it.
            size, along, away = 0.0, 0.0, 0.0
            for a in range(3):
                side = corners[face, (k + 1) % 3, a] - corners[face, k, a]
                off = places[i, a] - corners[face, k, a]
                size, along, away = size + side * side, along + side * off, away + off * off
            if size > 0.0 and away - along * along / size < wider * margin * margin:
                near[i] = True
        at = 0 if near[i] else 1 + PRODUCTS
        own[at] += weight
        add_products(motion_row(points, normals, i, face, centre, lever), weight, own, at + 1)
