"""Shifts of a frame onto itself: in a hall of equal columns it fits as well one period on, in any direction.

What stands on the floor is looked at from above, in the plane across the direction that most faces have: a frame that
comes to lie on itself somewhere else lies as well on a map of the same place there.
"""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

from dqreg._arrays import FloatArray

# Cells to a side at most; cosine of a normal with the common direction below which a point is of what stands.
CELLS, STANDS = 256, 0.5
# Least share of what stands that must meet known ground, and that must come to lie on what stands; shifts kept.
COMMON, SIMILAR, KEPT = 0.3, 0.7, 4


def self_similar_shifts(points: FloatArray, normals: FloatArray, cell: float, least: float) -> FloatArray:
    """Shifts, longer than the least, that put most of what stands in a frame onto what stands in it, (k, 3).

    The most similar first. Shapes: points, normals (n, 3), zero where none is known.
    """
    values, axes = np.linalg.eigh(normals.T @ normals)
    stands = (np.abs(normals @ axes[:, 2]) < STANDS) & normals.any(axis=1)
    if not values[2] > 0.0 or not stands.any():
        return np.zeros((0, 3))
    plane = axes[:, :2]
    flat = points @ plane
    low = flat.min(axis=0)
    cell = max(cell, float((flat.max(axis=0) - low).max()) / CELLS)
    cells = ((flat - low) / cell).astype(np.int64)
    shape = tuple(2 * (cells.max(axis=0) + 1))
    known, standing = np.zeros(shape), np.zeros(shape)
    known[tuple(cells.T)] = 1.0
    standing[tuple(cells[stands].T)] = 1.0
    around = np.ones((3, 3))
    wide = [ndimage.binary_dilation(grid > 0.0, around).astype(np.float64) for grid in (known, standing)]
    spectrum = np.conj(fft.rfft2(standing))
    ground, met = (fft.irfft2(spectrum * fft.rfft2(grid), shape) for grid in wide)
    share = np.where(ground >= COMMON * standing.sum(), met / np.maximum(ground, 1.0), 0.0)
    share = fft.fftshift(share)
    middle = np.array(shape) // 2
    away = np.hypot(*((np.indices(shape) - middle[:, None, None]) * cell))
    peaks = (ndimage.maximum_filter(share, 5) == share) & (share >= SIMILAR) & (away > least)
    found = np.argwhere(peaks)
    found = found[np.argsort(-share[peaks], kind="stable")[:KEPT]]
    return np.asarray((found - middle) * cell @ plane.T)
