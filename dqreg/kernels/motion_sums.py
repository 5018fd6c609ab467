"""Point-to-plane rows of the six motions: their sums over patches; no row is kept."""

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
