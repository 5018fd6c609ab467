"""One cloud of all scans: the mean of each cell of space, noisier points counting less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.multiway.scans.overlap import cell_numbers
from dqreg.multiway.scans.scans import View, typical_spacing
from dqreg.registration.overlap.free_space import take_as_merged
from dqreg.registration.target import Target, prepare_target
from dqreg.rigid import pose

# Noise of a point, at least, as a fraction of the typical noise: none is exact.
MIN_NOISE_RATIO = 0.1


def merged(views: Sequence[View], T_world_scan: FloatArray, voxel: float | None) -> PointCloud:
    """See `Multiway.merged`."""
    placed = [k for k, view in enumerate(views) if view.usable and np.isfinite(T_world_scan[k]).all()]
    if not placed:
        raise InputError("none of the scans was placed; there is nothing to merge")
    if voxel is None:
        voxel = typical_spacing([views[k] for k in placed])
    if not (isinstance(voxel, (int, float)) and 0.0 <= voxel < np.inf):
        raise InputError(f"voxel must be a length, 0 or more, or None; got {voxel!r:.60}")
    parts = [_world(views[k], T_world_scan[k]) for k in placed]
    points, normals = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    noise = np.concatenate([part[2] for part in parts])
    known = noise > 0.0
    usual = float(np.median(noise[known])) if known.any() else 1.0
    weights = 1.0 / np.maximum(noise, MIN_NOISE_RATIO * usual) ** 2
    if voxel > 0.0:
        points, normals = _means(points, normals, weights, voxel)
    lengths = np.linalg.norm(normals, axis=1)
    normals[lengths == 0.0] = [0.0, 0.0, 1.0]
    first = views[placed[0]].cloud
    # Normals of a cloud have a sign, which says where the outside is: arbitrary ones would claim what nobody knows.
    signed = all(views[k].scan.oriented for k in placed)
    return PointCloud(points, normals if signed else None, units=None if first is None else first.units)


def merged_target(views: Sequence[View], T_world_scan: FloatArray) -> Target:
    """All placed scans together, to register others to."""
    target = prepare_target(merged(views, T_world_scan, None))
    take_as_merged(target.indexed)
    return target


def _world(view: View, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points, normals and noise of a scan in the world frame."""
    scan = view.scan
    normals = scan.normals
    missing = ~scan.directed
    if missing.any() and not missing.all():
        normals = normals.copy()
        tree = NeighbourTree(scan.points)
        normals[missing] = np.nan_to_num(fit_planes(tree, scan.points, scan.points[missing]).normals)
    points = pose.apply(T, scan.points + view.origin)
    residuals = np.where(np.isfinite(scan.residuals), scan.residuals, scan.noise)
    # A patch by itself says little about its noise: half of it is the scan's.
    return points, normals @ T[:3, :3].T, np.sqrt(0.5 * (residuals**2 + scan.noise**2))


def _means(points: FloatArray, normals: FloatArray, weights: FloatArray, voxel: float) -> tuple[FloatArray, FloatArray]:
    _, first, cell = np.unique(cell_numbers(points, voxel), return_index=True, return_inverse=True)
    # Signs of fitted normals are arbitrary: those of a cell follow its first point's.
    sign = np.where(np.einsum("ij,ij->i", normals, normals[first][cell]) < 0.0, -1.0, 1.0)
    total = np.bincount(cell, weights)
    means = np.column_stack([np.bincount(cell, weights * column) / total for column in points.T])
    directions = np.column_stack([np.bincount(cell, weights * sign * column) for column in normals.T])
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return means, np.divide(directions, lengths, out=np.zeros_like(directions), where=lengths > 0.0)
