"""Clouds and meshes as objects of other libraries."""

from __future__ import annotations

import array
import dataclasses
import importlib
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg._open3d import load_open3d
from dqreg.errors import InputError, load_package

if TYPE_CHECKING:
    from collections.abc import Mapping

# Number of a float32 and a float64 in sensor_msgs/PointField.
FLOAT32, FLOAT64 = 7, 8
# A coordinate in float32 is off by so much of its size, and may be off by so much of the cloud's.
FLOAT32_ROUNDING, MAX_OFF_DIAGONALS = 6e-8, 1e-5


@dataclasses.dataclass
class Stamp:
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


@dataclasses.dataclass
class Header:
    """std_msgs/Header."""

    stamp: Stamp
    frame_id: str


@dataclasses.dataclass
class PointField:
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclasses.dataclass
class PointCloud2:
    """sensor_msgs/PointCloud2 where ROS is not installed: the same parts under the same names."""

    header: Header
    height: int
    width: int
    fields: list[PointField]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: Any
    is_dense: bool


def cloud_to_open3d(points: FloatArray, normals: FloatArray | None) -> Any:
    """Open3D's (legacy) cloud."""
    o3d = load_open3d()
    made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        made.normals = o3d.utility.Vector3dVector(normals)
    return made


def mesh_to_open3d(vertices: FloatArray, faces: IntArray) -> Any:
    """Open3D's (legacy) mesh."""
    o3d = load_open3d()
    corners, triangles = o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces.astype(np.int32))
    return o3d.geometry.TriangleMesh(corners, triangles)


def to_trimesh(points: FloatArray, faces: IntArray | None, units: str | None) -> Any:
    """Cloud or mesh of trimesh, as it is: nothing is merged or repaired."""
    trimesh = importlib.import_module("trimesh")
    made = trimesh.PointCloud(points) if faces is None else trimesh.Trimesh(points, faces, process=False)
    made.units = units
    return made


def to_pyvista(points: FloatArray, faces: IntArray | None, values: Mapping[str, Any]) -> Any:
    """PolyData of PyVista, with values at its points."""
    pyvista: Any = load_package("pyvista", "pyvista", "to_pyvista")
    if faces is None:
        made = pyvista.PolyData(np.array(points))
    else:
        made = pyvista.PolyData.from_regular_faces(np.array(points), np.array(faces))
    for name, rows in values.items():
        made.point_data[name] = np.array(rows)
    return made


def cloud_columns(points: FloatArray, normals: FloatArray | None) -> dict[str, FloatArray]:
    """Fields of a message, (n,) each."""
    columns = dict(zip("xyz", points.T, strict=True))
    if normals is not None:
        columns.update(zip(("normal_x", "normal_y", "normal_z"), normals.T, strict=True))
    return columns


def to_pointcloud2(columns: Mapping[str, FloatArray], frame_id: str, stamp: float, precision: str | None) -> Any:
    """Message of columns (n,) of one length: ROS's own class where it is installed, else a record with its parts."""
    precision = precision or _sufficient(np.column_stack([columns[name] for name in "xyz"]))
    if precision not in ("float32", "float64"):
        raise InputError(f'precision must be "float32" or "float64"; got {precision!r}')
    try:
        messages: Any = importlib.import_module("sensor_msgs.msg")
        headers: Any = importlib.import_module("std_msgs.msg")
        times: Any = importlib.import_module("builtin_interfaces.msg")
    except ImportError:
        messages = headers = times = None
    whole = int(np.floor(stamp))
    seconds = {"sec": whole, "nanosec": min(round((stamp - whole) * 1e9), 999_999_999)}
    packed = np.column_stack(list(columns.values())).astype(precision)
    size, datatype = packed.itemsize, FLOAT64 if precision == "float64" else FLOAT32
    field, header, time, message = (
        (PointField, Header, Stamp, PointCloud2)
        if messages is None
        else (messages.PointField, headers.Header, times.Time, messages.PointCloud2)
    )
    fields = [field(name=n, offset=k * size, datatype=datatype, count=1) for k, n in enumerate(columns)]
    return message(
        header=header(stamp=time(**seconds), frame_id=frame_id),
        height=1,
        width=len(packed),
        fields=fields,
        is_bigendian=sys.byteorder == "big",
        point_step=packed.shape[1] * size,
        row_step=packed.size * size,
        data=array.array("B", packed.tobytes()),
        is_dense=True,
    )


def _sufficient(points: FloatArray) -> str:
    """Type of the coordinates: float32 as drivers send it, float64 where that would move points (maps in UTM)."""
    low, high = bounds(points)
    off = FLOAT32_ROUNDING * float(np.maximum(np.abs(low), np.abs(high)).max())
    return "float32" if off <= MAX_OFF_DIAGONALS * float(np.linalg.norm(high - low)) else "float64"
