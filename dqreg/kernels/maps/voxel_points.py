"""Which points a map takes: so many a voxel at most, and so far apart within it at least, as KISS-ICP's map does.

Of all points that it is given, taken or not, the map keeps the sums that planes are made of, cell by cell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.maps.voxel_blocks import BITS, Voxels, block_at, place_in_block, put_block

# Cells of a voxel, two a side, and what is summed in each, from its middle on: number, x, y, z, xx, yy, zz, xy, xz, yz.
CELLS, SUMS = 8, 10

Slots = NDArray[np.float32]


@compiled
def admit_points(
    given: FloatArray,
    size: float,
    apart: float,
    most: int,
    points: FloatArray,
    links: IntArray,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    voxels: IntArray,
    slots: Slots,
    members: Voxels,
    sums: Slots,
    counts: IntArray,
) -> None:
    """Append those of some points that the map takes, one after the other. O(1) each.

    ``voxels`` are the first point of each and how many there are; ``links`` lead from each point to another one of its
    voxel, -1 at the end, and to the voxel. The first ones of a voxel are in ``slots`` as well, (v, s, 3), from its
    corner on, with their rows: they are looked through without a miss of the cache for each. ``cells``, (b, 64), are
    one more than the numbers of the voxels of a block, before eight bits that tell which of its cells hold something.
    ``counts`` are the points, the voxels and the blocks so far.
    """
    # Along a curve the next point lies mostly in the same block.
    u = v = w = int(np.int64(0))
    block = int(np.int64(-1))
    for i in range(len(given)):
        x, y, z = given[i, 0], given[i, 1], given[i, 2]
        a, b, c = int(np.floor(x / size)), int(np.floor(y / size)), int(np.floor(z / size))
        place = place_in_block(a, b, c)
        if block < 0 or a >> BITS != u or b >> BITS != v or c >> BITS != w:
            u, v, w = a >> BITS, b >> BITS, c >> BITS
            block = block_at(u, v, w, table, keys)
        if block < 0:
            block = counts[2]
            counts[2] += 1
            keys[block, 0], keys[block, 1], keys[block, 2] = a >> BITS, b >> BITS, c >> BITS
            put_block(block, table, keys)
        voxel, row = (int(cells[block, place]) >> CELLS) - 1, counts[0]
        if voxel < 0:
            voxel = counts[1]
            counts[1] += 1
            cells[block, place], voxels[voxel, 0], voxels[voxel, 1], links[row, 0] = (voxel + 1) << CELLS, row, 0, -1
            taken = True
        else:
            taken = voxels[voxel, 1] < most
            if taken and voxels[voxel, 1] <= members.shape[1]:
                taken = _is_apart(x - a * size, y - b * size, z - c * size, apart, slots, voxel, voxels[voxel, 1])
            elif taken:
                taken = _is_apart_of_all(x, y, z, apart, points, links, voxels[voxel, 0])
        cell = _add_to_cell(x / size - a, y / size - b, z / size - c, size, sums, voxel * CELLS)
        cells[block, place] |= 1 << cell
        if not taken:
            continue
        if row != voxels[voxel, 0]:
            first = voxels[voxel, 0]
            links[row, 0], links[first, 0] = links[first, 0], row
        slot = voxels[voxel, 1]
        if slot < members.shape[1]:
            members[voxel, slot] = row
            slots[voxel, slot, 0], slots[voxel, slot, 1] = x - a * size, y - b * size
            slots[voxel, slot, 2] = z - c * size
        counts[0] += 1
        voxels[voxel, 1] += 1
        links[row, 1] = voxel
        points[row, 0], points[row, 1], points[row, 2] = x, y, z


@inside_kernels
def _is_apart(u: float, v: float, t: float, apart: float, slots: Slots, voxel: int, count: int) -> bool:
    """Whether a place, from the corner of its voxel on, is so far from all points of the voxel, which are in slots."""
    for k in range(count):
        dx, dy, dz = slots[voxel, k, 0] - u, slots[voxel, k, 1] - v, slots[voxel, k, 2] - t
        if dx * dx + dy * dy + dz * dz < apart * apart:
            return False
    return True


@inside_kernels
def _is_apart_of_all(
    x: float, y: float, z: float, apart: float, points: FloatArray, links: IntArray, first: int
) -> bool:
    """The same of a voxel with more points than slots, by its first point."""
    other = first
    while other >= 0:
        dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
        if dx * dx + dy * dy + dz * dz < apart * apart:
            return False
        other = links[other, 0]
    return True


@inside_kernels
def _add_to_cell(fx: float, fy: float, fz: float, size: float, sums: Slots, first: int) -> int:
    """Add a point, by where it lies in its voxel, 0 to 1, to its cell, of which the voxel's first is given; which."""
    a, b, c = int(fx >= 0.5), int(fy >= 0.5), int(fz >= 0.5)
    s = first + 4 * a + 2 * b + c
    x, y, z = (fx - 0.25 - 0.5 * a) * size, (fy - 0.25 - 0.5 * b) * size, (fz - 0.25 - 0.5 * c) * size
    sums[s, 0] += 1.0
    sums[s, 1] += x
    sums[s, 2] += y
    sums[s, 3] += z
    sums[s, 4] += x * x
    sums[s, 5] += y * y
    sums[s, 6] += z * z
    sums[s, 7] += x * y
    sums[s, 8] += x * z
    sums[s, 9] += y * z
    return s - first
