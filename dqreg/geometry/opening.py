"""Whatever a caller gives as a source or a target, opened and named."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.files import CloudData, read_geometry
from dqreg.files.units import UNIT_WORDS
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh


def open_geometry(value: Any, name: str) -> PointCloud | Mesh:
    """Geometry of a path or an object."""
    if not isinstance(value, (str, os.PathLike)):
        return as_geometry(value, name)
    data = read_geometry(value)
    try:
        if isinstance(data, CloudData):
            return PointCloud(data.points, data.normals, data.viewpoint, data.units, data.dropped)
        return Mesh(data.vertices, data.faces, data.units, regions=data.regions)
    except InputError as error:
        raise InputError(f"{name} {os.fspath(value)}: {error}") from error


def describe(value: Any) -> str:
    """Name of what a caller gave, for reports: a path as it was written, else the type and the size."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    size = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"{type(value).__name__}{size}"


ACCEPTED = "an (n, 3) array, a dqreg.PointCloud, an Open3D cloud or mesh (legacy or tensor), a trimesh cloud or mesh"


def as_geometry(value: Any, name: str) -> PointCloud | Mesh:
    """The cloud or mesh that an object holds.

    Parameters
    ----------
    value : object
        An (n, 3) array, `PointCloud`, `Mesh`, Open3D cloud or mesh (legacy or tensor), trimesh cloud, mesh or scene.
    name : str
        What the caller calls it, for the message.

    Returns
    -------
    PointCloud or Mesh
        Float64 copies or views; the object itself is never changed.

    Raises
    ------
    InputError
        If the object is none of these, or what it holds cannot be used.

    Examples
    --------
    >>> as_geometry([[0, 0, 0], [1, 0, 0]], "source").points.shape
    (2, 3)
    """
    if isinstance(value, (PointCloud, Mesh)):
        return value
    package = type(value).__module__.split(".")[0]
    try:
        if package == "open3d":
            return _from_open3d(value, name)
        if package == "trimesh":
            return _from_trimesh(value, name)
        return PointCloud(value)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def _from_open3d(value: Any, name: str) -> PointCloud | Mesh:
    if hasattr(value, "to_legacy"):
        value = value.cpu()
        if hasattr(value, "triangle"):
            return Mesh(_tensor(value.vertex, "positions"), _tensor(value.triangle, "indices"))
        return PointCloud(_tensor(value.point, "positions"), _tensor(value.point, "normals"))
    if hasattr(value, "triangles"):
        return Mesh(np.array(value.vertices), np.array(value.triangles))
    # A set of lines has points as well.
    if hasattr(value, "points") and hasattr(value, "has_normals"):
        return PointCloud(np.array(value.points), np.array(value.normals) if value.has_normals() else None)
    raise InputError(
        f"an Open3D {type(value).__name__} is neither a cloud nor a triangle mesh; {name} must be {ACCEPTED}"
    )


def _tensor(attributes: Any, key: str) -> Any:
    if key in attributes:
        return attributes[key].numpy()
    return None if key == "normals" else np.zeros((0, 3), dtype=np.int64)


def _from_trimesh(value: Any, name: str) -> PointCloud | Mesh:
    if hasattr(value, "geometry") and hasattr(value, "to_mesh"):
        value = value.to_mesh()
    if hasattr(value, "faces"):
        return Mesh(np.array(value.vertices), np.array(value.faces), units=UNIT_WORDS.get(value.units))
    # So has a path.
    if hasattr(value, "vertices") and not hasattr(value, "entities"):
        return PointCloud(np.array(value.vertices))
    raise InputError(f"a trimesh {type(value).__name__} is neither a cloud nor a mesh; {name} must be {ACCEPTED}")
