"""What weighs in a motion, by the normals of one side or of both; rows stand in lanes, and none is kept."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# Rows that are added at once, as many lanes.
LANES = 64
# Numbers of a row: six motions by the target's normal, six by the scan's, its weight, the same with the sign by which
# the normals agree, and the share of a point.
WEIGHT, SIGNED = 12, 13
SHARE, NUMBERS = 14, 15


@inside_kernels
def _fill(
    points: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    i: int,
    weight: float,
    centre: FloatArray,
    lever: float,
    rows: FloatArray,
    lane: int,
) -> None:
    """Write row i of both sides, see `motion_row`, with its weight, to a lane."""
    x, y, z = (points[i, 0] - centre[0]) / lever, (points[i, 1] - centre[1]) / lever, (points[i, 2] - centre[2]) / lever
    u, v, w = normals[i, 0], normals[i, 1], normals[i, 2]
    p, q, r = own[i, 0], own[i, 1], own[i, 2]
    rows[0, lane], rows[1, lane], rows[2, lane] = y * w - z * v, z * u - x * w, x * v - y * u
    rows[3, lane], rows[4, lane], rows[5, lane] = u, v, w
    rows[6, lane], rows[7, lane], rows[8, lane] = y * r - z * q, z * p - x * r, x * q - y * p
    rows[9, lane], rows[10, lane], rows[11, lane] = p, q, r
    rows[WEIGHT, lane], rows[SIGNED, lane] = weight, -weight if u * p + v * q + w * r < 0.0 else weight


@inside_kernels
def _add_shares(rows: FloatArray, vectors: FloatArray, sums: FloatArray) -> None:
    """Add the shares of lanes, (NUMBERS, LANES), in each motion, (m, 6), and their squares to sums, (2, m, LANES)."""
    for m in range(len(vectors)):
        a, b, c = vectors[m, 0], vectors[m, 1], vectors[m, 2]
        u, v, w = vectors[m, 3], vectors[m, 4], vectors[m, 5]
        for lane in range(LANES):
            along = a * rows[0, lane] + b * rows[1, lane] + c * rows[2, lane]
            along += u * rows[3, lane] + v * rows[4, lane] + w * rows[5, lane]
            across = a * rows[6, lane] + b * rows[7, lane] + c * rows[8, lane]
            across += u * rows[9, lane] + v * rows[10, lane] + w * rows[11, lane]
            share = rows[SIGNED, lane] * along * across
            sums[0, m, lane] += share
            sums[1, m, lane] += share * share * rows[SHARE, lane]


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
    others = own if len(own) else normals
    rows, added = np.zeros((NUMBERS, LANES)), np.zeros((2, len(vectors), LANES))
    waiting = none = int(np.int64(0))
    for i in range(first, last):
        if weights[i] == 0.0:
            continue
        _fill(points, normals, others, i, weights[i], centre, lever, rows, waiting)
        rows[SHARE, waiting] = 1.0 / counts[i] if len(counts) else 1.0
        waiting += 1
        if waiting == LANES:
            _add_shares(rows, vectors, added)
            waiting = none
    rows[:, waiting:] = 0.0
    _add_shares(rows, vectors, added)
    sides = sums[first // chunk]
    for m in range(len(vectors)):
        for lane in range(LANES):
            sides[0, m] += added[0, m, lane]
            sides[1, m] += added[1, m, lane]
