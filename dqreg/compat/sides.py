"""Both clouds of a call of Open3D's: every finite point, in the caller's order and with the caller's row numbers."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.objects import object_geometry, recognise
from dqreg.geometry.sides import have_sides


@dataclasses.dataclass(frozen=True)
class GivenClouds:
    """Source and target."""

    scan: Scan  # The source, every finite point of it, in the caller's order
    surface: CloudSurface  # The target
    # source_rows, target_rows: Rows that the finite points had in the caller's clouds
    source_rows: IntArray
    target_rows: IntArray
    source_count: int  # Points of the caller's source, finite or not


def read_sides(source: Any, target: Any, *, with_normals: bool) -> GivenClouds:
    """Read both clouds."""
    moving, source_rows, count = _cloud(source, "source")
    standing, target_rows, _ = _cloud(target, "target")
    return GivenClouds(_scan(moving, with_normals), CloudSurface(standing), source_rows, target_rows, count)


def _cloud(value: Any, name: str) -> tuple[PointCloud, IntArray, int]:
    geometry = object_geometry(value, name)
    if isinstance(geometry, Mesh):
        raise InputError(f"{name} is a mesh; this call is for two clouds, as in Open3D. Use dqreg.register for meshes")
    count = len(geometry) + geometry.dropped
    if not geometry.dropped or isinstance(value, PointCloud):
        return geometry, np.arange(len(geometry)), len(geometry)
    points, normals = _raw(value)
    finite = np.isfinite(points).all(axis=1)
    if normals is not None:
        finite &= np.isfinite(normals).all(axis=1) & normals.any(axis=1)
    return geometry, np.flatnonzero(finite), count


def _raw(value: Any) -> tuple[FloatArray, FloatArray | None]:
    found = recognise(value, "a cloud")
    assert not isinstance(found, Mesh)
    return found.points, found.normals


def _scan(cloud: PointCloud, with_normals: bool) -> Scan:
    count = len(cloud)
    normals, levers, residuals = np.zeros((count, 3)), np.zeros(count), np.full(count, np.nan)
    if with_normals:
        fits = fit_planes(NeighbourTree(cloud.points), cloud.points, cloud.points)
        known = np.asarray(np.isfinite(fits.normals).all(axis=1))
        fitted = np.where(known[:, None], fits.normals, 0.0)
        normals = fitted if cloud.normals is None else cloud.normals
        levers, residuals = np.where(known, fits.lever, 0.0), fits.residuals
    return Scan(
        points=cloud.points,
        normals=normals,
        levers=levers,
        residuals=residuals,
        fitted=np.arange(count) if with_normals else np.zeros(0, dtype=np.int64),
        oriented=with_normals and cloud.normals is not None and have_sides(cloud.points, cloud.normals),
        spacing=0.0,
        noise=0.0,
        total=count,
    )


def is_empty(value: Any) -> bool:
    """Whether a cloud has no points at all."""
    own = getattr(value, "is_empty", None)  # Open3D's, legacy and tensor
    if callable(own):
        return bool(own())
    return not isinstance(value, str) and hasattr(value, "__len__") and len(value) == 0
