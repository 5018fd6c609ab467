"""Mesh files: binary STL by its layout, text STL and glTF with trimesh."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.gltf_guards import require_safe_gltf
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.untrusted import max_faces, unreadable

# Bytes before the triangles of a binary STL, and one of these: a normal that its corners tell as well, and a number.
HEADER_BYTES = 84
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("number", "<u2")])


def read_mesh_file(path: Path) -> MeshData:
    """Triangles of a mesh file; the bodies of a scene are put in their places and joined."""
    extension = path.suffix.lower()
    if extension == ".stl":
        if _is_binary_stl(path):
            return _read_binary_stl(path)
        _require_whole_stl(path)
    elif extension in (".glb", ".gltf"):
        require_safe_gltf(path)
    loaded = _load(path)
    vertices, faces = _joined(path, _placed(path, loaded))
    # glTF is in metres by definition; STL is silent.
    units = "m" if extension in (".glb", ".gltf") else None
    return make_mesh(path, vertices, faces, units)


def _load(path: Path) -> Any:
    import trimesh

    # Materials are other files and pictures, which measure nothing and are not opened.
    options: dict[str, Any] = {"skip_materials": True} if path.suffix.lower() in (".glb", ".gltf") else {}
    try:
        with _silent("trimesh"):
            return trimesh.load(path, process=False, **options)
    except Exception as error:
        # A damaged file may raise anything in the depths of a parser; each means the same to the user.
        reason = f"{type(error).__name__}: {error}"
        raise unreadable(
            path, f"what trimesh cannot parse ({reason})", f"a whole {path.suffix.lower()} mesh"
        ) from error


@contextlib.contextmanager
def _silent(logger: str) -> Iterator[None]:
    # Without any handler, Python writes a library's warnings to stderr; what matters is raised as an error here.
    handler = logging.NullHandler()
    logging.getLogger(logger).addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger(logger).removeHandler(handler)


def _placed(path: Path, loaded: Any) -> list[tuple[FloatArray, Any]]:
    import trimesh

    if not isinstance(loaded, trimesh.Scene):
        return [(np.eye(4), loaded)]
    try:
        placed = (loaded.graph[node] for node in loaded.graph.nodes_geometry)
        bodies = [(np.asarray(pose, dtype=np.float64), loaded.geometry[name]) for pose, name in placed]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise unreadable(path, f"bodies whose placement cannot be read ({error})", "a tree of nodes") from error
    if not all(np.isfinite(pose).all() for pose, _ in bodies):
        raise unreadable(path, "a body placed with NaN or infinity", "finite placements")
    if sum(len(getattr(body, "faces", ())) for _, body in bodies) > max_faces(path):
        raise unreadable(path, "bodies placed so often that they unfold to millions of faces", "a part")
    return bodies


def _joined(path: Path, bodies: list[tuple[FloatArray, Any]]) -> tuple[FloatArray, IntArray]:
    all_vertices, all_faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    # A body may stand in many places, and asking trimesh for its arrays is slow.
    shapes = {id(body): _arrays(path, body) for _, body in bodies}
    for pose, body in bodies:
        vertices, faces = shapes[id(body)]
        if not np.array_equal(pose, np.eye(4)):
            vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
        # A mirroring placement turns the triangles inside out; reversing them puts that right.
        mirrored = np.linalg.det(pose[:3, :3]) < 0.0
        # An index outside its own body must not land in the next one.
        invalid = (faces < 0) | (faces >= len(vertices))
        all_faces.append(np.where(invalid, -1, faces + count)[:, :: -1 if mirrored else 1])
        all_vertices.append(vertices)
        count += len(vertices)
    return np.concatenate(all_vertices), np.concatenate(all_faces)


def _arrays(path: Path, body: Any) -> tuple[FloatArray, IntArray]:
    vertices = np.asarray(body.vertices, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise unreadable(path, f"vertices of shape {vertices.shape}", "three coordinates each; was it cut short?")
    # Points and curves in a scene have no faces.
    return vertices, np.asarray(getattr(body, "faces", ()), dtype=np.int64).reshape(-1, 3)


def _is_binary_stl(path: Path) -> bool:
    """Whether a file is as long as its header promises, or by less than a triangle longer: some programs add a note."""
    with path.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
    # Letters in place of the number promise more than any text file holds.
    beyond = path.stat().st_size - HEADER_BYTES - FACET.itemsize * _promised(head)
    return len(head) == HEADER_BYTES and 0 <= beyond < FACET.itemsize


def _promised(head: bytes) -> int:
    """Triangles of a binary STL by its first bytes."""
    return int.from_bytes(head[80:HEADER_BYTES], "little")


def _read_binary_stl(path: Path) -> MeshData:
    # Without trimesh, whose import takes longer than most parts.
    with path.open("rb") as stream:
        count = _promised(stream.read(HEADER_BYTES))
    facets = np.fromfile(path, dtype=FACET, offset=HEADER_BYTES, count=count)
    # A signalling NaN, as damage makes it, is one that is told as any other.
    with np.errstate(invalid="ignore"):
        corners = facets["corners"].reshape(-1, 3).astype(np.float64)
    return make_mesh(path, corners, np.arange(len(corners)).reshape(-1, 3))


def _require_whole_stl(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(512)
        stream.seek(max(0, size - 512))
        tail = stream.read()
    promised = HEADER_BYTES + FACET.itemsize * _promised(head)
    # Binary files may begin with the word solid too, but no text holds a null byte.
    if b"\0" in head or not head.lstrip().lower().startswith(b"solid"):
        found = f"{size} bytes" if size < 84 else f"a header that promises {promised} bytes in a file of {size}"
        why = "was the file cut short?" if size < promised else "was the number of triangles in its header kept?"
        raise unreadable(path, found, f"an STL mesh of 84 bytes and 50 for each triangle; {why}")
    if b"endsolid" not in tail.lower():
        raise unreadable(path, "a text STL without its endsolid line", "a whole file; was it cut short?")
