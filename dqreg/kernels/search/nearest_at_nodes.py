"""Which point is the nearest to each node of a regular grid, of few points left in blocks that are halved again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels

# What stands between brackets counts from the end where it is below zero, which each access asks of a signed number.
U = np.uint64
# Nodes along a side of a block, and how often it is halved: to two nodes.
SIDE, HALVED = 32, 4
# Squares, in cells, that are apart by less may be equal: rounding must not drop the nearest.
EQUAL = 1e-9


@inside_kernels
def left_in_block(
    some: FloatArray,
    rows: IntArray,
    count: int,
    middle: tuple[float, float, float],
    half: float,
    squares: FloatArray,
    left: FloatArray,
    left_rows: IntArray,
) -> int:
    """Write those of some points that may be the nearest somewhere in a block, in their order; how many.

    Beside the nearest to its middle: by how much that is nearer, in squares, is linear in the place, so that the least
    is at a corner.
    """
    best, nearest = np.inf, U(0)
    for k in range(count):
        dx, dy, dz = some[U(k), 0] - middle[0], some[U(k), 1] - middle[1], some[U(k), 2] - middle[2]
        squares[U(k)] = dx * dx + dy * dy + dz * dz
        if squares[U(k)] < best:
            best, nearest = squares[U(k)], U(k)
    a, b, c, found = some[nearest, 0], some[nearest, 1], some[nearest, 2], U(0)
    for k in range(count):
        x, y, z = some[U(k), 0], some[U(k), 1], some[U(k), 2]
        # Written in any case, and over it where it does not count: no branch to guess.
        left[found, 0], left[found, 1], left[found, 2], left_rows[found] = x, y, z, rows[U(k)]
        found += U(squares[U(k)] <= best + EQUAL + 2.0 * half * (abs(x - a) + abs(y - b) + abs(z - c)))
    return int(found)


@inside_kernels
def hold_at_eight(
    some: FloatArray,
    rows: IntArray,
    count: int,
    corner: tuple[int, int, int],
    shape: IntArray,
    best: FloatArray,
    nearest: IntArray,
    held: NDArray[np.int32],
    squares: NDArray[np.float32],
) -> None:
    """Write the nearest of some points to the two nodes a side from a corner on; of equally near ones the first."""
    for j in range(8):
        best[j], nearest[j] = np.inf, 0
    for k in range(count):
        x, y, z = some[U(k), 0] - corner[0], some[U(k), 1] - corner[1], some[U(k), 2] - corner[2]
        x0, y0, z0 = x * x, y * y, z * z
        x1, y1, z1 = (x - 1.0) * (x - 1.0), (y - 1.0) * (y - 1.0), (z - 1.0) * (z - 1.0)
        for j in range(8):
            square = (x1 if j & 4 else x0) + (y1 if j & 2 else y0) + (z1 if j & 1 else z0)
            is_less = square < best[j]
            best[j], nearest[j] = square if is_less else best[j], rows[U(k)] if is_less else nearest[j]
    for j in range(8):
        u, v, w = corner[0] + (j >> 2), corner[1] + (j >> 1 & 1), corner[2] + (j & 1)
        if u < shape[0] and v < shape[1] and w < shape[2]:
            node = U((u * shape[1] + v) * shape[2] + w)
            held[node], squares[node] = nearest[j], best[j]


@compiled
def nearest_at_nodes(
    first: int,
    last: int,
    places: FloatArray,
    shape: IntArray,
    held: NDArray[np.int32],
    squares: NDArray[np.float32],
) -> None:
    """Write the row of the nearest point to each node of blocks first to last, and the square of its distance.

    Of equally near ones the first. Blocks have `SIDE` nodes a side, the last axis runs fastest. Points are in cells
    from the first node. O(n) a block, and about O(points within a cell of the nearest) a node. Shapes: places (n, 3),
    n > 0, held and squares (nodes,).
    """
    n = len(places)
    # Of each block within the next; the last is written beyond what counts.
    some, rows = np.zeros((HALVED + 2, n + 1, 3)), np.zeros((HALVED + 2, n + 1), np.int64)
    counts, away, best, nearest = np.zeros(HALVED + 2, np.int64), np.zeros(n), np.zeros(8), np.zeros(8, np.int64)
    counts[0] = n
    for row in range(n):
        rows[0, row] = row
        some[0, row, 0], some[0, row, 1], some[0, row, 2] = places[row, 0], places[row, 1], places[row, 2]
    along, across = (shape[2] + SIDE - 1) // SIDE, (shape[1] + SIDE - 1) // SIDE
    for block in range(first, last):
        a, b, c = SIDE * (block // (along * across)), SIDE * (block // along % across), SIDE * (block % along)
        for k in range(8**HALVED):
            x, y, z, side = a, b, c, SIDE
            for level in range(HALVED + 1):
                # Three bits of the number for each halving: which half along each axis.
                rest = HALVED - level
                if level > 0:
                    half, side = k >> 3 * rest, side // 2
                    x, y, z = x + side * (half >> 2 & 1), y + side * (half >> 1 & 1), z + side * (half & 1)
                if x >= shape[0] or y >= shape[1] or z >= shape[2]:
                    break
                # Known from the first of the smallest blocks in it on.
                if k & (8**rest - 1):
                    continue
                reach = 0.5 * (side - 1)
                counts[level + 1] = left_in_block(
                    some[level],
                    rows[level],
                    counts[level],
                    (x + reach, y + reach, z + reach),
                    reach,
                    away,
                    some[level + 1],
                    rows[level + 1],
                )
                if rest == 0:
                    hold_at_eight(
                        some[level + 1],
                        rows[level + 1],
                        counts[level + 1],
                        (x, y, z),
                        shape,
                        best,
                        nearest,
                        held,
                        squares,
                    )
