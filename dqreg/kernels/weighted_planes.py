"""Weighted point-to-plane correspondences: the sums of their cost, and the scatter of each orientation."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiled import compiled, inside_kernels
from dqreg.kernels.pose_forms import SUMS, add_pair

# Columns of the sums: those of `form_of_sums`, and after them the sums of weights, of points and of their feet, and the
# count.
COLUMNS = SUMS + 8
NOTHING = np.zeros(0)


@compiled
def plane_sums(
    first: int,
    last: int,
    points: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    precisions: FloatArray,
    cells: int,
    origins: FloatArray,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Add the point-to-plane cost of one chunk of correspondences, (81,), see `form_of_sums`. O(n).

    Points count from the first of the origins, (2, 3), feet from the second. Precisions are of each cell of normals,
    see `cell_of`, or none at all. A correspondence without weight or without a normal does not count.
    """
    total = sums[first // chunk]
    for i in range(first, last):
        w, nx, ny, nz = weights[i], normals[i, 0], normals[i, 1], normals[i, 2]
        if not w > 0.0 or (nx == 0.0 and ny == 0.0 and nz == 0.0):
            continue
        if len(precisions):
            w *= precisions[cell_of(normals, i, cells)]
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


@inside_kernels
def cell_of(normals: FloatArray, i: int, cells: int) -> np.int64:
    """Cell of a unit normal in the cube around it, so many along each axis and one more."""
    cell = np.int64(0)
    for k in range(3):
        place = (normals[i, k] + 1.0) * (0.5 * cells) + 0.5
        # Rounding may leave the cube, and what is no number has no cell of its own.
        cell = cell * (cells + 1) + (np.int64(place) if 0.0 < place < cells + 1.0 else np.int64(0))
    return cell


@compiled
def orientation_sums(
    first: int,
    last: int,
    moved: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    scatter: FloatArray,
    cells: int,
    chunk: int,
    bins: FloatArray,
) -> None:
    """Add weighted squares of the distances along the normals, and weights, of each cell of normals. O(n).

    Scatter is added to the squares, (n,), or none at all. Shapes: moved (n, 3), the points beside their feet; bins
    (chunks, 2, m).
    """
    own = bins[first // chunk]
    for i in range(first, last):
        w = weights[i]
        if w > 0.0:
            aside = 0.0
            for k in range(3):
                aside += (moved[i, k] - feet[i, k]) * normals[i, k]
            cell = cell_of(normals, i, cells)
            own[0, cell] += w * (aside * aside + (scatter[i] if len(scatter) else 0.0))
            own[1, cell] += w


@compiled
def orientation_precisions(bins: FloatArray, beforehand: float, least: float, precisions: FloatArray) -> None:
    """Write one over the variance of all rows of a cell, (m,); the weighted mean is one. O(m).

    ``beforehand`` is the weight of the usual variance in each cell, and ``least`` the least variance, in usual ones.
    Cells without weight get one.
    """
    total, weight, scale = 0.0, 0.0, 0.0
    for cell in range(bins.shape[2]):
        for chunk in range(1, len(bins)):
            bins[0, 0, cell] += bins[chunk, 0, cell]
            bins[0, 1, cell] += bins[chunk, 1, cell]
        total, weight = total + bins[0, 0, cell], weight + bins[0, 1, cell]
    usual = total / weight if weight > 0.0 else 0.0
    for cell in range(bins.shape[2]):
        held = bins[0, 1, cell]
        precisions[cell] = 1.0
        if held > 0.0 and usual > 0.0:
            variance = (bins[0, 0, cell] + beforehand * usual) / (held + beforehand)
            precisions[cell] = 1.0 / max(variance, least * usual)
            scale += held * precisions[cell]
    for cell in range(bins.shape[2]):
        if scale > 0.0 and bins[0, 1, cell] > 0.0:
            precisions[cell] *= weight / scale


@compiled
def times_precisions(
    first: int, last: int, normals: FloatArray, cells: int, precisions: FloatArray, weights: FloatArray
) -> None:
    """Multiply weights, (n,), with the precision of the cell of their normal. O(n)."""
    for i in range(first, last):
        if weights[i] > 0.0:
            weights[i] *= precisions[cell_of(normals, i, cells)]
