"""Clouds and meshes of other libraries, recognised by what they offer; none of these libraries is imported."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import as_vectors
from dqreg.errors import InputError
from dqreg.files import CloudData, MeshData
from dqreg.files.cloud_data import SweepData, TimedCloudData
from dqreg.files.units import UNIT_WORDS
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.fields import RawCloud, columns_of, from_message
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.rays import is_sweep

ACCEPTED = (
    "an (n, 3) array, a structured array or table with x, y, z, a PointCloud2 message, (vertices, faces), or a cloud "
    "or mesh of dqreg, Open3D, trimesh, PyVista, laspy, pye57 or small_gicp"
)


def object_geometry(value: Any, name: str) -> PointCloud | Mesh:
    """The cloud or mesh that an object holds."""
    try:
        found = recognise(value, name)
        return PointCloud(found.points, found.normals, times=found.times) if isinstance(found, RawCloud) else found
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def recognise(value: Any, name: str) -> PointCloud | Mesh | RawCloud:
    """What an object holds; a cloud of another library comes with all rows, finite or not."""
    if isinstance(value, (PointCloud, Mesh)):
        return value
    if isinstance(value, (CloudData, MeshData)):
        return of_file(value)
    if isinstance(value, np.ndarray):
        return _plain(value) if value.dtype.names is None else columns_of(value, value.dtype.names)
    package = type(value).__module__.split(".")[0]
    if package == "open3d":
        return _from_open3d(value, name)
    if package == "trimesh":
        return _from_trimesh(value, name)
    if all(hasattr(value, part) for part in ("fields", "point_step", "data")):
        return from_message(value)
    if isinstance(value, Mapping) or (hasattr(value, "keys") and _has_coordinates(value)):
        return columns_of(value, value.keys())
    return _by_parts(value)


def of_file(data: CloudData | MeshData) -> PointCloud | Mesh:
    """What a file says, with all that it tells of it."""
    if isinstance(data, MeshData):
        return Mesh(data.vertices, data.faces, data.units, regions=data.regions)
    if isinstance(data, SweepData) and not is_sweep(data.points):
        # A part in a KITTI file has its own origin, and any unit.
        data = dataclasses.replace(data, viewpoint=None, units=None)
    times = data.times if isinstance(data, TimedCloudData) else None
    return PointCloud(data.points, data.normals, data.viewpoint, data.units, data.dropped, times)


def _plain(points: Any, normals: Any = None) -> RawCloud:
    directions = None if normals is None else as_vectors(normals, "normals", finite=False)
    return RawCloud(as_vectors(points, "points", finite=False), directions)


def _has_coordinates(table: Any) -> bool:
    # A DataFrame of three columns with other names, or with numbers for names, is an array.
    return not hasattr(table, "__array__") or {"x", "y", "z"} <= {str(key).lower() for key in table}


def _by_parts(value: Any) -> Mesh | RawCloud:
    """Objects that are told by the parts that they have."""
    if isinstance(value, (tuple, list)) and len(value) == 2 and all(np.ndim(part) == 2 for part in value):
        return _from_pair(*value)
    if hasattr(value, "xyz") and hasattr(value, "point_format"):
        return _from_laspy(value)
    if hasattr(value, "point_data") and hasattr(value, "n_points"):
        return _from_pyvista(value)
    if callable(getattr(value, "points", None)) and hasattr(value, "covs"):
        # Its normals are raw memory until they are estimated.
        return _plain(np.asarray(value.points())[:, :3])
    if hasattr(value, "detach") and hasattr(value, "cpu"):
        return _plain(value.detach().cpu().double().numpy())
    if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
        return _plain(_from_dlpack(value))
    if hasattr(value, "read_scan") and hasattr(value, "scan_count"):
        raise InputError("an open E57 file; pass its path, or one scan of it: file.read_scan(0)")
    return _plain(value)


def _from_dlpack(value: Any) -> Any:
    try:
        return np.from_dlpack(value)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"an array of {type(value).__module__} that NumPy cannot take ({error})") from error


def _from_pair(vertices: Any, faces: Any) -> Mesh:
    faces = np.asarray(faces)
    if faces.ndim != 2 or faces.dtype.kind not in "iu":
        raise InputError(
            f"two arrays, of which the second, {faces.dtype} of shape {faces.shape}, holds no faces; a mesh goes in as "
            "(vertices, faces), points with normals as dqreg.PointCloud(points, normals)"
        )
    return Mesh(np.asarray(vertices), faces)


def _from_laspy(value: Any) -> RawCloud:
    names = list(value.point_format.dimension_names)
    lower = {str(name).lower() for name in names}
    extra = {name: value[name] for name in names if str(name).lower() not in {"x", "y", "z"}}
    if lower.isdisjoint({"gps_time"}) or not np.ptp(np.asarray(extra["gps_time"])) > 0.0:
        extra.pop("gps_time", None)
    return columns_of({**extra, "xyz": value.xyz}, [*extra, "xyz"])


def _from_pyvista(value: Any) -> RawCloud | Mesh:
    if not hasattr(value, "regular_faces"):
        raise InputError(f"a PyVista {type(value).__name__}; pass its surface: .extract_surface()")
    if np.size(value.faces):
        return Mesh(np.array(value.points), np.array(value.triangulate().regular_faces, dtype=np.int64))
    return _plain(np.array(value.points), value.point_data.get("Normals", None))


def _from_open3d(value: Any, name: str) -> RawCloud | Mesh:
    if hasattr(value, "to_legacy"):
        value = value.cpu()
        if hasattr(value, "triangle"):
            return Mesh(_tensor(value.vertex, "positions"), _tensor(value.triangle, "indices"))
        return _plain(_tensor(value.point, "positions"), _tensor(value.point, "normals"))
    if hasattr(value, "triangles"):
        return Mesh(np.array(value.vertices), np.array(value.triangles))
    # A set of lines has points as well.
    if hasattr(value, "points") and hasattr(value, "has_normals"):
        return _plain(np.array(value.points), np.array(value.normals) if value.has_normals() else None)
    if hasattr(value, "numpy"):
        return _plain(value.cpu().numpy())
    if type(value).__name__ == "Vector3dVector":
        return _plain(np.array(value))
    raise InputError(
        f"an Open3D {type(value).__name__} is neither a cloud nor a triangle mesh; {name} must be {ACCEPTED}"
    )


def _tensor(attributes: Any, key: str) -> Any:
    if key in attributes:
        return attributes[key].numpy()
    return None if key == "normals" else np.zeros((0, 3), dtype=np.int64)


def _from_trimesh(value: Any, name: str) -> RawCloud | Mesh:
    if hasattr(value, "geometry") and hasattr(value, "to_mesh"):
        value = value.to_mesh()
    if hasattr(value, "faces"):
        return Mesh(np.array(value.vertices), np.array(value.faces), units=UNIT_WORDS.get(value.units))
    # So has a path.
    if hasattr(value, "vertices") and not hasattr(value, "entities"):
        return _plain(np.array(value.vertices))
    raise InputError(f"a trimesh {type(value).__name__} is neither a cloud nor a mesh; {name} must be {ACCEPTED}")
