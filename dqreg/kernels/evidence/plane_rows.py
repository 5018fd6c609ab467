"""Rows of the least-squares problems of distances along normals: motions, strains, bends and a torsion."""

from __future__ import annotations

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled


@compiled
def plane_row_columns(
    first: int, last: int, points: FloatArray, normals: FloatArray, centre: FloatArray, lever: float, rows: FloatArray
) -> None:
    """Write displacements along the normals by rotations about a centre times the lever, and by translations. O(n).

    Shapes: points, normals (n, 3), rows (6, n), one motion a row.
    """
    for i in range(first, last):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        u, v, w = normals[i, 0], normals[i, 1], normals[i, 2]
        rows[0, i], rows[1, i], rows[2, i] = (y * w - z * v) / lever, (z * u - x * w) / lever, (x * v - y * u) / lever
        rows[3, i], rows[4, i], rows[5, i] = u, v, w


@compiled
def strain_row_columns(
    first: int,
    last: int,
    arms: FloatArray,
    normals: FloatArray,
    axes: FloatArray,
    lever: float,
    rows: FloatArray,
) -> None:
    """Write displacements along the normals by unit strains, and by bends and a torsion of the first axis. O(n).

    Strains are of the tensor (xx, yy, zz, xy, xz, yz). Rows are over the lever, those of the second order over its
    square. Shapes: arms, normals (n, 3); axes (3, 3), one a column; rows (9, n).
    """
    for i in range(first, last):
        x, y, z = arms[i, 0], arms[i, 1], arms[i, 2]
        u, v, w = normals[i, 0], normals[i, 1], normals[i, 2]
        rows[0, i], rows[1, i], rows[2, i] = u * x / lever, v * y / lever, w * z / lever
        rows[3, i], rows[4, i], rows[5, i] = (u * y + v * x) / lever, (u * z + w * x) / lever, (v * z + w * y) / lever
        along = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
        one = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        two = x * axes[0, 2] + y * axes[1, 2] + z * axes[2, 2]
        n_along = u * axes[0, 0] + v * axes[1, 0] + w * axes[2, 0]
        n_one = u * axes[0, 1] + v * axes[1, 1] + w * axes[2, 1]
        n_two = u * axes[0, 2] + v * axes[1, 2] + w * axes[2, 2]
        # A bent beam: the axis moves across, and its sections turn with it. A twisted one: they turn about the axis.
        rows[6, i] = (n_one * along * along - 2.0 * n_along * along * one) / lever / lever
        rows[7, i] = (n_two * along * along - 2.0 * n_along * along * two) / lever / lever
        rows[8, i] = along * (n_one * two - n_two * one) / lever / lever
