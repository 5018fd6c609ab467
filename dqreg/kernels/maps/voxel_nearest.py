"""Nearest points of a map in voxels: first around the voxel of a place, then block by block farther off."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.maps.voxel_blocks import BITS, VOXELS, Voxels, block_at, place_in_block
from dqreg.kernels.maps.voxel_points import CELLS, Slots

# Voxels around one, itself first, then those that share a face, an edge, a corner with it.
BESIDE = np.array(
    sorted(((i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)), key=lambda step: np.abs(step).sum())
)
# No row; and a little less than one.
NONE, BELOW = -1, 1.0 - 1e-9


@inside_kernels
def _square_gap(step: int, offset: float, size: float) -> float:
    """Squared distance along one axis from a place, an offset into its voxel, to a voxel so many steps on."""
    if step == 0:
        return 0.0
    gap = step * size - offset if step > 0 else offset - (step + 1) * size
    return gap * gap


@inside_kernels
def _square_off(block: int, place: float, side: float) -> float:
    """Squared distance along one axis from a place to a block of voxels, less what rounding may add."""
    off = max(block * side - place, place - (block + 1) * side, 0.0)
    return off * off * BELOW


@inside_kernels
def _look_through(
    voxel: int,
    x: float,
    y: float,
    z: float,
    low: tuple[float, float, float],
    points: FloatArray,
    links: IntArray,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    best: FloatArray,
    row: int,
) -> int:
    """Row of the nearest point so far with those of a voxel, by its corner; of equally near ones the lower.

    With the squares of the distances to it and to the second, good to what slots are rounded by.
    """
    count = voxels[voxel, 1]
    if count <= members.shape[1]:
        u, v, t = x - low[0], y - low[1], z - low[2]
        for k in range(count):
            dx, dy, dz = slots[voxel, k, 0] - u, slots[voxel, k, 1] - v, slots[voxel, k, 2] - t
            d = dx * dx + dy * dy + dz * dz
            if d < best[0]:
                best[1], best[0], row = best[0], d, int(members[voxel, k])
            elif d < best[1]:
                best[1] = d
        return row
    other = voxels[voxel, 0]
    while other >= 0:
        dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
        d = dx * dx + dy * dy + dz * dz
        if d < best[0]:
            best[1], best[0], row = best[0], d, other
        elif d < best[1]:
            best[1] = d
        other = links[other, 0]
    return row


@inside_kernels
def nearest_in_voxels(
    x: float,
    y: float,
    z: float,
    within: float,
    size: float,
    points: FloatArray,
    links: IntArray,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    best: FloatArray,
) -> int:
    """Row of the nearest point, or -1 where none is nearer than a distance. O(1).

    ``best`` are the square of its distance, or of that one, and what no other is nearer than, squared.
    """
    a, b, c = int(np.floor(x / size)), int(np.floor(y / size)), int(np.floor(z / size))
    fx, fy, fz = x - a * size, y - b * size, z - c * size
    best[0], best[1] = within * within, np.inf
    row, cleared, block, ba, bb, bc = int(np.int64(NONE)), np.inf, int(np.int64(NONE)), a, b, c
    known = False
    for k in range(len(BESIDE)):
        da, db, dc = BESIDE[k, 0], BESIDE[k, 1], BESIDE[k, 2]
        gap = _square_gap(da, fx, size) + _square_gap(db, fy, size) + _square_gap(dc, fz, size)
        if gap > best[0]:
            cleared = min(cleared, gap)
            continue
        i, j, m = a + da, b + db, c + dc
        if not known or i >> BITS != ba or j >> BITS != bb or m >> BITS != bc:
            ba, bb, bc, known = i >> BITS, j >> BITS, m >> BITS, True
            block = block_at(ba, bb, bc, table, keys)
        if block >= 0:
            voxel = (int(cells[block, place_in_block(i, j, m)]) >> CELLS) - 1
            if voxel >= 0:
                low = i * size, j * size, m * size
                row = _look_through(voxel, x, y, z, low, points, links, voxels, slots, members, best, row)
    margin = size + min(fx, size - fx, fy, size - fy, fz, size - fz)
    if best[0] > margin * margin:
        row = _beyond(x, y, z, a, b, c, size, points, links, table, keys, cells, voxels, slots, members, best, row)
        cleared = min(cleared, best[0])
    else:
        cleared = min(cleared, margin * margin)
    best[1] = min(best[1], cleared)
    return row


@inside_kernels
def _beyond(
    x: float,
    y: float,
    z: float,
    a: int,
    b: int,
    c: int,
    size: float,
    points: FloatArray,
    links: IntArray,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    best: FloatArray,
    row: int,
) -> int:
    """The same farther off than the voxels around that of a place, block by block."""
    reach, side = np.sqrt(best[0]), size * 4.0
    fx, fy, fz = x - a * size, y - b * size, z - c * size
    for i in range(int(np.floor((x - reach) / side)), int(np.floor((x + reach) / side)) + 1):
        along = _square_off(i, x, side)
        for j in range(int(np.floor((y - reach) / side)), int(np.floor((y + reach) / side)) + 1):
            beside = along + _square_off(j, y, side)
            if beside > best[0]:
                continue
            for m in range(int(np.floor((z - reach) / side)), int(np.floor((z + reach) / side)) + 1):
                # The corners of what is looked through are farther off than the reach.
                if beside + _square_off(m, z, side) > best[0]:
                    continue
                block = block_at(i, j, m, table, keys)
                if block < 0:
                    continue
                for place in range(0, VOXELS, 4):
                    da, db = 4 * i + (place >> 4) - a, 4 * j + ((place >> 2) & 3) - b
                    across = _square_gap(da, fx, size) + _square_gap(db, fy, size)
                    # A row of four voxels, of which most are empty or too far.
                    for k in range(place, place + 4 if across <= best[0] else place):
                        voxel = (int(cells[block, k]) >> CELLS) - 1
                        dc = 4 * m + (k & 3) - c
                        if voxel < 0 or max(abs(da), abs(db), abs(dc)) <= 1:
                            continue
                        if across + _square_gap(dc, fz, size) <= best[0]:
                            low = (a + da) * size, (b + db) * size, (c + dc) * size
                            row = _look_through(voxel, x, y, z, low, points, links, voxels, slots, members, best, row)
    return row


@compiled
def distances_in_voxels(
    first: int,
    last: int,
    queries: FloatArray,
    within: float,
    size: float,
    points: FloatArray,
    links: IntArray,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    distances: FloatArray,
) -> None:
    """Write the distances of queries first to last from the nearest point, or ``within`` where that is less. O(1)."""
    best = np.zeros(2)
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        nearest_in_voxels(x, y, z, within, size, points, links, table, keys, cells, voxels, slots, members, best)
        distances[i] = np.sqrt(best[0])
