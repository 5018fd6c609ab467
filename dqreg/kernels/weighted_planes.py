"""Weighted point-to-plane correspondences: the sums of their cost."""

from __future__ import annotations

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled
from dqreg.kernels.pose_forms import SUMS, add_pair

# Columns of the sums: those of `form_of_sums`, and after them the sums of weights, of points and of their feet, and the
# count.
COLUMNS = SUMS + 8


@compiled
def plane_sums(
    first: int,
    last: int,
    points: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    origins: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the point-to-plane cost of one chunk of correspondences, (81,), see `form_of_sums`. O(n).

    Points count from the first of the origins, (2, 3), feet from the second. A correspondence without
    weight or without a normal does not count.
    """
    total = sums[first // chunk]
    for i in range(first, last):
        w, nx, ny, nz = weights[i], normals[i, 0], normals[i, 1], normals[i, 2]
        if not w > 0.0 or (nx == 0.0 and ny == 0.0 and nz == 0.0):
            continue
        p, q, r = points[i, 0] - origins[0, 0], points[i, 1] - origins[0, 1], points[i, 2] - origins[0, 2]
        x, y, z = feet[i, 0] - origins[1, 0], feet[i, 1] - origins[1, 1], feet[i, 2] - origins[1, 2]
        xx, yy, zz, xy, xz, yz = w * nx * nx, w * ny * ny, w * nz * nz, w * nx * ny, w * nx * nz, w * ny * nz
        height = nx * x + ny * y + nz * z
        sides = w * height * nx, w * height * ny, w * height * nz
        at = add_pair((p, q, r), (xx, yy, zz, xy, xz, yz), sides, total)
        total[at] += w * height * height
        for value in (w, w * p, w * q, w * r, w * x, w * y, w * z, 1.0):
            at += 1
            total[at] += value
