"""Whether what a plane of a map was fitted to lies on two lines: two rings of a LiDAR, perhaps on two faces."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.compiling.compiled import inside_kernels
from dqreg.kernels.maps.cells_around import WIDEST
from dqreg.kernels.maps.voxel_points import Slots

# What points of a cell count, by how many cells around one are looked through and how many steps it is from that.
GRADES = 0.5 ** (np.arange(3 * WIDEST + 1) / np.maximum(np.arange(WIDEST + 1), 1)[:, None])
# Directions within a plane, of which each moment is a sum of those of the axes: cosines and sines of each.
ANGLES = np.pi * np.arange(8) / 8
COS, SIN = np.cos(ANGLES), np.sin(ANGLES)
SECOND = np.stack([COS**2, 2.0 * COS * SIN, SIN**2], axis=1)
THIRD = np.stack([COS**3, 3.0 * COS**2 * SIN, 3.0 * COS * SIN**2, SIN**3], axis=1)
FOURTH = np.stack([COS**4, 4.0 * COS**3 * SIN, 6.0 * COS**2 * SIN**2, 4.0 * COS * SIN**3, SIN**4], axis=1)


@inside_kernels
def least_spread(count: int, around: IntArray, reach: int, half: float, sums: Slots, normal: FloatArray) -> float:
    """How far the middles of cells are from lying on two lines within a plane: 0 where they do, 2 of a normal spread.

    The kurtosis less one and the squared skewness, in the direction where that is least: Pearson's inequality, an
    equation for two values alone. The plane and the middle are those of `_plane_of`.
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    # Two axes within the plane.
    ux, uy, uz = (ny, -nx, 0.0) if abs(nz) < 0.9 else (0.0, nz, -ny)
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    n = uu = uv = vv = uuu = uuv = uvv = vvv = uuuu = uuuv = uuvv = uvvv = vvvv = 0.0
    for k in range(count):
        row, i, j, m = around[k, 0], around[k, 1], around[k, 2], around[k, 3]
        held = float(sums[row, 0])
        w, each = held * GRADES[reach, abs(i) + abs(j) + abs(m)], 1.0 / held
        x = each * float(sums[row, 1]) + i * half - normal[3]
        y = each * float(sums[row, 2]) + j * half - normal[4]
        z = each * float(sums[row, 3]) + m * half - normal[5]
        u, v = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
        a, b, c = u * u, u * v, v * v
        n, uu, uv, vv = n + w, uu + w * a, uv + w * b, vv + w * c
        uuu, uuv, uvv, vvv = uuu + w * a * u, uuv + w * a * v, uvv + w * c * u, vvv + w * c * v
        uuuu, uuuv, uuvv = uuuu + w * a * a, uuuv + w * a * b, uuvv + w * a * c
        uvvv, vvvv = uvvv + w * b * c, vvvv + w * c * c
    least = np.inf
    for d in range(len(SECOND)):
        second = (SECOND[d, 0] * uu + SECOND[d, 1] * uv + SECOND[d, 2] * vv) / n
        third = (THIRD[d, 0] * uuu + THIRD[d, 1] * uuv + THIRD[d, 2] * uvv + THIRD[d, 3] * vvv) / n
        fourth = FOURTH[d, 0] * uuuu + FOURTH[d, 1] * uuuv + FOURTH[d, 2] * uuvv
        fourth = (fourth + FOURTH[d, 3] * uvvv + FOURTH[d, 4] * vvvv) / n
        if second > 0.0:
            square = second * second
            least = min(least, (fourth - third * third / second) / square - 1.0)
    return least
