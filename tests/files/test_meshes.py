from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files import read_cloud, read_geometry, read_mesh


def block() -> Any:
    """A box of 1 x 2 x 3, off the origin; eight corners and twelve triangles."""
    body = trimesh.creation.box((1.0, 2.0, 3.0))
    body.apply_translation([10.0, 20.0, 30.0])
    return body


def save(body: Any, path: Path, **options: Any) -> Path:
    kind = options.pop("file_type", path.suffix.lower().lstrip("."))
    content = body.export(file_type=kind, **options)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    ("name", "kind", "units"),
    [
        ("part.stl", "stl", None),
        ("part.STL", "stl", None),
        ("part.stl", "stl_ascii", None),
        ("part.obj", "obj", None),
        ("part.off", "off", None),
        ("part.ply", "ply", None),
        ("part.glb", "glb", "m"),
        ("part.3MF", "3mf", "mm"),
    ],
)
def test_every_format_gives_the_same_closed_block(tmp_path: Path, name: str, kind: str, units: str | None) -> None:
    if kind == "3mf":
        # trimesh asks for them to write; the reader needs neither.
        pytest.importorskip("lxml")
        pytest.importorskip("networkx")
    body = block()
    mesh = read_mesh(save(body, tmp_path / name, file_type=kind))
    assert mesh.vertices.shape == (8, 3)
    assert mesh.faces.shape == (12, 3)
    assert mesh.faces.dtype == np.int64
    assert mesh.units == units
    np.testing.assert_array_equal([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], body.bounds)
    again = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert again.is_watertight
    assert again.volume == pytest.approx(6.0, rel=1e-12)


@pytest.mark.parametrize("writer", ["trimesh", "open3d"])
@pytest.mark.parametrize("kind", ["ply", "stl", "obj", "off", "glb", "gltf"])
def test_files_of_two_writers_have_the_volume_and_area_of_the_part(tmp_path: Path, kind: str, writer: str) -> None:
    body = trimesh.creation.annulus(1.0, 2.0, 3.0)
    body.apply_transform(trimesh.transformations.rotation_matrix(0.3, [1, 2, 3]))
    path = tmp_path / f"part.{kind}"
    if writer == "trimesh" and kind == "gltf":
        for name, content in trimesh.Scene(body).export(file_type="gltf").items():
            (tmp_path / name).write_bytes(content)
        (tmp_path / "model.gltf").rename(path)
    elif writer == "trimesh":
        save(body, path)
    else:
        open3d = load_open3d()
        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(body.vertices), open3d.utility.Vector3iVector(body.faces)
        )
        mesh.compute_vertex_normals()
        assert open3d.io.write_triangle_mesh(str(path), mesh)
    found = read_mesh(path)
    again = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert again.volume == pytest.approx(body.volume, rel=1e-5)
    assert again.area == pytest.approx(body.area, rel=1e-5)


@pytest.mark.parametrize(("name", "kind"), [("a.stl", "stl_ascii"), ("a.obj", "obj"), ("a.off", "off")])
def test_text_formats_keep_all_digits(tmp_path: Path, name: str, kind: str) -> None:
    body = block()
    body.vertices += [4400000.123456, 0.0, 0.0]
    mesh = read_mesh(save(body, tmp_path / name, file_type=kind))
    # The exporter prints eight decimals.
    np.testing.assert_allclose(mesh.vertices[:, 0].min(), body.bounds[0, 0], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_bodies_of_a_scene_stand_in_their_places(tmp_path: Path, kind: str) -> None:
    scene = trimesh.Scene()
    moved = trimesh.transformations.rotation_matrix(0.3, [1, 2, 3], [4, 5, 6])
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene.add_geometry(block(), transform=moved)
    scene.add_geometry(block(), transform=mirror)
    if kind == "glb":
        save(scene, tmp_path / "part.glb")
    else:
        for name, content in scene.export(file_type="gltf").items():
            (tmp_path / name).write_bytes(content)
        (tmp_path / "model.gltf").rename(tmp_path / "part.gltf")
    mesh = read_mesh(tmp_path / f"part.{kind}")
    assert mesh.vertices.shape == (16, 3)
    again = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    # A mirrored body left inside out would count its volume as -6. The file holds float32.
    assert again.volume == pytest.approx(12.0, rel=1e-5)
    expected = np.concatenate([trimesh.transform_points(block().vertices, pose) for pose in (moved, mirror)])
    gaps = np.linalg.norm(mesh.vertices[:, None] - expected[None], axis=2)
    assert gaps.min(axis=1).max() < 1e-5
    assert gaps.min(axis=0).max() < 1e-5


def test_a_mesh_is_not_taken_for_a_cloud(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a mesh of 12 faces; expected a cloud of points; pass the mesh as the target"):
        read_cloud(save(block(), tmp_path / "part.stl"))


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", TRIANGLE, "3 vertices and no faces"),
        ("a.obj", TRIANGLE + "f 1 2 9\n", "names vertex 8"),
        ("a.obj", TRIANGLE.replace("1", "nan") + "f 1 2 3\n", "NaN or infinite"),
        ("a.obj", TRIANGLE + "f 1 2 3\nf 2 1", "fewer than three corners"),
        ("a.obj", "hello\n", "no faces"),
        ("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "3 vertices and no faces"),
        ("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "1 faces; expected the 3 and 2 of its header"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "outside the range|names vertex"),
        ("a.off", "hello\n", "a file that begins 'hello'"),
        ("a.stl", "solid a\nendsolid a\n", "no faces"),
        ("a.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", "without its endsolid"),
        ("a.stl", "hello", "5 bytes; expected an STL mesh"),
        ("a.stl", bytes(84), "no faces"),
        ("a.stl", b"solid x".ljust(80) + struct.pack("<I", 9) + bytes(50), "promises 534 bytes in a file of 134"),
        ("a.stl", bytes(80) + struct.pack("<I", 2**32 - 1), "promises 214748364834 bytes"),
        ("a.stl", b"\xff\xd8\xff\xe0" + bytes(200), "a JPEG image"),
        ("a.stl", "ISO-10303-21;\nHEADER;\n", "a STEP file"),
        ("a.stl", struct.pack("<80sI12f2x", b"", 1, *[np.nan] * 12), "NaN or infinite"),
        ("a.glb", b"glTF" + bytes(20), "JSON cannot be used"),
        ("a.gltf", "{}", "cannot parse|no faces"),
        ("a.gltf", '{"asset": {"version": "2"}, "buffers": [{"uri": "gone.bin", "byteLength": 4}]}', "gone.bin', where no file is"),  # noqa: E501
        ("a.3mf", b"PK\x03\x04" + bytes(40), "a damaged archive"),
    ],
)  # fmt: skip
def test_a_bad_mesh_is_refused_in_words(
    tmp_path: Path, name: str, content: str | bytes, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as caught:
        read_geometry(file)
    assert str(caught.value).startswith(f"cannot read {file}: found ")
    assert capfd.readouterr() == ("", "")


def test_a_note_behind_the_triangles_of_a_binary_stl_is_passed_over(tmp_path: Path) -> None:
    file = save(trimesh.creation.icosphere(1), tmp_path / "part.stl", file_type="stl")
    alone, whole = read_mesh(file), file.read_bytes()
    file.write_bytes(whole + b"made by ...")
    np.testing.assert_array_equal(read_mesh(file).vertices, alone.vertices)
    # As long as a triangle it may be one that the header does not count.
    file.write_bytes(whole + bytes(50))
    with pytest.raises(InputError, match="was the number of triangles in its header kept"):
        read_mesh(file)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "off", "ply", "glb", "obj"])
@pytest.mark.parametrize("kept", [0.1, 0.4, 0.7, 0.95])
def test_a_file_cut_short_is_refused(tmp_path: Path, kind: str, kept: float) -> None:
    file = save(trimesh.creation.icosphere(1), tmp_path / f"part.{kind[:3]}", file_type=kind)
    whole = file.read_bytes()
    if kind == "obj":
        # OBJ counts nothing: only the end of a face can be missed, or all of them.
        kept = min(kept, 0.4)
        whole = whole[: whole.index(b"\nf ")] if kept > 0.3 else whole
    file.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(InputError):
        read_geometry(file)


def test_an_index_outside_its_own_body_does_not_borrow_from_the_next(tmp_path: Path) -> None:
    scene = trimesh.Scene([trimesh.Trimesh(np.eye(3), [[0, 1, 2]], process=False) for _ in range(2)])
    whole = scene.export(file_type="glb")
    length = struct.unpack_from("<I", whole, 12)[0]
    tree = json.loads(whole[20 : 20 + length])
    view = tree["bufferViews"][tree["accessors"][tree["meshes"][0]["primitives"][0]["indices"]]["bufferView"]]
    start = 20 + length + 8 + view.get("byteOffset", 0)
    assert struct.unpack_from("<3I", whole, start) == (0, 1, 2)
    (tmp_path / "part.glb").write_bytes(whole[:start] + struct.pack("<3I", 0, 1, 4) + whole[start + 12 :])
    with pytest.raises(InputError, match=r"names vertex -1|cannot parse"):
        read_mesh(tmp_path / "part.glb")


def test_what_trimesh_logs_does_not_reach_the_terminal(tmp_path: Path) -> None:
    # In a process of its own, because pytest's log handlers already keep the messages from the terminal.
    path = save(block(), tmp_path / "part.stl")
    code = f"""
import logging, trimesh
from dqreg.files import read_mesh
load = trimesh.load
def noisy(*arguments, **options):
    logging.getLogger("trimesh").warning("included but not defined!")
    return load(*arguments, **options)
trimesh.load = noisy
assert len(read_mesh({str(path)!r}).faces) == 12
assert not logging.getLogger("trimesh").handlers
"""
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_trimesh_waits_until_a_mesh_is_read() -> None:
    code = "import sys, dqreg.files; sys.exit('trimesh' in sys.modules or 'open3d' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_signalling_nan_is_told_as_one(tmp_path: Path) -> None:
    # Its conversion to float64 warned, which ends a program that takes warnings for errors.
    part, facets = trimesh.creation.box(), np.zeros(12, dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    facets["c"] = part.triangles
    facets["c"].view("<u4")[2, 1, 0] = 0x7FA00000
    file = tmp_path / "part.stl"
    file.write_bytes(bytes(80) + np.uint32(12).tobytes() + facets.tobytes())
    with pytest.raises(InputError, match="NaN"):
        read_mesh(file)
