"""One cloud of all scans: the mean of each cell of space, noisier points counting less."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.multiway.scans.overlap import AXIS_BITS, cell_numbers
from dqreg.multiway.scans.scans import View, typical_spacing
from dqreg.registration.overlap.free_space import take_as_merged
from dqreg.registration.target import Target, prepare_target
from dqreg.rigid import pose
from dqreg.trust.free_space import MIN_COMPARED, DepthImage

# Noise of a point, at least, as a fraction of the typical noise: none is exact.
MIN_NOISE_RATIO = 0.1
# Points of a cell are of one face up to this cosine of their normals.
MIN_FACE_COS = 0.5
# Another scan has a point there within so many spacings: in the cell of that edge or those around it.
SUPPORT_SPACINGS = 0.7
# Nearer than what was seen by so many spacings and pixels is looked through, unless the face was seen at a grazing
# angle: a sheet seen along its face fills no pixel.
NEARER_SPACINGS, NEARER_PIXELS = 1.0, 1.0
MIN_FACING_COS = 0.3


def merged(views: Sequence[View], T_world_scan: FloatArray, voxel: float | None) -> PointCloud:
    """One cloud of all points, see `fused`."""
    return fused(views, T_world_scan, voxel)[0]


def fused(
    views: Sequence[View], T_world_scan: FloatArray, voxel: float | None, eyes: Sequence[Any] | None = None
) -> tuple[PointCloud, int]:
    """See `Multiway.merged`; and how many points were left out, for scanners at ``eyes`` looked through them."""
    placed = [k for k, view in enumerate(views) if view.usable and np.isfinite(T_world_scan[k]).all()]
    if not placed:
        raise InputError("none of the scans was placed; there is nothing to merge")
    spacing = typical_spacing([views[k] for k in placed])
    voxel = spacing if voxel is None else voxel
    if not (isinstance(voxel, (int, float)) and 0.0 <= voxel < np.inf):
        raise InputError(f"voxel must be a length, 0 or more, or None; got {voxel!r:.60}")
    parts = [_world(views[k], T_world_scan[k]) for k in placed]
    points, normals, noise = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    scan_of = np.repeat(placed, [len(part[0]) for part in parts])
    left_out = 0
    if voxel > 0.0:
        signed = np.array([view.usable and view.scan.oriented for view in views])[scan_of]
        kept = np.ones(len(points), dtype=bool)
        if eyes is not None:
            kept = ~_passed(T_world_scan, eyes, points, normals, scan_of, spacing)
            left_out = int(np.count_nonzero(~kept))
        points, normals = _means(points[kept], normals[kept], _weights(noise)[kept], signed[kept], voxel)
    lengths = np.linalg.norm(normals, axis=1)
    normals[lengths == 0.0] = [0.0, 0.0, 1.0]
    first = views[placed[0]].cloud
    # Normals of a cloud have a sign, which says where the outside is: arbitrary ones would claim what nobody knows.
    known = all(views[k].scan.oriented for k in placed)
    return PointCloud(points, normals if known else None, units=None if first is None else first.units), left_out


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


def _weights(noise: FloatArray) -> FloatArray:
    """One over the variance of each point."""
    known = noise > 0.0
    usual = float(np.median(noise[known])) if known.any() else 1.0
    return np.asarray(1.0 / np.maximum(noise, MIN_NOISE_RATIO * usual) ** 2)


def _means(
    points: FloatArray, normals: FloatArray, weights: FloatArray, signed: BoolArray, voxel: float
) -> tuple[FloatArray, FloatArray]:
    """Means of the points of each cell that are of one face: those of both sides of a sheet lie in the metal."""
    group, first = _faces(cell_numbers(points, voxel), normals, signed)
    # Signs of fitted normals are arbitrary: those of a face follow its first point's.
    sign = np.where(np.einsum("ij,ij->i", normals, normals[first][group]) < 0.0, -1.0, 1.0)
    total = np.bincount(group, weights)
    means = np.column_stack([np.bincount(group, weights * column) / total for column in points.T])
    directions = np.column_stack([np.bincount(group, weights * sign * column) for column in normals.T])
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return means, np.divide(directions, lengths, out=np.zeros_like(directions), where=lengths > 0.0)


def _faces(cell: IntArray, normals: FloatArray, signed: BoolArray) -> tuple[IntArray, IntArray]:
    """Which face of which cell each point is of, (n,), and the first point of each face.

    A face of a cell is its first point and those whose normals agree, whichever way normals without a sign point; then
    the first of the others, and so on.
    """
    group = np.zeros(len(cell), dtype=np.int64)
    firsts: list[IntArray] = []
    left, count = np.arange(len(cell)), 0
    while len(left):
        _, first, at = np.unique(cell[left], return_index=True, return_inverse=True)
        seeds = left[first]
        cosines = np.einsum("ij,ij->i", normals[left], normals[seeds][at])
        cosines = np.where(signed[left] & signed[seeds][at], cosines, np.abs(cosines))
        alike = (cosines >= MIN_FACE_COS) | ~normals[left].any(axis=1)
        alike[first] = True
        group[left[alike]] = count + at[alike]
        firsts.append(seeds)
        count, left = count + len(seeds), left[~alike]
    return group, np.concatenate(firsts)


def _passed(
    T_world_scan: FloatArray,
    eyes: Sequence[Any],
    points: FloatArray,
    normals: FloatArray,
    scan_of: IntArray,
    spacing: float,
) -> BoolArray:
    """Which points, (n, 3), of the scans ``scan_of``, (n,), more scanners looked through than saw; all in the world.

    Places of the scanners are in the frames of the scans, None where they are not known.
    """
    found = np.zeros(len(points), dtype=bool)
    alone = _of_one_scan(points, scan_of, SUPPORT_SPACINGS * spacing)
    rows = np.flatnonzero(alone)
    votes = np.zeros(len(rows), dtype=np.int64)
    for k in np.unique(scan_of).tolist():
        others = np.flatnonzero(scan_of[rows] != k)
        # Strays would hide what stands behind them: where no other scan has a point, none is seen.
        seen = points[(scan_of == k) & ~alone]
        if eyes[k] is None or not len(others) or len(seen) < MIN_COMPARED:
            continue
        eye, asked, T = np.asarray(eyes[k], dtype=np.float64), rows[others], pose.inverse(T_world_scan[k])
        image = DepthImage.of(pose.apply(T, seen), eye)
        moved = pose.apply(T, points[asked])
        sight = moved - eye
        facing = np.abs(np.einsum("ij,ij->i", normals[asked] @ T[:3, :3].T, sight))
        is_faced = facing >= MIN_FACING_COS * np.linalg.norm(sight, axis=1)
        votes[others] += np.where(is_faced, image.sides_of(moved, NEARER_SPACINGS * spacing, NEARER_PIXELS), 0)
    found[rows[votes > 0]] = True
    return found


def _of_one_scan(points: FloatArray, scan_of: IntArray, edge: float) -> BoolArray:
    """Which points have none of another scan in their cell or those around it."""
    cell = cell_numbers(points, edge)
    order = np.argsort(cell, kind="stable")
    filled, starts = np.unique(cell[order], return_index=True)
    least, most = np.minimum.reduceat(scan_of[order], starts), np.maximum.reduceat(scan_of[order], starts)
    alone = np.ones(len(points), dtype=bool)
    for x, y, z in product((-1, 0, 1), repeat=3):
        wanted = cell + ((x << (2 * AXIS_BITS)) + (y << AXIS_BITS) + z)
        at = np.minimum(np.searchsorted(filled, wanted), len(filled) - 1)
        alone &= (filled[at] != wanted) | ((least[at] == scan_of) & (most[at] == scan_of))
    return alone
