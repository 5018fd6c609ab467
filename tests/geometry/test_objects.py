"""Objects of other libraries: real ones where the library comes with the tests, else stand-ins with the same parts."""

from __future__ import annotations

import dataclasses
import sys
import types
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dqreg
from dqreg.errors import InputError, MissingDependencyError
from dqreg.geometry import Mesh, PointCloud, as_geometry
from dqreg.geometry.fields import from_message, stamp_of
from dqreg.odometry.frame import read_frame

POINTS = np.random.default_rng(0).normal(size=(40, 3))
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
CORNERS = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def structured(**columns: Any) -> np.ndarray:
    made = np.zeros(len(POINTS), dtype=[(name, np.asarray(rows).dtype) for name, rows in columns.items()])
    for name, rows in columns.items():
        made[name] = rows
    return made


XYZ = dict(zip("xyz", POINTS.T, strict=True))


@pytest.mark.parametrize(
    "value",
    [
        structured(**XYZ, intensity=np.ones(40, dtype="f4"), ring=np.ones(40, dtype="u2")),
        structured(**{name.upper(): rows.astype(">f8") for name, rows in XYZ.items()}),
        structured(**XYZ).reshape(5, 8),
        XYZ,
        {f"cartesian{name.upper()}": rows for name, rows in XYZ.items()} | {"intensity": np.ones(40)},
        {"xyz": POINTS, "rgb": np.zeros((40, 3))},
        PointCloud(POINTS).to_pointcloud2(precision="float64"),
    ],
    ids=["structured", "big-endian", "organised", "columns", "pye57", "ros2_numpy", "PointCloud2"],
)
def test_named_columns_are_the_points(value):
    found = as_geometry(value, "source")
    np.testing.assert_array_equal(found.points, POINTS)
    assert found.normals is None


@pytest.mark.parametrize(
    "names", [("normal_x", "normal_y", "normal_z"), ("nx", "ny", "nz"), ("NormalX", "NormalY", "NormalZ")]
)
def test_named_normals_and_times(names):
    nanoseconds = 1_763_800_000_123_456_789 + np.arange(40) * 250
    value = structured(**XYZ, **dict(zip(names, NORMALS.T, strict=True)), t=nanoseconds)
    np.testing.assert_allclose(as_geometry(value, "source").normals, NORMALS, atol=1e-15)
    # Whole nanoseconds since 1970 would lose 256 of them in float64.
    np.testing.assert_array_equal(read_frame(value, None).times, np.arange(40) * 250)
    unfilled = structured(**XYZ, **dict.fromkeys(names, np.zeros(40)))
    assert as_geometry(unfilled, "source").normals is None


def test_a_frame_keeps_points_and_times_in_step():
    rows = POINTS.copy()
    rows[[3, 17]] = np.nan
    value = structured(**dict(zip("xyz", rows.T, strict=True)), time=np.arange(40.0))
    frame = read_frame(value, None)
    np.testing.assert_array_equal(frame.times, np.delete(np.arange(40.0), [3, 17]))
    np.testing.assert_array_equal(frame.points, np.delete(POINTS, [3, 17], axis=0))


@dataclasses.dataclass
class Field:
    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclasses.dataclass
class Message:
    fields: list[Field]
    point_step: int
    data: Any
    width: int
    height: int = 1
    row_step: int = 0
    is_bigendian: bool = False


CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


@given(
    kinds=st.lists(st.sampled_from(["f4", "f8"]), min_size=3, max_size=3),
    gaps=st.lists(st.integers(0, 5), min_size=4, max_size=4),
    shape=st.tuples(st.integers(1, 4), st.integers(1, 5)),
    row_padding=st.integers(0, 9),
    big=st.booleans(),
    order=st.permutations("xyz"),
    wrap=st.sampled_from([bytes, bytearray, memoryview, list, lambda data: np.frombuffer(data, dtype="u1")]),
)
def test_any_padding_endianness_and_order_of_fields(kinds, gaps, shape, row_padding, big, order, wrap):
    height, width = shape
    points = np.arange(3.0 * height * width).reshape(-1, 3) + 0.5  # exact in float32
    sign, offset, fields = ">" if big else "<", gaps[3], []
    for name, kind, gap in zip(order, kinds, gaps, strict=False):
        fields.append(Field(name, offset + gap, CODES[kind]))
        offset += gap + int(kind[1])
    step = offset + gaps[0]
    row = width * step + row_padding
    data = bytearray(np.random.default_rng(0).integers(0, 256, height * row, dtype=np.uint8).tobytes())
    for index, point in enumerate(points):
        start = (index // width) * row + (index % width) * step
        for field, kind in zip(fields, kinds, strict=True):
            value = np.array(point["xyz".index(field.name)], dtype=f"{sign}{kind}").tobytes()
            data[start + field.offset : start + field.offset + len(value)] = value
    found = from_message(Message(fields, step, wrap(bytes(data)), width, height, row, big))
    np.testing.assert_array_equal(found.points, points)


GOOD = Message([Field(name, 4 * k, 7) for k, name in enumerate("xyz")], 12, bytes(120), 10)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"data": bytes(119)}, "damaged PointCloud2"),
        ({"point_step": 0}, "damaged"),
        ({"point_step": 8}, "damaged"),
        ({"width": -1}, "damaged"),
        ({"width": 10**12}, "damaged"),
        ({"row_step": 3}, "damaged"),
        ({"fields": []}, "x, y and z"),
        ({"fields": GOOD.fields[:2]}, "x, y and z"),
        ({"fields": [Field("x", 0, 9), *GOOD.fields[1:]]}, "datatype 9"),
        ({"fields": [Field("x", -4, 7), *GOOD.fields[1:]]}, "damaged"),
        ({"fields": [Field("x", 2**40, 7), *GOOD.fields[1:]]}, "damaged"),
        ({"fields": [Field("x", "a", 7), *GOOD.fields[1:]]}, "damaged"),
        ({"data": None}, "damaged"),
        ({"data": "text"}, "damaged"),
        ({"height": None}, "damaged"),
    ],
)
def test_damaged_messages_are_named(change, said):
    with pytest.raises(InputError, match=f"source: .*{said}"):
        as_geometry(dataclasses.replace(GOOD, **change), "source")


def test_an_empty_message_is_a_frame_without_points():
    message = dataclasses.replace(GOOD, width=0, data=b"")
    assert len(read_frame(message, None).points) == 0
    with pytest.raises(InputError, match="it is empty"):
        as_geometry(message, "source")


def test_times_of_headers():
    def stamped(**parts: int) -> Any:
        return types.SimpleNamespace(header=types.SimpleNamespace(stamp=types.SimpleNamespace(**parts)))

    assert stamp_of(stamped(sec=12, nanosec=500_000_000)) == 12.5
    assert stamp_of(stamped(secs=12, nsecs=500_000_000)) == 12.5
    assert stamp_of(POINTS) is None


def test_the_first_lines_of_a_trimesh_user():
    trimesh = pytest.importorskip("trimesh")
    part = trimesh.creation.box([3.0, 2.0, 1.0])
    for value in (part.sample(300), part.vertices, trimesh.PointCloud(part.vertices)):
        assert isinstance(as_geometry(value, "source"), PointCloud)
    assert len(as_geometry(part.scene(), "source").faces) == 12
    for value in (part, (part.vertices, part.faces), [part.vertices, part.faces]):
        np.testing.assert_array_equal(as_geometry(value, "target").faces, part.faces)
    with pytest.raises(InputError, match="holds no faces"):
        as_geometry((POINTS, NORMALS), "source")


def test_the_same_everywhere():
    rng = np.random.default_rng(1)
    part = Mesh(CORNERS, FACES)
    scan = structured(**dict(zip("xyz", (rng.dirichlet(np.ones(3), 40) @ CORNERS[[1, 2, 3]]).T, strict=True)))
    target = dqreg.prepare_target((CORNERS, FACES))
    assert target.indexed.kind == "mesh"
    result = target.register(scan, "identity")
    plain = dqreg.register(np.column_stack([scan[n] for n in "xyz"]), part, "identity")
    np.testing.assert_array_equal(result.T_target_source, plain.T_target_source)
    again = result.attached(scan, (CORNERS, FACES)).deviations().values
    np.testing.assert_array_equal(again, plain.deviations().values)
    odometry = dqreg.Odometry()
    room = rng.uniform(-4, 4, (3000, 3))
    room[np.arange(3000), np.arange(3000) % 3] = np.sign(room[np.arange(3000), np.arange(3000) % 3]) * 4
    frame = PointCloud(room).to_pointcloud2("lidar", 1.5)
    assert odometry.register_frame(frame).verdict.level == "accepted"
    assert odometry.trajectory.times.tolist() == [1.5]


def test_open3d_objects_and_tensors():
    o3d = pytest.importorskip("open3d")
    cloud = PointCloud(POINTS, NORMALS)
    legacy = cloud.to_open3d()
    for value in (legacy, o3d.t.geometry.PointCloud.from_legacy(legacy, o3d.core.float64)):
        found = as_geometry(value, "source")
        np.testing.assert_allclose(found.points, POINTS, atol=1e-15)
        np.testing.assert_allclose(found.normals, NORMALS, atol=1e-15)
    for value in (o3d.core.Tensor(POINTS), legacy.points):
        np.testing.assert_array_equal(as_geometry(value, "source").points, POINTS)
    mesh = Mesh(CORNERS, FACES).to_open3d()
    np.testing.assert_array_equal(np.asarray(mesh.triangles), FACES)
    assert Mesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles)).is_closed


def test_laspy_and_small_gicp():
    laspy = pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-3] * 3, [500_000.0, 5_400_000.0, 0.0]
    las = laspy.LasData(header)
    las.xyz = POINTS + header.offsets
    assert np.abs(as_geometry(las, "source").points - POINTS - header.offsets).max() <= 0.5e-3 + 1e-9
    small_gicp = pytest.importorskip("small_gicp", reason="pip install 'dqreg[peers]'")
    found = as_geometry(small_gicp.PointCloud(POINTS), "source")
    np.testing.assert_array_equal(found.points, POINTS)
    # Its normals are raw memory until they are estimated.
    assert found.normals is None


class Tensor:
    """What a torch tensor offers, one that takes part in a gradient."""

    def __init__(self, rows: np.ndarray, attached: bool = True) -> None:
        self.rows, self.attached = rows, attached

    def detach(self) -> Tensor:
        return Tensor(self.rows, attached=False)

    def cpu(self) -> Tensor:
        return self

    def double(self) -> Tensor:
        return self

    def numpy(self) -> np.ndarray:
        assert not self.attached, "Can't call numpy() on Tensor that requires grad."
        return self.rows


class PolyData:
    """What PyVista's PolyData offers, with faces of four corners; as of PyVista 0.49."""

    def __init__(self, points: np.ndarray, faces: np.ndarray, data: dict[str, np.ndarray] | None = None) -> None:
        self.points, self.faces, self.point_data, self.n_points = points, faces, data or {}, len(points)
        self.regular_faces = np.reshape(faces, (-1, 5))[:, 1:] if len(faces) else faces

    def triangulate(self) -> Any:
        quads = self.regular_faces
        return types.SimpleNamespace(regular_faces=np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))


def test_tensors_and_pyvista():
    np.testing.assert_array_equal(as_geometry(Tensor(POINTS), "source").points, POINTS)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert as_geometry(PolyData(square, np.array([4, 0, 1, 2, 3])), "target").faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    cloud = as_geometry(PolyData(POINTS, np.zeros(0, dtype=int), {"Normals": NORMALS}), "source")
    np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-15)
    grid = types.SimpleNamespace(point_data={}, n_points=3, points=POINTS[:3])
    with pytest.raises(InputError, match="extract_surface"):
        as_geometry(grid, "source")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.zeros((5, 4)), r"pass array\[:, :3\]"),
        (np.zeros((5, 6, 3)), r"reshape\(-1, 3\)"),
        (structured(a=np.ones(40)), "must hold x, y and z; got a"),
        ({"x": [1.0, 2.0], "y": [1.0], "z": [2.0]}, "one length; got 2, 1, 1"),
        ({**XYZ, "t": np.zeros(3)}, "40 points and 3 times"),
        ({"sphericalRange": [1.0]}, "read_scan"),
        ({}, "got none"),
        (types.SimpleNamespace(read_scan=None, scan_count=1), "pass its path"),
        (object(), "array of real numbers"),
    ],
)
def test_what_is_no_cloud_is_told_what_to_do(value, said):
    with pytest.raises(InputError, match=f"source: .*{said}"):
        as_geometry(value, "source")


def test_messages_keep_the_digits_of_maps():
    far = POINTS + np.array([500_000.0, 5_400_000.0, 0.0])
    assert PointCloud(POINTS).to_pointcloud2().point_step == 12
    message = PointCloud(far, NORMALS).to_pointcloud2("map", 3.25)
    assert (message.point_step, message.header.frame_id) == (48, "map")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 250_000_000)
    np.testing.assert_array_equal(as_geometry(message, "source").points, far)
    with pytest.raises(InputError, match="float16"):
        PointCloud(POINTS).to_pointcloud2(precision="float16")


def test_what_goes_out_to_trimesh_and_pyvista(monkeypatch):
    pytest.importorskip("trimesh")
    mesh = Mesh(CORNERS, FACES, units="mm")
    out = mesh.to_trimesh()
    assert (out.is_watertight, out.units, len(out.vertices)) == (True, "mm", 4)
    np.testing.assert_array_equal(PointCloud(POINTS).to_trimesh().vertices, POINTS)
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(MissingDependencyError, match="pip install pyvista"):
        mesh.to_pyvista()
