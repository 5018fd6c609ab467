"""Eigenvalues and least eigenvectors of many symmetric 3x3 matrices at once, in closed form."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray

# Product of the gaps from the smallest eigenvalue to the others, in squares of the largest element, below which the
# closed form would lose more than half of its digits: there LAPACK decides.
CLOSE = 1e-5


def least_axes(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and the unit eigenvector of the smallest.

    The eigenvalues are the roots of the cubic by Smith (1961). The vector is a cross product of two rows of ``A - l
    I``; its Rayleigh quotient, exact to second order, then gives a better l, and that a better vector.

    Shapes: matrices (6, n).
    """
    size = np.abs(matrices).max(axis=0, initial=0.0)
    size[size == 0.0] = 1.0
    xx, yy, zz, xy, xz, yz = unit = matrices / size
    mean = (xx + yy + zz) / 3.0
    dx, dy, dz = xx - mean, yy - mean, zz - mean
    off = xy * xy + xz * xz + yz * yz
    radius = np.sqrt((dx * dx + dy * dy + dz * dz + 2.0 * off) / 6.0)
    determinant = dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.arccos(np.clip(np.nan_to_num(determinant / (2.0 * radius**3)), -1.0, 1.0)) / 3.0
    largest = mean + 2.0 * radius * np.cos(angle)
    least = mean + 2.0 * radius * np.cos(angle + 2.0 * np.pi / 3.0)
    hard = np.flatnonzero(~((3.0 * mean - 2.0 * least - largest) * (largest - least) > CLOSE))
    axes = _null(unit, _quotient(unit, _null(unit, least)))
    least = _quotient(unit, axes)
    values = np.column_stack([least, 3.0 * mean - least - largest, largest])
    if len(hard):
        values[hard], vectors = np.linalg.eigh(unit[[0, 3, 4, 3, 1, 5, 4, 5, 2]][:, hard].T.reshape(-1, 3, 3))
        axes[:, hard] = vectors[:, :, 0].T
    return values * size[:, None], np.ascontiguousarray(axes.T)


def _null(unit: FloatArray, value: FloatArray) -> FloatArray:
    # The cofactors of A - value I are a symmetric matrix, and each of its columns is a multiple of the eigenvector; the
    # longest is taken.
    xx, yy, zz, xy, xz, yz = unit
    x, y, z = xx - value, yy - value, zz - value
    cx, cy, cz = y * z - yz * yz, x * z - xz * xz, x * y - xy * xy
    cxy, cxz, cyz = xz * yz - xy * z, xy * yz - y * xz, xy * xz - x * yz
    by_y, by_z = (np.abs(cy) > np.abs(cx)) & (np.abs(cy) >= np.abs(cz)), np.abs(cz) > np.maximum(np.abs(cx), np.abs(cy))
    axis = np.stack([cx, cxy, cxz])
    for chosen, column in ((by_y, (cxy, cy, cyz)), (by_z, (cxz, cyz, cz))):
        for k in range(3):
            np.copyto(axis[k], column[k], where=chosen)
    length = np.sqrt(np.einsum("ij,ij->j", axis, axis))
    unit_axis: FloatArray = np.divide(axis, length, out=np.zeros_like(axis), where=length > 0.0)
    return unit_axis


def _quotient(unit: FloatArray, axes: FloatArray) -> FloatArray:
    xx, yy, zz, xy, xz, yz = unit
    a, b, c = axes
    value: FloatArray = a * a * xx + b * b * yy + c * c * zz + 2.0 * (a * b * xy + a * c * xz + b * c * yz)
    return value
