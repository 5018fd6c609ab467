"""What planes of cells come to: their columns, what they usually leave, and means moved to the surface they make."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.order.selection import median_of


@compiled
def plane_columns(
    fits: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float]:
    """Normals, residuals, levers, distances and heights of planes as `cell_planes` writes them, each by itself. O(m).

    Then the median of the residuals of those that are there, NaN of none, and of how high all are, zero where there is
    no plane. Shapes: fits (m, 7).
    """
    m, known = len(fits), 0
    normals, residuals, levers, gaps, heights = np.zeros((m, 3)), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    left, high = np.zeros(m), np.zeros(m)
    for i in range(m):
        for k in range(3):
            normals[i, k] = fits[i, k]
        residuals[i], levers[i], gaps[i] = fits[i, 3], fits[i, 4], fits[i, 5]
        if np.isfinite(fits[i, 0]):
            heights[i], left[known] = fits[i, 6], fits[i, 3]
            high[i] = abs(fits[i, 6])
            known += 1
    usual = median_of(left[:known]) if known > 0 else np.nan
    return normals, residuals, levers, gaps, heights, usual, median_of(high) if m > 0 else np.nan


@compiled
def smoothed_means(
    means: FloatArray, normals: FloatArray, residuals: FloatArray, heights: FloatArray, usual: float
) -> FloatArray:
    """Means, (m, 3), moved along their normals to their heights: where more than usual is left, by a share of it. O(m).

    The share is that of the squares.
    """
    moved = means.copy()
    for i in range(len(moved)):
        if np.isfinite(normals[i, 0]):
            share = usual / residuals[i] if residuals[i] > usual else 1.0
            height = share * share * heights[i]
            for k in range(3):
                moved[i, k] += height * normals[i, k]
    return moved


@compiled
def held_by_sure(normals: FloatArray, residuals: FloatArray, most: float) -> tuple[FloatArray, int]:
    """Sum of the products of normals with themselves, (3, 3), of planes that leave no more, and how many. O(m)."""
    xx = yy = zz = xy = xz = yz = 0.0
    count = 0
    for i in range(len(normals)):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        if np.isfinite(x) and not residuals[i] > most:
            xx, yy, zz, xy, xz, yz = xx + x * x, yy + y * y, zz + z * z, xy + x * y, xz + x * z, yz + y * z
            count += 1
    held = np.zeros((3, 3))
    held[0, 0], held[1, 1], held[2, 2] = xx, yy, zz
    held[0, 1], held[0, 2], held[1, 2] = xy, xz, yz
    held[1, 0], held[2, 0], held[2, 1] = xy, xz, yz
    return held, count


@compiled
def share_of_lined(counts: FloatArray, scatters: FloatArray, told: float, products: float) -> float:
    """Share of cells of so many points whose scatter, (m, 6), is along a line: see `Cells.lined_share`. O(m)."""
    many = lined = 0
    for i in range(len(counts)):
        if counts[i] >= told:
            many += 1
            xx, yy, zz = scatters[i, 0], scatters[i, 1], scatters[i, 2]
            xy, xz, yz = scatters[i, 3], scatters[i, 4], scatters[i, 5]
            total = xx + yy + zz
            small = xx * yy + xx * zz + yy * zz - xy * xy - xz * xz - yz * yz
            lined += small <= products * (total * total)
    return lined / many if many else 0.0
