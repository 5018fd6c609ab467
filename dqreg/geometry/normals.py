"""Normals from local plane fits with their variances, so that edges and grazing views get less weight."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree

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


NEIGHBOURS = 16
# Bounds the memory of one step: 16 neighbours of 65,536 points are 25 MB.
CHUNK = 65_536
# Elements of a symmetric matrix as `least_axes` takes them.
ELEMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclasses.dataclass(frozen=True)
class PlaneFits:
    """Planes fitted to the neighbours of n points."""

    # (n, 3): Unit normals; the sign is arbitrary unless a viewpoint oriented them. NaN where the neighbours lie on a
    # line
    normals: FloatArray
    # (n,): Root mean square distance sigma_r of the k neighbours from their plane, with k - 3 degrees of freedom
    residuals: FloatArray
    # (n,): ``1 / (1/l1 + 1/l2)`` with the two tangential variances of the neighbours: a squared length that relates the
    # variance of a point to that of its normal: ``sigma_n^2 = sigma_r^2 / (k lever)``
    lever: FloatArray
    count: int  # Neighbours k used a fit
    # (n,): Distance from each place to the second nearest point, the nearest other one of a point of the cloud; None
    # where the neighbours were known before, without their distances
    gaps: FloatArray | None = None

    @property
    def variances(self) -> FloatArray:
        """Variance of each normal about one tangential axis plus the other, in rad^2, (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            variance: FloatArray = self.residuals**2 / (self.count * self.lever)
        return np.where(self.lever > 0.0, variance, np.inf)


def fit_planes(tree: NeighbourTree, cloud: FloatArray, at: FloatArray, count: int = NEIGHBOURS) -> PlaneFits:
    """Fit a plane to the nearest neighbours of each query."""
    parts, gaps = [], [np.zeros(0)]
    for i in range(0, len(at), CHUNK):
        indices, distances = tree.nearest(at[i : i + CHUNK], count)
        parts.append(_fit_chunk(cloud, indices))
        gaps.append(distances[:, :2][:, -1])
    return dataclasses.replace(_joined(parts, min(count, tree.size)), gaps=np.concatenate(gaps))


def fit_planes_around(tree: NeighbourTree, cloud: FloatArray, rows: IntArray, count: int = NEIGHBOURS) -> PlaneFits:
    """Fit planes at points of the cloud itself, from the neighbours that its tree remembers."""
    parts = []
    for i in range(0, len(rows), CHUNK):
        indices, _ = tree.around(rows[i : i + CHUNK])
        parts.append(_fit_chunk(cloud, indices[:, :count]))
    return _joined(parts, min(count, tree.size))


def _joined(parts: list[tuple[FloatArray, FloatArray, FloatArray]], count: int) -> PlaneFits:
    if not parts:
        return PlaneFits(np.zeros((0, 3)), np.zeros(0), np.zeros(0), count)
    normals, residuals, lever = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return PlaneFits(normals, residuals, lever, count)


def _fit_chunk(cloud: FloatArray, indices: IntArray | NDArray[np.int32]) -> tuple[FloatArray, FloatArray, FloatArray]:
    k = indices.shape[1]
    if k < 4:
        nothing = np.full(len(indices), np.nan)
        return np.full((len(indices), 3), np.nan), nothing, np.zeros(len(indices))
    # Column by column: rows of three cost NumPy several times as much.
    columns = [np.take(column, indices) for column in np.ascontiguousarray(cloud.T)]
    for column in columns:
        column -= column.mean(axis=1, keepdims=True)
    scatter = np.stack([np.einsum("ij,ij->i", columns[a], columns[b]) for a, b in ELEMENTS])
    values, normals = least_axes(scatter)
    values = np.maximum(values, 0.0)
    tangential = values[:, 1:] / k
    with np.errstate(divide="ignore"):
        lever: FloatArray = 1.0 / (1.0 / tangential).sum(axis=1)
    # On a line the smaller tangential variance is rounding and the normal is anything.
    line = values[:, 1] <= 1e-6 * values[:, 2]
    normals[line] = np.nan
    return normals, np.sqrt(values[:, 0] / (k - 3)), np.where(line, 0.0, lever)


def orient_towards(normals: FloatArray, points: FloatArray, viewpoint: FloatArray) -> FloatArray:
    """Normals flipped towards the sensor."""
    facing = np.einsum("ij,ij->i", viewpoint - points, normals)
    return np.where((facing < 0.0)[:, None], -normals, normals)


def sample_rows(total: int, wanted: int) -> IntArray:
    """Evenly spread row numbers: with points in Morton order, an even thinning in space.

    Shapes: returns (total, wanted).
    """
    if wanted >= total:
        return np.arange(total)
    return np.linspace(0, total - 1, wanted).round().astype(np.int64)
