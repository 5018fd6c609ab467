"""Planes of a map where a frame meets it: by the cell that a point lies in, without a search for neighbours."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels
from dqreg.kernels.maps.cells_around import COLUMNS, ROOM, cells_around
from dqreg.kernels.maps.voxel_blocks import Voxels, block_at, place_in_block
from dqreg.kernels.maps.voxel_nearest import NONE
from dqreg.kernels.maps.voxel_planes import fit_cell
from dqreg.kernels.maps.voxel_points import CELLS, Slots


@compiled
def planes_in_cells(
    first: int,
    last: int,
    queries: FloatArray,
    size: float,
    thin: float,
    table: Voxels,
    keys: IntArray,
    cells: Voxels,
    sums: Slots,
    planes: FloatArray,
    state: int,
    far: float,
    asked: IntArray,
    rows: IntArray,
    distances: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    variances: FloatArray,
    roughness: FloatArray,
) -> None:
    """Write the planes of the cells in which queries first to last lie, (m, 3), or of the nearest beside. O(1) each.

    ``asked``, (m, 3), are the cells of the queries before: where one lies in the same, its plane is the same as well.
    Where nothing stands, the row is -1 and the distance ``far``; where what stands there fixes no plane, the normal is
    zero and the distance 0.
    """
    plane, half, around = np.zeros(7), 0.5 * size, np.zeros((ROOM, COLUMNS), np.int64)
    # Of the type of other numbers: for a plain one what it is given to would be compiled once more.
    beside = int(np.int64(1))
    for i in range(first, last):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        a, b, c = int(np.floor(x / half)), int(np.floor(y / half)), int(np.floor(z / half))
        if a != asked[i, 0] or b != asked[i, 1] or c != asked[i, 2]:
            asked[i, 0], asked[i, 1], asked[i, 2] = a, b, c
            cell = _held_cell(a, b, c, table, keys, cells)
            if cell < 0:
                count = cells_around(a, b, c, beside, table, keys, cells, around)
                k = _nearest_of(count, around, x / half - a - 0.5, y / half - b - 0.5, z / half - c - 0.5, half, sums)
                if k >= 0:
                    cell, a, b, c = around[k, 0], a + around[k, 1], b + around[k, 2], c + around[k, 3]
            rows[i], variances[i], roughness[i] = cell, np.inf, 0.0
            if cell >= 0:
                if planes[cell, 4] <= state:
                    fit_cell(cell, a, b, c, size, thin, table, keys, cells, sums, planes, state, plane, around)
                variances[i], roughness[i] = planes[cell, 3], planes[cell, 8]
            if variances[i] < np.inf:
                for k in range(3):
                    feet[i, k], normals[i, k] = planes[cell, 5 + k], planes[cell, k]
            else:
                normals[i, 0] = normals[i, 1] = normals[i, 2] = 0.0
        if variances[i] < np.inf:
            u, v, w = x - feet[i, 0], y - feet[i, 1], z - feet[i, 2]
            distances[i] = abs(u * normals[i, 0] + v * normals[i, 1] + w * normals[i, 2])
        else:
            feet[i, 0], feet[i, 1], feet[i, 2] = x, y, z
            distances[i] = far if rows[i] < 0 else 0.0


@compiled
def leave_out_beams(
    points: FloatArray,
    eye: FloatArray,
    sine: float,
    feet: FloatArray,
    normals: FloatArray,
    distances: FloatArray,
    variances: FloatArray,
    in_cells: bool,
) -> None:
    """Take away the planes that lie along the beams from an eye, (3,), to their points, (n, 3), but for a sine. O(n).

    What is left is that of a cell, or of a nearest point, that fixes no plane.
    """
    for i in range(len(points)):
        if not variances[i] < np.inf:
            continue
        x, y, z = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
        height = x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2]
        if not height * height < sine * sine * (x * x + y * y + z * z):
            continue
        variances[i] = np.inf
        normals[i, 0] = normals[i, 1] = normals[i, 2] = 0.0
        if in_cells:
            feet[i, 0], feet[i, 1], feet[i, 2], distances[i] = points[i, 0], points[i, 1], points[i, 2], 0.0


@inside_kernels
def _held_cell(a: int, b: int, c: int, table: Voxels, keys: IntArray, cells: Voxels) -> int:
    """Number of a cell that holds points, by where it is; -1 where there is none."""
    block = block_at(a >> 3, b >> 3, c >> 3, table, keys)
    if block < 0:
        return int(np.int64(NONE))
    held = int(cells[block, place_in_block(a >> 1, b >> 1, c >> 1)])
    s = 4 * (a & 1) + 2 * (b & 1) + (c & 1)
    return ((held >> CELLS) - 1) * CELLS + s if (held >> s) & 1 else int(np.int64(NONE))


@inside_kernels
def _nearest_of(count: int, around: IntArray, x: float, y: float, z: float, half: float, sums: Slots) -> int:
    """Which of the cells around one has the middle of its points nearest to a place, in cells from its own middle."""
    least, found = np.inf, int(np.int64(NONE))
    for k in range(count):
        s = around[k, 0]
        n = sums[s, 0] * half
        dx, dy, dz = (
            around[k, 1] + sums[s, 1] / n - x,
            around[k, 2] + sums[s, 2] / n - y,
            around[k, 3] + sums[s, 3] / n - z,
        )
        if dx * dx + dy * dy + dz * dz < least:
            least, found = dx * dx + dy * dy + dz * dz, k
    return found
