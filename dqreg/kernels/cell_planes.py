"""Planes through the points of neighbouring cells, from the moments of these: no neighbour is searched for."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.cell_moments import Codes, slot_of
from dqreg.kernels.compiled import compiled
from dqreg.kernels.plane_fits import ELEMENTS, diagonalise

# Every third bit of a Morton code, from the lowest on: the number of a cell along one axis.
ALONG_Z, ALONG_Y, ALONG_X = (np.uint64(0x1249249249249249 << k) for k in range(3))
# Blocks of two cells a side, and those around one; cells of these.
BLOCKS, CELLS = 27, 8
# Cells around one without which there are no sides to it.
SIDES = 8


@compiled
def cell_planes(
    first: int,
    last: int,
    starts: IntArray,
    blocks: Codes,
    table: IntArray,
    means: FloatArray,
    weights: FloatArray,
    scatters: FloatArray,
    reach: float,
    fewest: float,
    line: float,
    share: float,
    lined: float,
    fits: FloatArray,
    rims: BoolArray,
) -> None:
    """Write planes at the cells of blocks first to last, through the cells whose means are within reach of theirs.

    O(1) a cell. A block is eight cells and holds those from its start to the next one's, in Morton order. There is no
    plane of fewer points, nor where the smaller variance is below a share of the larger; a rim is where the mean of the
    cells is farther off within the plane than a share of the farthest one, and they are no line. Shapes: starts
    (b + 1,), blocks (b,), means (m, 3), weights (m,), scatters (m, 6), fits (m, 6): normal, residual, lever, distance
    to the next mean; NaN where there is no plane.
    """
    near, a, v = np.zeros(BLOCKS * CELLS, np.int64), np.zeros(ELEMENTS), np.zeros((3, 3))
    sums = np.zeros(3)
    for block in range(first, last):
        count = _cells_around(blocks[block], starts, blocks, table, near)
        for i in range(starts[block], starts[block + 1]):
            weight, cells, farthest, nearest = _moments(i, near[:count], means, weights, scatters, reach, sums, a)
            fits[i, 5] = np.sqrt(nearest)
            diagonalise(a, v)
            least = 0
            for k in range(1, 3):
                if a[k] < a[least]:
                    least = k
            one, two = a[(least + 1) % 3], a[(least + 2) % 3]
            small, large = min(one, two), max(one, two)
            if weight < fewest or cells < SIDES or small <= line * large:
                fits[i, 0] = np.nan
                continue
            for k in range(3):
                fits[i, k] = v[k, least]
            fits[i, 3] = np.sqrt(max(a[least], 0.0) / (weight - 3.0))
            fits[i, 4] = 1.0 / (weight / small + weight / large)
            height = sums[0] * v[0, least] + sums[1] * v[1, least] + sums[2] * v[2, least]
            beside = max(sums[0] ** 2 + sums[1] ** 2 + sums[2] ** 2 - height * height, 0.0)
            off = np.sqrt(beside) > share * np.sqrt(farthest) * cells
            rims[i] = off and small > lined * large


@compiled
def _cells_around(block: np.uint64, starts: IntArray, blocks: Codes, table: IntArray, near: IntArray) -> int:
    """Write the cells of a block and of those around it; how many they are."""
    count = 0
    for x in range(-1, 2):
        for y in range(-1, 2):
            for z in range(-1, 2):
                code = _moved(_moved(_moved(block, ALONG_X, x), ALONG_Y, y), ALONG_Z, z)
                row = table[slot_of(code, blocks, table)]
                if row >= 0:
                    for cell in range(starts[row], starts[row + 1]):
                        near[count] = cell
                        count += 1
    return count


@compiled
def _moved(code: np.uint64, mask: np.uint64, step: int) -> np.uint64:
    """The code of a cell next to another, or the same; beyond the first and the last it starts from the other end."""
    one = mask & (~mask + np.uint64(1))
    kept = code & ~mask
    if step > 0:
        return kept | (((code | ~mask) + one) & mask)
    return kept | (((code & mask) - one) & mask) if step < 0 else code


@compiled
def _moments(
    i: int,
    near: IntArray,
    means: FloatArray,
    weights: FloatArray,
    scatters: FloatArray,
    reach: float,
    sums: FloatArray,
    a: FloatArray,
) -> tuple[float, int, float, float]:
    """Write the sum, (3,), and the scatter of cells about their mean; weight, cells, squared distances."""
    # By name: elements of arrays would be written and read again for every cell.
    weight, cells, farthest, nearest = 0.0, 0, 0.0, np.inf
    wx = wy = wz = sx = sy = sz = 0.0
    xx = yy = zz = xy = xz = yz = 0.0
    at, bt, ct = means[i, 0], means[i, 1], means[i, 2]
    for j in near:
        x, y, z = means[j, 0] - at, means[j, 1] - bt, means[j, 2] - ct
        squared = x * x + y * y + z * z
        if squared > reach * reach:
            continue
        if j != i:
            cells, farthest, nearest = cells + 1, max(farthest, squared), min(nearest, squared)
        w = weights[j]
        weight += w
        wx, wy, wz, sx, sy, sz = wx + w * x, wy + w * y, wz + w * z, sx + x, sy + y, sz + z
        xx, yy, zz = xx + w * x * x + scatters[j, 0], yy + w * y * y + scatters[j, 1], zz + w * z * z + scatters[j, 2]
        xy, xz, yz = xy + w * x * y + scatters[j, 3], xz + w * x * z + scatters[j, 4], yz + w * y * z + scatters[j, 5]
    mx, my, mz = wx / weight, wy / weight, wz / weight
    a[0], a[1], a[2] = xx - weight * mx * mx, yy - weight * my * my, zz - weight * mz * mz
    a[3], a[4], a[5] = xy - weight * mx * my, xz - weight * mx * mz, yz - weight * my * mz
    sums[0], sums[1], sums[2] = sx, sy, sz
    return weight, cells, farthest, nearest
