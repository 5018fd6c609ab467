"""Point-to-plane rows of the six motions: their sums over patches, and of the normals of both sides; none is kept."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

Row = tuple[float, float, float, float, float, float]

# Numbers of a row beside its six motions: residual and one. Of the products of all eight among themselves a sum has the
# first four's with all, then the others' among themselves: processors take as many at a time.
RESIDUAL, ONE = 6, 7
HALF = 4
# Then weighted points, and what the normals of a smooth surface change in the products of the motions, of a triangle
# (0, 0), (0, 1), ...
POINTS, SMOOTH = 48, 51
COLUMNS = SMOOTH + 21
# Sums of all patches have, beside these, triangles of the products of the motions by the normals of either side, and of
# the target's own where the scan has none.
BOTH, ALONE = COLUMNS, COLUMNS + 21
TOTALS = ALONE + 21
# Rows of both sides that are multiplied at once, as many lanes: processors take several of them.
LANES = 64


def column(k: int, m: int) -> int:
    """Where the products of numbers k and m of a row stand in a sum."""
    k, m = min(k, m), max(k, m)
    return 8 * k + m if k < HALF else 8 * HALF + HALF * (k - HALF) + m - HALF


# Products of the motions, (6, 6); squares of the residuals;
PRODUCTS = np.array([[column(k, m) for m in range(6)] for k in range(6)])
SQUARES = column(RESIDUAL, RESIDUAL)
# six scores, then weight, weighted points, normals and residual, as of `patch_sums`;
NORMALS = [column(ONE, k) for k in (3, 4, 5)]
SCORES = [column(k, RESIDUAL) for k in range(6)]
OVER = np.array([*SCORES, column(ONE, ONE), *range(POINTS, SMOOTH), *NORMALS, column(ONE, RESIDUAL)])
# and the weighted rows, by themselves and times the normal: translations displace along it.
PULLS = np.array([column(k, m) for m in (ONE, 3, 4, 5) for k in range(6)])


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


@inside_kernels
def _add_lanes(rows: FloatArray, sums: FloatArray) -> None:
    """Add twice the symmetric products of the rows of both sides, one a lane, (12, LANES), to sums, (21, LANES)."""
    at = 0
    for k in range(6):
        for m in range(k, 6):
            for lane in range(LANES):
                sums[at, lane] += rows[k, lane] * rows[6 + m, lane] + rows[m, lane] * rows[6 + k, lane]
            at += 1


@compiled
def motion_sums(
    first: int,
    last: int,
    points: FloatArray,
    normals: FloatArray,
    smooth: FloatArray,
    other: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    centre: FloatArray,
    lever: float,
    starts: IntArray,
    chunk: int,
    sums: FloatArray,
    totals: FloatArray,
) -> None:
    """Add what patches first to last hold, each and together. O(n).

    Patches reach from their start to the next. Normals of the smooth surface may be the others; those of the other side
    count up to sign. Shapes: points, normals and smooth (n, 3), other (n, 3) or (0, 3), sums (m, COLUMNS) and totals
    (chunks, TOTALS), zeros.
    """
    # Of the type of other numbers: for a plain one what it is given to would be compiled once more.
    changes, alone = int(np.int64(SMOOTH)), int(np.int64(ALONE))
    rows, added, waiting, whole = np.zeros((12, LANES)), np.zeros((21, LANES)), 0, totals[first // chunk]
    for g in range(first, last):
        end, own = starts[g + 1] if g + 1 < len(starts) else len(weights), sums[g]
        for i in range(starts[g], end):
            w = weights[i]
            if w == 0.0:
                continue
            a, b, c, x, y, z = row = motion_row(points, normals, i, i, centre, lever)
            numbers = a, b, c, x, y, z, residuals[i], 1.0
            for k in range(HALF):
                scaled = w * numbers[k]
                for m in range(2 * HALF):
                    own[8 * k + m] += scaled * numbers[m]
            for k in range(HALF):
                scaled = w * numbers[HALF + k]
                for m in range(HALF):
                    own[8 * HALF + HALF * k + m] += scaled * numbers[HALF + m]
            for k in range(3):
                own[POINTS + k] += w * points[i, k]
            if len(other):
                p, q, r = other[i, 0], other[i, 1], other[i, 2]
                if p == 0.0 and q == 0.0 and r == 0.0:
                    add_products(row, w, whole, alone)
                else:
                    signed = -w if x * p + y * q + z * r < 0.0 else w
                    theirs = motion_row(points, other, i, i, centre, lever)
                    for k in range(6):
                        rows[k, waiting], rows[6 + k, waiting] = signed * row[k], theirs[k]
                    waiting += 1
                    if waiting == LANES:
                        _add_lanes(rows, added)
                        waiting = 0
            if smooth[i, 0] == x and smooth[i, 1] == y and smooth[i, 2] == z:
                continue
            # In a loop: each call would be compiled once more.
            for part in range(2):
                if part == 1:
                    row = motion_row(points, smooth, i, i, centre, lever)
                add_products(row, w if part == 1 else -w, own, changes)
        for k in range(COLUMNS):
            whole[k] += own[k]
    # The last lanes are filled up with rows without weight.
    rows[:, waiting:] = 0.0
    _add_lanes(rows, added)
    for k in range(21):
        for lane in range(LANES):
            whole[BOTH + k] += 0.5 * added[k, lane]
