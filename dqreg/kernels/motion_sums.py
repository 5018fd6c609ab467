"""Point-to-plane rows of the six motions: their sums over patches, and what weighs in a motion; no row is kept."""

from __future__ import annotations

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiled import compiled, inside_kernels

Row = tuple[float, float, float, float, float, float]

# First columns: six scores, then weight, weighted points, normals and residual, as of `patch_sums`;
NORMALS = 10
# then the squares of the residuals, the weighted rows of the rotations,
SQUARES, ROTATIONS = 14, 15
# and the products of rows among themselves, of a triangle (0, 0), (0, 1), ...: of all rows, and what the normals of a
# smooth surface change in them.
PRODUCTS, SMOOTH = 18, 39
COLUMNS = SMOOTH + 21


@inside_kernels
def motion_row(points: FloatArray, normals: FloatArray, i: int, k: int, centre: FloatArray, lever: float) -> Row:
    """Displacements of point i along normal k by rotations about a centre times the lever, and by translations."""
    x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
    u, v, w = normals[k, 0], normals[k, 1], normals[k, 2]
    return (y * w - z * v) / lever, (z * u - x * w) / lever, (x * v - y * u) / lever, u, v, w


@inside_kernels
def add_products(row: Row, weight: float, sums: FloatArray, at: int) -> None:
    """Add the products of a row with itself, times a weight, from a place on."""
    for k in range(6):
        scaled = weight * row[k]
        for m in range(k, 6):
            sums[at] += scaled * row[m]
            at += 1


@compiled
def motion_sums(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    smooth: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    centre: FloatArray,
    lever: float,
    starts: IntArray,
    sums: FloatArray,
) -> None:
    """Add what patches first to last hold. O(n).

    Patches reach from their start to the next. Normals of the smooth surface may be the others. Shapes: points, normals
    and smooth (n, 3), sums (m, 60), zeros.
    """
    for g in range(first, last):
        end, own = starts[g + 1] if g + 1 < len(starts) else len(weights), sums[g]
        for i in range(starts[g], end):
            w, r = weights[i], residuals[i]
            if w == 0.0:
                continue
            row = motion_row(points, normals, i, i, centre, lever)
            pull = w * r
            for k in range(6):
                own[k] += pull * row[k]
            own[6] += w
            for k in range(3):
                own[7 + k] += w * points[i, k]
                own[NORMALS + k] += w * row[3 + k]
            own[13] += pull
            own[SQUARES] += pull * r
            for k in range(3):
                own[ROTATIONS + k] += w * row[k]
            differs = smooth[i, 0] != row[3] or smooth[i, 1] != row[4] or smooth[i, 2] != row[5]
            # In a loop: each call would be compiled once more.
            for part in range(3 if differs else 1):
                if part == 2:
                    row = motion_row(points, smooth, i, i, centre, lever)
                add_products(row, -w if part == 1 else w, own, PRODUCTS if part == 0 else SMOOTH)


@compiled
def motion_shares(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    vectors: FloatArray,
    weights: FloatArray,
    counts: FloatArray,
    centre: FloatArray,
    lever: float,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the shares ``w (v . J)^2`` of rows first to last in each motion, and their squares over the points of a row.

    O(n m). Where there are normals of the other side, up to sign, a share is the product of what both say. A row is one
    point where there are no counts. Shapes: points and normals (n, 3), own (n, 3) or (0, 3), vectors (m, 6) one a row,
    sums (chunks, 2, m), zeros.
    """
    sides = sums[first // chunk]
    for i in range(first, last):
        if weights[i] == 0.0:
            continue
        a, b, c, u, v, w = motion_row(points, normals, i, i, centre, lever)
        weight, part = weights[i], 1.0 / counts[i] if len(counts) else 1.0
        if len(own) == 0:
            for m in range(len(vectors)):
                along = vectors[m, 0] * a + vectors[m, 1] * b + vectors[m, 2] * c
                along += vectors[m, 3] * u + vectors[m, 4] * v + vectors[m, 5] * w
                share = weight * along * along
                sides[0, m] += share
                sides[1, m] += share * share * part
            continue
        o, p, q, x, y, z = motion_row(points, own, i, i, centre, lever)
        signed = -weight if u * x + v * y + w * z < 0.0 else weight
        for m in range(len(vectors)):
            along = vectors[m, 0] * a + vectors[m, 1] * b + vectors[m, 2] * c
            along += vectors[m, 3] * u + vectors[m, 4] * v + vectors[m, 5] * w
            across = vectors[m, 0] * o + vectors[m, 1] * p + vectors[m, 2] * q
            across += vectors[m, 3] * x + vectors[m, 4] * y + vectors[m, 5] * z
            share = signed * along * across
            sides[0, m] += share
            sides[1, m] += share * share * part


@compiled
def products_of_both(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    weights: FloatArray,
    centre: FloatArray,
    lever: float,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the products of the rows of both sides, and those of the target's rows where the scan has any. O(n).

    Normals of the scan count up to sign; the products are symmetric ones, of triangles (0, 0), (0, 1), ... Shapes:
    points, normals and own (n, 3), sums (chunks, 2, 21), zeros.
    """
    sides = sums[first // chunk]
    for i in range(first, last):
        if weights[i] == 0.0:
            continue
        row = motion_row(points, normals, i, i, centre, lever)
        other = motion_row(points, own, i, i, centre, lever)
        if other[3] == 0.0 and other[4] == 0.0 and other[5] == 0.0:
            continue
        half = 0.5 * weights[i]
        if row[3] * other[3] + row[4] * other[4] + row[5] * other[5] < 0.0:
            half = -half
        at = 0
        for k in range(6):
            for m in range(k, 6):
                sides[0, at] += half * (row[k] * other[m] + row[m] * other[k])
                sides[1, at] += weights[i] * row[k] * row[m]
                at += 1
