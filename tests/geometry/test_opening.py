from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_geometry
from dqreg.geometry import Mesh, PointCloud, as_geometry
from dqreg.synth.parts import box

VERTICES, FACES = box((3.0, 2.0, 1.0))
NORMALS = np.tile([0.0, 0.6, 0.8], (len(VERTICES), 1))


def legacy_cloud(normals: bool = False) -> Any:
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(VERTICES))
    if normals:
        cloud.normals = o3d.utility.Vector3dVector(NORMALS)
    return cloud


def tensor_cloud(normals: bool = False, dtype: Any = np.float64) -> Any:
    o3d = load_open3d()
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(VERTICES.astype(dtype)))
    if normals:
        cloud.point.normals = o3d.core.Tensor(NORMALS.astype(dtype))
    return cloud


def legacy_mesh() -> Any:
    o3d = load_open3d()
    return o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(VERTICES), o3d.utility.Vector3iVector(FACES))


def tensor_mesh() -> Any:
    return load_open3d().t.geometry.TriangleMesh.from_legacy(legacy_mesh())


def trimesh_mesh() -> Any:
    return trimesh.Trimesh(VERTICES, FACES, process=False)


def trimesh_scene() -> Any:
    # The scene places its mesh: half of the shift is in the mesh, half in the scene.
    moved = trimesh_mesh()
    moved.apply_translation([-5.0, 0.0, 0.0])
    scene = trimesh.Scene()
    scene.add_geometry(moved, transform=trimesh.transformations.translation_matrix([5.0, 0.0, 0.0]))
    return scene


CLOUDS: dict[str, Callable[[], Any]] = {
    "array": VERTICES.copy,
    "float32 array": lambda: VERTICES.astype(np.float32),
    "list": VERTICES.tolist,
    "PointCloud": lambda: PointCloud(VERTICES),
    "Open3D legacy": legacy_cloud,
    "Open3D tensor": tensor_cloud,
    "Open3D tensor float32": lambda: tensor_cloud(dtype=np.float32),
    "trimesh": lambda: trimesh.PointCloud(VERTICES),
}
MESHES: dict[str, Callable[[], Any]] = {
    "Mesh": lambda: Mesh(VERTICES, FACES),
    "Open3D legacy": legacy_mesh,
    "Open3D tensor": tensor_mesh,
    "trimesh": trimesh_mesh,
    "trimesh scene": trimesh_scene,
}


@pytest.mark.parametrize("kind", CLOUDS)
def test_every_kind_of_cloud_holds_the_same_points(kind: str) -> None:
    cloud = as_geometry(CLOUDS[kind](), "source")
    assert isinstance(cloud, PointCloud)
    # The box has corners at whole and half numbers: float32 holds them too.
    np.testing.assert_array_equal(cloud.points, VERTICES)
    assert cloud.points.dtype == np.float64
    assert cloud.normals is None


@pytest.mark.parametrize("make", [legacy_cloud, tensor_cloud])
def test_open3d_normals_come_along(make: Callable[[bool], Any]) -> None:
    cloud = as_geometry(make(True), "source")
    assert isinstance(cloud, PointCloud)
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-15)


@pytest.mark.parametrize("kind", MESHES)
def test_every_kind_of_mesh_holds_the_same_triangles(kind: str) -> None:
    mesh = as_geometry(MESHES[kind](), "target")
    assert isinstance(mesh, Mesh)
    np.testing.assert_array_equal(mesh.corners, VERTICES[FACES])
    assert mesh.faces.dtype == np.int64


def numbers_in(value: Any) -> list[Any]:
    """All numbers that a given object holds, copied."""
    names = ("vertices", "faces", "triangles", "points", "normals")
    found = [np.array(getattr(value, name)) for name in names if not callable(getattr(value, name, len))]
    for attributes in (getattr(value, name, None) for name in ("point", "vertex", "triangle")):
        found += [attributes[key].numpy().copy() for key in attributes] if attributes is not None else []
    return found or [np.array(value)]


@pytest.mark.parametrize(
    "make", [*list(CLOUDS.values())[:2], legacy_cloud, tensor_cloud, legacy_mesh, tensor_mesh, trimesh_mesh]
)
def test_the_object_given_is_as_it_was(make: Callable[[], Any]) -> None:
    value = make()
    before = numbers_in(value)
    assert before[0].size
    as_geometry(value, "source")
    for old, new in zip(before, numbers_in(value), strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize(
    ("spelled", "unit"),
    [("mm", "mm"), ("meters", "m"), ("inches", "inch"), ("feet", "ft"), ("furlongs", None), (None, None)],
)
def test_units_that_trimesh_knows_come_along(spelled: str | None, unit: str | None) -> None:
    mesh = trimesh_mesh()
    mesh.units = spelled
    assert as_geometry(mesh, "target").units == unit


def test_a_file_comes_with_all_that_it_names(tmp_path: Path) -> None:
    path, rows = tmp_path / "scan.pcd", "\n".join(" ".join(map(str, row)) for row in VERTICES.tolist())
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 8\nHEIGHT 1\nPOINTS 8\nDATA ascii\n"
    path.write_text(head.replace("POINTS", "VIEWPOINT 1 2 3 1 0 0 0\nPOINTS") + rows)
    cloud = as_geometry(path)
    assert isinstance(cloud, PointCloud)
    np.testing.assert_array_equal(cloud.points, VERTICES)
    np.testing.assert_array_equal(cloud.viewpoint, [1.0, 2.0, 3.0])


def test_a_path_in_place_of_points_is_told_what_reads_it() -> None:
    with pytest.raises(InputError, match=r"'scan.ply'; a file is read by dqreg.geometry.as_geometry"):
        PointCloud("scan.ply")


def lines() -> Any:
    return load_open3d().geometry.LineSet()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: None, "source: points must be an array of real numbers; got NoneType"),
        (lambda: {"x": 1}, "source: the fields must hold x, y and z; got x"),
        (lambda: object(), "source: points must be .* got object"),
        (lambda: np.zeros((3, 2)), r"source: points must have shape \(n, 3\).* got shape \(3, 2\)"),
        (lambda: np.zeros((0, 3)), "source: .* it is empty"),
        (lambda: load_open3d().geometry.PointCloud(), "source: .* it is empty"),
        (lambda: load_open3d().t.geometry.PointCloud(), "source: .* it is empty"),
        (lambda: load_open3d().geometry.TriangleMesh(), "source: the mesh has no faces"),
        (lambda: load_open3d().t.geometry.TriangleMesh(), "source: the mesh has no faces"),
        (lambda: load_open3d().geometry.Image(), "an Open3D Image is neither a cloud nor a triangle mesh"),
        (lambda: load_open3d().geometry.VoxelGrid(), "an Open3D VoxelGrid is neither a cloud nor a triangle mesh"),
        (lines, "an Open3D LineSet is neither a cloud nor a triangle mesh"),
        (lambda: trimesh.Scene(), "source: "),
        (lambda: trimesh.Trimesh(), "source: the mesh has no faces"),
        (lambda: trimesh.transformations.Arcball(), "a trimesh Arcball is neither a cloud nor a mesh"),
        (
            lambda: trimesh.load_path(np.array([[0.0, 0, 0], [1, 0, 0]])),
            "a trimesh Path3D is neither a cloud nor a mesh",
        ),
    ],
)
def test_a_wrong_object_is_named(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        as_geometry(make(), "source")


@pytest.mark.parametrize("name", ["part.stl", "part.ply", "scan.xyz"])
def test_what_a_file_holds_is_taken_as_the_file_is(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "scan.xyz":
        np.savetxt(path, np.hstack([VERTICES, NORMALS]))
    else:
        trimesh.Trimesh(VERTICES, FACES).export(path)
    ours, theirs = as_geometry(read_geometry(path), "source"), as_geometry(path, "source")
    assert type(ours) is type(theirs)
    for field in dataclasses.fields(theirs):
        np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name))
