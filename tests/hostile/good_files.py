"""One small good file of every format and encoding: what the hostile ones are made from."""

from __future__ import annotations

import importlib.util
import io
import json
import struct
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from dqreg.synth.parts import box

UTM = np.array([500_000.0, 5_400_000.0, 100.0])
VERTICES, FACES = box((3.0, 2.0, 1.0))
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 3)).astype(np.float32)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def text_of(*columns: np.ndarray, sign: str = " ") -> str:
    """Rows of numbers."""
    return "".join(sign.join(f"{number:.7g}" for number in row) + "\n" for row in np.hstack(columns))


def ply(order: str, faces: bool) -> bytes:
    """PLY, text or binary of either byte order."""
    points = VERTICES if faces else np.hstack([POINTS, NORMALS])
    names = ["x", "y", "z"] if faces else ["x", "y", "z", "nx", "ny", "nz"]
    head = ["ply", f"format {order} 1.0", "comment units mm", f"element vertex {len(points)}"]
    head += [f"property float {name}" for name in names]
    if faces:
        head += [f"element face {len(FACES)}", "property list uchar int vertex_indices"]
    start = ("\n".join([*head, "end_header"]) + "\n").encode()
    if order == "ascii":
        return start + (text_of(points) + (text_of(np.full((len(FACES), 1), 3), FACES) if faces else "")).encode()
    sign = "<" if "little" in order else ">"
    body = points.astype(sign + "f4").tobytes()
    if faces:
        rows = np.zeros(len(FACES), dtype=[("n", "u1"), ("v", sign + "i4", (3,))])
        rows["n"], rows["v"] = 3, FACES
        body += rows.tobytes()
    return start + body


def pcd(encoding: str) -> bytes:
    """PCD, text, binary or compressed (as literal runs only)."""
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(POINTS)}\nHEIGHT 1\nVIEWPOINT 0 0 5 1 0 0 0\nPOINTS {len(POINTS)}\nDATA {encoding}\n"
    ).encode()
    if encoding == "ascii":
        return head + text_of(POINTS).encode()
    if encoding == "binary":
        return head + POINTS.astype("<f4").tobytes()
    flat = np.ascontiguousarray(POINTS.T.astype("<f4")).tobytes()
    packed = b"".join(bytes([len(run) - 1]) + run for run in (flat[k : k + 32] for k in range(0, len(flat), 32)))
    return head + struct.pack("<II", len(packed), len(flat)) + packed


def gltf_tree(uri: str | None = None) -> tuple[dict[str, object], bytes]:
    """Tree of a glTF scene with one body, and its buffer."""
    vertices, faces = VERTICES.astype("<f4").tobytes(), FACES.astype("<u2").tobytes()
    tree: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(VERTICES), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": FACES.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(vertices)},
            {"buffer": 0, "byteOffset": len(vertices), "byteLength": len(faces)},
        ],
        "buffers": [{"byteLength": len(vertices + faces)} | ({"uri": uri} if uri else {})],
    }
    return tree, vertices + faces


def glb(tree: dict[str, object], body: bytes) -> bytes:
    """Binary glTF of a tree and a buffer."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body += b"\0" * (-len(body) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(body)) + b"BIN\0" + body
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def archive(**members: bytes | str) -> bytes:
    """Zip archive of named members; ``__`` in a name stands for a slash and ``_dot_`` for a dot."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in members.items():
            # A fixed date: the same bytes on every run.
            info = zipfile.ZipInfo(name.replace("__", "/").replace("_dot_", "."))
            info.compress_type = zipfile.ZIP_DEFLATED
            made.writestr(info, content)
    return stream.getvalue()


MODEL = (
    '<?xml version="1.0"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
)


def model(resources: str, build: str) -> bytes:
    """3MF file of objects and what is built of them."""
    text = f"{MODEL}<resources>{resources}</resources><build>{build}</build></model>"
    return archive(**{"3D__3dmodel_dot_model": text})


def body(number: int = 1) -> str:
    """One object of a 3MF file."""
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in VERTICES)
    sides = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in FACES)
    mesh = f"<mesh><vertices>{corners}</vertices><triangles>{sides}</triangles></mesh>"
    return f'<object id="{number}" type="model">{mesh}</object>'


def npy(array: np.ndarray) -> bytes:
    """NumPy file of an array, without pickling."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


@cache
def good_files() -> dict[str, tuple[str, bytes]]:
    """Extension and content by name."""
    part = trimesh.Trimesh(VERTICES, FACES, process=False)
    text_stl, off, obj = (str(part.export(file_type=kind)).encode() for kind in ("stl_ascii", "off", "obj"))
    return {
        "ply cloud text": (".ply", ply("ascii", faces=False)),
        "ply cloud little": (".ply", ply("binary_little_endian", faces=False)),
        "ply cloud big": (".ply", ply("binary_big_endian", faces=False)),
        "ply mesh text": (".ply", ply("ascii", faces=True)),
        "ply mesh little": (".ply", ply("binary_little_endian", faces=True)),
        "ply mesh big": (".ply", ply("binary_big_endian", faces=True)),
        "pcd text": (".pcd", pcd("ascii")),
        "pcd binary": (".pcd", pcd("binary")),
        "pcd compressed": (".pcd", pcd("binary_compressed")),
        "xyz": (".xyz", text_of(POINTS).encode()),
        "xyzn": (".xyzn", text_of(POINTS, NORMALS).encode()),
        "csv": (".csv", b"x,y,z\n" + text_of(POINTS, sign=",").encode()),
        "npy": (".npy", npy(POINTS)),
        "npz": (".npz", archive(points_dot_npy=npy(POINTS), normals_dot_npy=npy(NORMALS))),
        "stl binary": (".stl", bytes(part.export(file_type="stl"))),
        "stl text": (".stl", text_stl),
        "off": (".off", off),
        "obj": (".obj", obj),
        "glb": (".glb", glb(*gltf_tree())),
        "3mf": (".3mf", model(body(), '<item objectid="1"/>')),
        "kitti": (".bin", np.hstack([POINTS, np.ones((12, 1))]).astype("<f4").tobytes()),
        "pts": (".pts", b"12\n" + text_of(POINTS, np.full((12, 1), -5)).encode()),
        **_from_extras(),
    }


def _from_extras() -> dict[str, tuple[str, bytes]]:
    """Files that only an optional package can write."""
    made = {}
    if importlib.util.find_spec("laspy") is not None:
        made["las"] = (".las", las(".las"))
    if importlib.util.find_spec("pye57") is not None:
        made["e57"] = (".e57", e57())
    return made


def las(extension: str) -> bytes:
    """LAS or LAZ in UTM."""
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-3] * 3, UTM
    made = laspy.LasData(header)
    made.xyz, made.gps_time = POINTS + UTM, np.arange(float(len(POINTS)))
    stream = io.BytesIO()
    made.write(stream, do_compress=extension == ".laz")
    return stream.getvalue()


def e57(
    translation: tuple[float, float, float] = (1.0, 2.0, 3.0),
    copies: int = 1,
    rotation: tuple[float, float, float, float] | None = (0.5, 0.5, 0.5, 0.5),
) -> bytes:
    """E57 of one setup or several, turned by a third of a circle about the diagonal; without a pose for None."""
    import pye57

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.e57"
        made = pye57.E57(str(path), mode="w")
        columns = {f"cartesian{axis}": rows.astype(np.float64) for axis, rows in zip("XYZ", POINTS.T, strict=True)}
        for number in range(copies):
            place = np.array(translation) + number * np.array([0.0, 0.0, 5.0])
            if rotation is None:
                made.write_scan_raw(columns)
            else:
                made.write_scan_raw(columns, translation=place, rotation=np.array(rotation))
        made.close()
        return path.read_bytes()
