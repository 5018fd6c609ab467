from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dqreg.errors import InputError
from dqreg.files import CloudData, MeshData, read_cloud, read_geometry, read_mesh, write_cloud
from dqreg.files.ply_header import comments_of
from dqreg.files.polygons import fans

# Geodetic coordinates: float32 keeps half a metre of them.
FAR = np.array([[4400000.123456, 5500000.654321, 1.0], [1.0, 2.0, 3.0]])


def ply(encoding: str, *elements: tuple[str, int, str], newline: str = "\n") -> bytes:
    lines = ["ply", f"format {encoding} 1.0", "comment a remark", "obj_info another"]
    for name, count, properties in elements:
        lines.append(f"element {name} {count}")
        lines += [f"property {text.strip()}" for text in properties.split(",")]
    return (newline.join([*lines, "end_header"]) + newline).encode()


XYZ = "float x, float y, float z"
XYZ64 = "double x, double y, double z"
LE, BE = "binary_little_endian", "binary_big_endian"


@pytest.mark.parametrize(
    "content",
    [
        ply(LE, ("vertex", 2, XYZ64)) + FAR.tobytes(),
        ply(BE, ("vertex", 2, XYZ64)) + FAR.astype(">f8").tobytes(),
        ply("ascii", ("vertex", 2, XYZ64)) + b"4400000.123456 5500000.654321 1\n1 2 3\n",
        ply("ascii", ("vertex", 2, XYZ)) + b"4400000.123456 5500000.654321 1\n\n1 2 3",
        ply("ascii", ("vertex", 2, XYZ64), newline="\r\n") + b"4400000.123456 5500000.654321 1\r\n1 2 3\r\n",
        ply(LE, ("vertex", 2, XYZ64), newline="\r\n") + FAR.tobytes(),
        ply(LE, ("vertex", 2, XYZ64), newline="\r") + FAR.tobytes(),
        ply(LE, ("vertex", 2, "double z, double Y, double X")) + FAR[:, ::-1].tobytes(),
        ply(LE, ("camera", 1, "float a"), ("vertex", 2, XYZ64)) + bytes(4) + FAR.tobytes(),
        ply("ascii", ("camera", 1, "float a"), ("vertex", 2, XYZ64)) + b"7\n4400000.123456 5500000.654321 1\n1 2 3\n",
        ply(LE, ("vertex", 2, XYZ64), ("face", 0, "list uchar int vertex_indices")) + FAR.tobytes(),
        ply(LE, ("vertex", 2, f"{XYZ64}, {XYZ64}")) + np.hstack([FAR, 0 * FAR]).tobytes(),
    ],
)
def test_every_layout_gives_all_digits(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "scan.PLY"
    file.write_bytes(content)
    cloud = read_cloud(file)
    np.testing.assert_array_equal(cloud.points, FAR)
    assert cloud.normals is None
    assert cloud.dropped == 0
    assert cloud.points.dtype == np.float64


def test_types_may_differ_and_pads_are_skipped(tmp_path: Path) -> None:
    file = tmp_path / "scan.ply"
    head = ply(LE, ("vertex", 1, "float x, double y, short z, uchar pad, float nx, float ny, float nz"))
    file.write_bytes(head + struct.pack("<fdhBfff", 1.5, 0.1, -7, 9, 0, 0, 1))
    cloud = read_cloud(file)
    assert cloud.points.tolist() == [[1.5, 0.1, -7.0]]
    assert cloud.normals is not None
    assert cloud.normals.tolist() == [[0.0, 0.0, 1.0]]


def test_a_signalling_nan_is_as_good_as_any(tmp_path: Path) -> None:
    file = tmp_path / "scan.ply"
    file.write_bytes(ply(LE, ("vertex", 2, XYZ)) + bytes.fromhex("0100a07f") + bytes(8) + bytes(12))
    assert read_cloud(file).dropped == 1


@settings(deadline=None, max_examples=25)
@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 20), st.just(3)), elements=st.floats()))
def test_binary_round_trip_drops_only_rows_that_are_not_finite(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray
) -> None:
    file = tmp_path_factory.mktemp("ply") / "scan.ply"
    file.write_bytes(ply(BE, ("vertex", len(points), XYZ64)) + points.astype(">f8").tobytes())
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        with pytest.raises(InputError, match="all NaN or infinite"):
            read_cloud(file)
    else:
        cloud = read_cloud(file)
        np.testing.assert_array_equal(cloud.points, finite)
        assert cloud.dropped == len(points) - len(finite)


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
LIST = "list uchar int vertex_indices"


@pytest.mark.parametrize(
    "content",
    [
        ply(LE, ("vertex", 4, XYZ64), ("face", 2, LIST))
        + SQUARE.tobytes()
        + struct.pack("<BiiiBiii", 3, 0, 1, 2, 3, 0, 2, 3),
        ply(BE, ("vertex", 4, XYZ64), ("face", 1, "list uint ushort vertex_index"))
        + SQUARE.astype(">f8").tobytes()
        + struct.pack(">IHHHH", 4, 0, 1, 2, 3),
        ply("ascii", ("vertex", 4, XYZ), ("face", 1, LIST)) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        ply("ascii", ("vertex", 4, XYZ), ("edge", 1, "int a"), ("face", 2, f"list uchar float uv, {LIST}, uchar red"))
        + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n5\n2 .5 .5 3 0 1 2 255\n0 3 0 2 3 255\n",
        ply(LE, ("vertex", 4, XYZ64), ("edge", 1, "int a"), ("face", 2, f"uchar red, {LIST}, list uchar float uv"))
        + SQUARE.tobytes()
        + bytes(4)
        + struct.pack("<BBiiiBfBBiiiB", 9, 3, 0, 1, 2, 1, 0.5, 9, 3, 0, 2, 3, 0),
    ],
)
def test_faces_of_every_layout_make_the_same_square(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "part.ply"
    file.write_bytes(content)
    mesh = read_mesh(file)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], SQUARE[[[0, 1, 2], [0, 2, 3]]])
    assert mesh.faces.dtype == np.int64


def test_triangles_and_quads_may_be_mixed(tmp_path: Path) -> None:
    file = tmp_path / "part.ply"
    head = ply(LE, ("vertex", 4, XYZ64), ("face", 3, LIST)) + SQUARE.tobytes()
    file.write_bytes(head + struct.pack("<BiiiBiiiiBii", 3, 0, 1, 2, 4, 3, 2, 1, 0, 2, 0, 1))
    mesh = read_mesh(file)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], SQUARE[[[0, 1, 2], [3, 2, 1], [3, 1, 0]]])


@settings(deadline=None, max_examples=50)
@given(st.lists(st.lists(st.integers(0, 99), max_size=7), max_size=6))
def test_fans_are_what_a_loop_gives(polygons: list[list[int]]) -> None:
    lengths = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    corners = np.array([corner for polygon in polygons for corner in polygon], dtype=np.int64)
    expected = [[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)]
    assert fans(lengths, corners).tolist() == expected


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"plx\n", r"begins with b'plx\\n'"),
        (b"ply\nformat ascii 1.0\n", "without its end_header"),
        (ply("ascii", ("vertex", 0, XYZ)), "found no points"),
        (ply("ascii", ("point", 1, XYZ)) + b"1 2 3\n", "without vertices"),
        (ply("ascii", ("vertex", 1, "float x, float y")) + b"1 2\n", "columns x, y; expected columns named x, y and z"),
        (ply("ascii", ("vertex", 2, XYZ)) + b"1 2 3\n123456789 1\n", "number of columns changed|row"),
        (ply("ascii", ("vertex", 2, XYZ)) + b"1 2 3 123456\n1 2 3 123456\n", "2 rows of 4 numbers"),
        (ply("ascii", ("vertex", 2, XYZ)) + b"1.23456789 2.3456789 3.456789\n", "1 vertex lines"),
        (ply("ascii", ("vertex", 1, XYZ)) + b"1 two 3\n", "two"),
        (ply("ascii", ("vertex", 10**15, XYZ)) + b"1 2 3\n", "promises 1000000000000000 vertex rows but only 6 bytes"),
        (ply(LE, ("vertex", 10**15, XYZ)) + bytes(12), "promises 1000000000000000 vertex rows but only 12 bytes"),
        (ply(LE, ("vertex", 2, XYZ64)) + FAR.tobytes()[:-1], "only 47 bytes"),
        (ply(LE, ("vertex", -2, XYZ64)) + FAR.tobytes(), "the header line 'element vertex -2'"),
        (ply("ascii", ("vertex", 1, "quad x")) + b"1\n", "the header line 'property quad x'"),
        (ply("middle_endian", ("vertex", 1, XYZ)) + bytes(12), "the header line 'format middle_endian 1.0'"),
        (b"ply\nelement vertex 1\nproperty int x\nend_header\n1 ", "without a format line"),
        (b"ply\nformat ascii 1.0\nproperty int x\nend_header\n", "the header line 'property int x'"),
        (ply(LE, ("vertex", 1, f"{XYZ}, list uchar int a")) + bytes(13), "lists of varying length"),
        (
            ply("ascii", ("vertex", 3, XYZ), ("tristrips", 1, LIST)) + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "triangle strips",
        ),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, "int a")) + b"1 2 3\n4\n", "faces without vertex indices"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 2, LIST)) + b"1 2 3\n3 0 0 0\n", "1 face lines"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, LIST)) + b"1 2 3\n3 0 0\n", "the face line '3 0 0'"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, LIST)) + b"1 2 3\n3 0 0 7\n", "names vertex 7"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, LIST)) + b"1 2 3\n3 0 0 -1\n", "names vertex -1"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, LIST)) + b"1 2 3\n3 0 0 %d\n" % 10**30, "64 bits"),
        (ply("ascii", ("vertex", 1, XYZ), ("face", 1, LIST)) + b"nan 2 3\n3 0 0 0\n", "NaN or infinite"),
        (ply(LE, ("vertex", 1, XYZ), ("face", 9, LIST)) + bytes(12) + b"\3" + bytes(12), "ends within its faces"),
        (ply(LE, ("vertex", 1, XYZ), ("face", 1, LIST)) + bytes(12) + b"\xff" + bytes(12), "ends within its faces"),
        (ply(LE, ("vertex", 1, XYZ), ("face", 1, LIST)) + bytes(13), "no faces"),
        (ply(LE, ("vertex", 1, XYZ), ("face", 1, LIST)) + bytes(12) + struct.pack("<Biii", 3, 0, 9, 0), "vertex 9"),
        (ply("ascii", ("vertex", 1, XYZ)) + b"1 2 3\0", "binary data"),
    ],
)
def test_a_bad_file_is_refused_in_words(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "scan.ply"
    file.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_geometry(file)
    assert str(caught.value).startswith(f"cannot read {file}: found ")
    assert "expected" in str(caught.value)


def test_faces_decide_between_mesh_and_cloud(tmp_path: Path) -> None:
    with_faces, without = tmp_path / "part.ply", tmp_path / "scan.ply"
    body = b"0 0 0\n1 0 0\n0 1 0\n"
    with_faces.write_bytes(ply("ascii", ("vertex", 3, XYZ), ("face", 1, LIST)) + body + b"3 0 1 2\n")
    without.write_bytes(ply("ascii", ("vertex", 3, XYZ)) + body)
    assert isinstance(read_geometry(with_faces), MeshData)
    assert isinstance(read_geometry(without), CloudData)
    with pytest.raises(InputError, match="a mesh of 1 faces; expected a cloud of points; pass the mesh as the target"):
        read_cloud(with_faces)
    with pytest.raises(InputError, match="3 points and no faces; expected a mesh"):
        read_mesh(without)


@pytest.mark.parametrize("place", [[0.0, 0.0, 0.0], [0.1, -2e-9, 4.4e6], [1.0 / 3.0, 1e30, -7.0]])
def test_a_viewpoint_in_a_comment_is_read_to_the_last_bit(tmp_path: Path, place: list[float]) -> None:
    write_cloud(tmp_path / "a.ply", np.eye(3), comments=comments_of("mm", np.array(place)))
    cloud = read_cloud(tmp_path / "a.ply")
    assert cloud.viewpoint is not None
    assert (cloud.viewpoint.tolist(), cloud.units) == (place, "mm")


@pytest.mark.parametrize(
    "comments",
    [
        [],
        ["viewpoint"],
        ["viewpoint 1 2"],
        ["viewpoint 1 2 3 4"],
        ["viewpoint 1 2 e"],
        ["viewpoint 1 2 1e999"],
        ["my viewpoint 1 2 3"],
        ["viewpoint 1 2 3", "viewpoint 1 2 4"],
    ],
    ids=str,
)
def test_what_is_no_viewpoint_is_a_comment(tmp_path: Path, comments: list[str]) -> None:
    write_cloud(tmp_path / "a.ply", np.eye(3), comments=comments)
    assert read_cloud(tmp_path / "a.ply").viewpoint is None
