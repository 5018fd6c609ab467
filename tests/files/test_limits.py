"""What reading takes: memory by the size of the file, whatever stands in it."""

from __future__ import annotations

import copy
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_geometry
from dqreg.files.numpy_files import MAX_NUMBERS
from tests.hostile import good_files as made

# The promise is 20 bytes of memory a byte of the file, and 200 MB; here the files are too small for the second part to
# matter, and what Python itself keeps of them takes its place.
A_BYTE, ALWAYS = 20, 1_000_000
# Triangles and quadrilaterals by turns, with indices of one letter or byte, take more: the promise then holds up to
# files of 10 MB. Such a file has at most 256 vertices.
MIXED = 40
ROWS = 10_000
NINE = "".join(f"{a} {b} {c}\n" for a, b, c in np.random.default_rng(0).integers(0, 9, (9, 3)))


def ply(form: str, kind: str, body: bytes) -> bytes:
    """Nine vertices and as many faces as the others have, in the fewest bytes."""
    head = (
        f"ply\nformat {form} 1.0\nelement vertex 9\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\n"
        f"element face {ROWS}\nproperty list uchar uchar vertex_indices\nend_header\n"
    )
    return head.encode() + body


def glb() -> bytes:
    """Indices of one byte each."""
    tree, _ = made.gltf_tree()
    tree = copy.deepcopy(tree)
    faces = np.random.default_rng(1).integers(0, 9, 3 * ROWS).astype("u1").tobytes()
    vertices = np.random.default_rng(2).integers(0, 9, (9, 3)).astype("<f4").tobytes()
    positions, indices = tree["accessors"]
    positions["count"] = 9
    indices.update(componentType=5121, count=3 * ROWS)
    tree["bufferViews"] = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(vertices)},
        {"buffer": 0, "byteOffset": len(vertices), "byteLength": len(faces)},
    ]
    tree["buffers"] = [{"byteLength": len(vertices + faces)}]
    return made.glb(tree, vertices + faces)


POINTS = np.frombuffer("".join(NINE.split()).encode(), dtype="i1") - 48
DENSE: dict[str, tuple[str, Callable[[], bytes]]] = {
    "off": (".off", lambda: f"OFF\n9 {ROWS} 0\n{NINE}".encode() + b"3 0 1 2\n" * ROWS),
    "off of quadrilaterals": (".off", lambda: f"OFF\n9 {ROWS} 0\n{NINE}".encode() + b"4 0 1 2 8\n" * ROWS),
    "obj": (".obj", lambda: b"v 1 2 3\nv 3 2 1\nv 4 4 4\n" + b"f 1 2 3\n" * ROWS),
    "ply, text": (".ply", lambda: ply("ascii", "float", NINE.encode() + b"3 0 1 2\n" * ROWS)),
    "ply, text, mixed": (".ply", lambda: ply("ascii", "char", NINE.encode() + b"3 0 1 2\n4 0 1 2 3\n" * (ROWS // 2))),
    "ply, binary": (
        ".ply",
        lambda: ply("binary_little_endian", "char", POINTS.tobytes() + b"\3\0\1\2" * ROWS),
    ),
    "ply, binary, mixed": (
        ".ply",
        lambda: ply("binary_little_endian", "char", POINTS.tobytes() + b"\3\0\1\2\4\0\1\2\3" * (ROWS // 2)),
    ),
    "glb": (".glb", glb),
    "csv with gaps": (".csv", lambda: b"x;y;z\n" + b"1;2;\n3;4;5\n" * ROWS),
    "xyz": (".xyz", lambda: b"1 2 3\n4 5 6\n" * ROWS),
}


@pytest.mark.parametrize("name", DENSE)
def test_the_densest_files_take_their_share_of_memory(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suffix, make = DENSE[name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(make())
    # As for a file of many times the size.
    monkeypatch.setattr("dqreg.files.polygons.AT_ONCE", ROWS // 20)
    read_geometry(path)  # the parsers are imported
    tracemalloc.start()
    read_geometry(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < (MIXED if "mixed" in name else A_BYTE) * path.stat().st_size + ALWAYS


def test_arrays_that_pack_to_nothing_are_refused_before_they_are_numbers(tmp_path: Path) -> None:
    zeros = np.zeros((MAX_NUMBERS // 3 + 1, 3), dtype=np.int8)
    (tmp_path / "a.npz").write_bytes(made.archive(points_dot_npy=made.npy(zeros)))
    with pytest.raises(InputError, match=r"unpack to 3000\d\d\d numbers"):
        read_geometry(tmp_path / "a.npz")


def test_empty_elements_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dqreg.files.threemf.max_faces", lambda path: 50)
    (tmp_path / "a.3mf").write_bytes(made.model(made.body() + "<a/>" * 100, '<item objectid="1"/>'))
    with pytest.raises(InputError, match="more than 100 elements in a file of"):
        read_geometry(tmp_path / "a.3mf")


def test_concave_faces_of_many_corners_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dqreg.files.polygons.BASE_SQUARES", 2_000)
    monkeypatch.setattr("dqreg.files.polygons.SQUARES_PER_BYTE", 1)
    angles, radii = np.arange(40) * np.pi / 20, np.tile([2.0, 1.0], 20)
    star = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    corners = "".join(f"v {x:.3f} {y:.3f} 0\n" for x, y in star)
    face = "f " + " ".join(map(str, range(1, 41))) + "\n"
    (tmp_path / "a.obj").write_text(corners + face)
    assert len(read_geometry(tmp_path / "a.obj").faces) == 38
    (tmp_path / "a.obj").write_text(corners + face * 50)
    with pytest.raises(InputError, match="too many concave faces"):
        read_geometry(tmp_path / "a.obj")
