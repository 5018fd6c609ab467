"""Planes through the points of neighbouring cells, from the moments of these: no neighbour is searched for."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.cells.cell_blocks import BLOCK_CELLS, BLOCKS_AROUND, cells_around
from dqreg.kernels.cells.grid_cells import Slots
from dqreg.kernels.clouds.many_axes import AXES, LANES, ROWS, diagonalise_lanes
from dqreg.kernels.clouds.plane_fits import least_of_lane
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.order.morton import Codes

# Cells around one without which there are no sides to it.
MIN_CELLS = 8
# What is kept of a cell until its plane is fitted: weight, cells, squared distance of the farthest, sum of the offsets,
# their weighted mean, and of their squared lengths the mean, products with the offsets and squares about it.
KEPT_ROWS = 14
# Share of the squares of these lengths that the plane itself does not explain, below which they tell of no bend.
MIN_BEND_SHARE = 1e-3


@compiled
def cell_planes(
    first: int,
    last: int,
    starts: IntArray,
    blocks: Codes,
    table: Slots,
    means: FloatArray,
    weights: FloatArray,
    scatters: FloatArray,
    reach: float,
    fewest: float,
    line: float,
    share: float,
    lined: float,
    asked: BoolArray,
    fits: FloatArray,
    rims: BoolArray,
) -> None:
    """Write planes at the cells of blocks first to last, through the cells whose means are within reach of theirs.

    O(1) a cell. A block is eight cells and holds those from its start to the next one's, in Morton order. There is no
    plane of fewer points, nor where the smaller variance is below a share of the larger; a rim is where the mean of the
    cells is farther off within the plane than a share of the farthest one, and they are no line. Cells that are not
    asked are left as they are. Shapes: starts (b + 1,), blocks (b,), means (m, 3), weights (m,), scatters (m, 6), asked
    (m,), fits (m, 7): normal, residual, lever, distance to the next mean, height along the normal from the mean to the
    surface that its neighbours make, see `_height`; NaN where there is no plane.
    """
    near, within = np.zeros(BLOCKS_AROUND * BLOCK_CELLS, np.int64), np.zeros(BLOCKS_AROUND * BLOCK_CELLS, np.int64)
    beside, found_blocks = np.zeros(9, np.uint64), np.zeros(BLOCKS_AROUND + 1, np.int64)
    lanes, kept = np.zeros((ROWS, LANES)), np.zeros((KEPT_ROWS, LANES))
    rows, places = np.zeros(LANES, np.int64), np.zeros((4, BLOCKS_AROUND * BLOCK_CELLS))
    # Of the type that it has later: for plain zeros what it is given to would be compiled once more.
    none = int(np.int64(0))
    waiting = none
    for block in range(first, last):
        if not asked[starts[block] : starts[block + 1]].any():
            continue
        count = cells_around(block, starts, blocks, table, beside, found_blocks, near)
        for k in range(count):
            for axis in range(3):
                places[axis, k] = means[near[k], axis]
        for i in range(starts[block], starts[block + 1]):
            if not asked[i]:
                continue
            found = _within_reach(means[i, 0], means[i, 1], means[i, 2], count, places, reach, within)
            nearest = _moments(i, found, within, near, places, means, weights, scatters, waiting, lanes, kept)
            fits[i, 5] = np.sqrt(nearest)
            if kept[0, waiting] < fewest or kept[1, waiting] < MIN_CELLS:
                fits[i, 0] = np.nan
                continue
            rows[waiting] = i
            waiting += 1
            if waiting == LANES:
                _write_planes(waiting, rows, lanes, kept, line, share, lined, fits, rims)
                waiting = none
    _write_planes(waiting, rows, lanes, kept, line, share, lined, fits, rims)


@inside_kernels
def _write_planes(
    count: int,
    rows: IntArray,
    lanes: FloatArray,
    kept: FloatArray,
    line: float,
    share: float,
    lined: float,
    fits: FloatArray,
    rims: BoolArray,
) -> None:
    """Write the planes of some rows from their scatters, see `diagonalise_lanes`, and what was kept of them."""
    diagonalise_lanes(count, lanes)
    for lane in range(count):
        i, weight = rows[lane], kept[0, lane]
        least, small, large = least_of_lane(lanes, lane)
        if small <= line * large:
            fits[i, 0] = np.nan
            continue
        height, square = 0.0, 0.0
        for k in range(3):
            fits[i, k] = lanes[AXES + 3 * least + k, lane]
            height += kept[3 + k, lane] * fits[i, k]
            square += kept[3 + k, lane] ** 2
        fits[i, 3] = np.sqrt(max(lanes[least, lane], 0.0) / (weight - 3.0))
        fits[i, 4] = 1.0 / (weight / small + weight / large)
        fits[i, 6] = _height(lane, least, lanes, kept)
        off = np.sqrt(max(square - height * height, 0.0)) > share * np.sqrt(kept[2, lane]) * kept[1, lane]
        rims[i] = off and small > lined * large


@inside_kernels
def _height(lane: int, least: int, lanes: FloatArray, kept: FloatArray) -> float:
    """Height of the surface through the neighbouring means, a plane and its mean bend, over the mean in their middle.

    Their heights h over the plane of their scatter regressed on ``q = a^2 + b^2 + h^2`` of their offsets from that
    mean: a saddle has no height in its middle. Along the axes of the scatter the normal equations are diagonal but q.
    """
    one, two = (least + 1) % 3, (least + 2) % 3
    h = a = b = with_h = with_a = with_b = 0.0
    for k in range(3):
        mean, product = kept[6 + k, lane], kept[10 + k, lane]
        along_h, along_a, along_b = (
            lanes[AXES + 3 * least + k, lane],
            lanes[AXES + 3 * one + k, lane],
            lanes[AXES + 3 * two + k, lane],
        )
        h, a, b = h + mean * along_h, a + mean * along_a, b + mean * along_b
        with_h, with_a, with_b = with_h + product * along_h, with_a + product * along_a, with_b + product * along_b
    per_a, per_b = with_a / lanes[one, lane], with_b / lanes[two, lane]
    left = kept[13, lane] - per_a * with_a - per_b * with_b
    bend = with_h / left if left > MIN_BEND_SHARE * kept[13, lane] else 0.0
    over_plane: float = h - bend * (kept[9, lane] - per_a * a - per_b * b)
    return over_plane


@inside_kernels
def _within_reach(x: float, y: float, z: float, count: int, places: FloatArray, reach: float, within: IntArray) -> int:
    """Write the squared distances of places, (3, count), below them, and which are within reach; how many."""
    for k in range(count):
        dx, dy, dz = places[0, k] - x, places[1, k] - y, places[2, k] - z
        places[3, k] = dx * dx + dy * dy + dz * dz
    found, limit = 0, reach * reach
    for k in range(count):
        # Written each time: which are is as good as random.
        within[found] = k
        found += 0 if places[3, k] > limit else 1
    return found


@inside_kernels
def _moments(
    i: int,
    found: int,
    within: IntArray,
    near: IntArray,
    places: FloatArray,
    means: FloatArray,
    weights: FloatArray,
    scatters: FloatArray,
    lane: int,
    lanes: FloatArray,
    kept: FloatArray,
) -> float:
    """Write the scatter of the cells within reach about their mean, and what is kept; squared distance to the next."""
    # By name: elements of arrays would be written and read again for every cell.
    weight, farthest, nearest = 0.0, 0.0, np.inf
    qw = qq = qx = qy = qz = 0.0
    wx = wy = wz = sx = sy = sz = 0.0
    xx = yy = zz = xy = xz = yz = 0.0
    at, bt, ct = means[i, 0], means[i, 1], means[i, 2]
    for place in range(found):
        k = within[place]
        j = near[k]
        x, y, z, squared = places[0, k] - at, places[1, k] - bt, places[2, k] - ct, places[3, k]
        if j != i:
            farthest, nearest = max(farthest, squared), min(nearest, squared)
        w = weights[j]
        weight += w
        q = w * squared
        qw, qq, qx, qy, qz = qw + q, qq + q * squared, qx + q * x, qy + q * y, qz + q * z
        wx, wy, wz, sx, sy, sz = wx + w * x, wy + w * y, wz + w * z, sx + x, sy + y, sz + z
        xx, yy, zz = xx + w * x * x + scatters[j, 0], yy + w * y * y + scatters[j, 1], zz + w * z * z + scatters[j, 2]
        xy, xz, yz = xy + w * x * y + scatters[j, 3], xz + w * x * z + scatters[j, 4], yz + w * y * z + scatters[j, 5]
    mx, my, mz = wx / weight, wy / weight, wz / weight
    lanes[0, lane], lanes[1, lane], lanes[2, lane] = xx - weight * mx * mx, yy - weight * my * my, zz - weight * mz * mz
    lanes[3, lane], lanes[4, lane], lanes[5, lane] = xy - weight * mx * my, xz - weight * mx * mz, yz - weight * my * mz
    kept[0, lane], kept[1, lane], kept[2, lane] = weight, found - 1.0, farthest
    kept[3, lane], kept[4, lane], kept[5, lane] = sx, sy, sz
    kept[6, lane], kept[7, lane], kept[8, lane], kept[9, lane] = mx, my, mz, qw / weight
    kept[10, lane], kept[11, lane], kept[12, lane] = qx - qw * mx, qy - qw * my, qz - qw * mz
    kept[13, lane] = qq - qw * qw / weight
    return nearest
