"""Untrusted files: limits of scene files and archives, checked before any parser runs.

glTF may name other files and may promise numbers that no byte stands for; zip archives (3MF, npz) may unpack to a
thousand times their size; 3MF may build objects of objects, each level doubling the last, and carry XML entities.
"""

from __future__ import annotations

import json
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

from dqreg.errors import InputError, nearest

# How known files begin, what to call them, and the extensions under which they may stand.
SIGNATURES: tuple[tuple[bytes, str, tuple[str, ...]], ...] = (
    (b"ply\n", "a PLY file", (".ply",)),
    (b"ply\r", "a PLY file", (".ply",)),
    (b"# .PCD", "a PCD file", (".pcd",)),
    (b"\x93NUMPY", "a NumPy .npy file", (".npy",)),
    (b"PK\x03\x04", "a zip archive", (".npz", ".3mf")),
    (b"glTF", "a binary glTF (.glb) file", (".glb",)),
    (b"ISO-10303-21", "a STEP file", ()),
    (b"\xff\xd8\xff", "a JPEG image", ()),
    (b"\x89PNG", "a PNG image", ()),
    (b"%PDF", "a PDF document", ()),
    (b"\x1f\x8b", "a gzip archive (unpack it first)", ()),
    (b"LASF", "a LAS or LAZ scan", ()),
    (b"ASTM-E57", "an E57 scan", ()),
    (b"version https://git-lfs", "a Git LFS pointer (fetch the file itself with: git lfs pull)", ()),
    (b"<!DOCTYPE html", "a web page", ()),
    (b"<!doctype html", "a web page", ()),
    (b"<html", "a web page", ()),
)


def unreadable(path: Path, found: str, expected: str) -> InputError:
    """Error of a file that cannot be read, worded the same everywhere.

    >>> str(unreadable(Path("a.ply"), "no points", "at least one"))
    'cannot read a.ply: found no points; expected at least one'
    """
    return InputError(f"cannot read {path}: found {found}; expected {expected}")


def require_readable(path: str | os.PathLike[str]) -> Path:
    """Path of a file that exists, may be read and is not empty.

    >>> require_readable("no_such_scan.ply")
    Traceback (most recent call last):
    ...
    dqreg.errors.InputError: cannot read no_such_scan.ply: found no such file; expected the path of a scan or part
    """
    try:
        place = Path(path)
    except TypeError as error:
        raise InputError(f"a path must be text or a pathlib path; got {type(path).__name__}") from error
    try:
        if place.is_dir():
            raise unreadable(place, "a folder", "one file in it")
        if not place.exists():
            raise unreadable(place, "no such file", _near_names(place))
        if not place.is_file():
            raise unreadable(place, "a device or a pipe", "a file on disk")
        with place.open("rb") as stream:
            if not stream.read(1):
                raise unreadable(place, "an empty file (0 bytes)", "a scan or a part; was its transfer cut short?")
    except OSError as error:
        raise unreadable(place, (error.strerror or str(error)).lower(), "a file that may be read") from error
    return place


def require_own_kind(path: Path, extension: str) -> None:
    """Raise if the first bytes show that a file is of another kind than its extension says."""
    with path.open("rb") as stream:
        head = stream.read(64)
    for beginning, kind, extensions in SIGNATURES:
        if head.startswith(beginning) and extension not in extensions:
            remedy = f"; rename it to {extensions[0]}" if len(extensions) == 1 else ""
            raise unreadable(path, kind, f"what the extension {extension} promises{remedy}")


def _near_names(path: Path) -> str:
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return f"the path of a scan or part; the folder {path.parent} cannot be listed"
    near = nearest(path.name, names, 2)
    return f"perhaps {' or '.join(near)} in the same folder" if near else "the path of a scan or part"


# Real scans and parts compress to a fiftieth at most; deflate can reach a thousandth.
MAX_COMPRESSION = 200
# Faces or numbers, and bytes, that any file may expand to.
ALLOWED = 1_000_000
ALLOWED_BYTES = 64 << 20
# Triangles that a file may expand to for each of its bytes, by placing one body many times.
MAX_FACES_A_BYTE = 50
# Levels of objects made of objects.
MAX_DEPTH = 100


def max_faces(path: Path) -> int:
    """Triangles that a scene of this file size may hold."""
    return max(ALLOWED, MAX_FACES_A_BYTE * path.stat().st_size)


def require_safe_archive(path: Path) -> None:
    """Raise if a zip archive unpacks to more than any scan or part does."""
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, struct.error) as error:
        raise unreadable(path, f"a damaged archive ({error})", f"a whole {path.suffix.lower()} file") from error
    if unpacked > max(ALLOWED_BYTES, MAX_COMPRESSION * path.stat().st_size):
        raise unreadable(
            path, f"{path.stat().st_size} bytes that unpack to {unpacked}", f"at most {MAX_COMPRESSION} times as many"
        )


def require_safe_3mf(path: Path) -> None:
    """Raise if a 3MF file expands without bounds: by compression, XML entities, or objects made of objects."""
    require_safe_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.lower().endswith((".model", ".rels", ".xml")):
                    _require_safe_model(path, archive.read(name))
    except (
        zipfile.BadZipFile,
        zlib.error,
        OSError,
        EOFError,
        ValueError,
        NotImplementedError,
        RuntimeError,
        ElementTree.ParseError,
    ) as error:
        if type(error).__module__.startswith("dqreg"):
            raise
        raise unreadable(path, f"a damaged archive ({error})", "a whole .3mf file") from error


def _require_safe_model(path: Path, content: bytes) -> None:
    # The standard forbids document types, and with them all entities.
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise unreadable(path, "XML with a document type or entities", "a 3MF model, which has none")
    parts: dict[str, list[str]] = {}
    placed: list[str] = []
    inside = ""
    for event, element in ElementTree.iterparse(_Bytes(content), events=("start", "end")):
        kind = element.tag.rpartition("}")[2]
        if event == "start" and kind == "object":
            inside = element.get("id", "")
            parts.setdefault(inside, [])
        elif event == "start" and kind == "component":
            parts.setdefault(inside, []).append(element.get("objectid", ""))
        elif event == "start" and kind == "item":
            placed.append(element.get("objectid", ""))
        if event == "end":
            element.clear()
    counts = _bodies(path, parts)
    if sum(counts.get(name, 1) for name in placed) > ALLOWED:
        raise unreadable(path, "objects that expand to more than a million", "a part")


class _Bytes:
    """Bytes that a parser reads piece by piece."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def read(self, count: int = 1 << 16) -> bytes:
        piece = self._content[self._at : self._at + count]
        self._at += len(piece)
        return piece


def _bodies(path: Path, parts: dict[str, list[str]]) -> dict[str, int]:
    """How many bodies each object expands to; without recursion, for chains may be long."""
    counts: dict[str, int] = {}
    waiting = {name: {part for part in inner if part in parts} for name, inner in parts.items()}
    for _ in range(MAX_DEPTH):
        ready = [name for name, inner in waiting.items() if not inner - counts.keys()]
        for name in ready:
            counts[name] = max(1, sum(counts.get(part, 1) for part in parts[name]))
            del waiting[name]
    if waiting:
        raise unreadable(path, f"objects that contain themselves or expand {MAX_DEPTH} deep", "objects made of others")
    return counts


def require_safe_gltf(path: Path) -> None:
    """Raise if a glTF file names files outside its folder, or promises more numbers than it has bytes."""
    try:
        tree = json.loads(_gltf_json(path))
        uris = [item["uri"] for item in tree.get("buffers", []) if "uri" in item]
        counts = [item["count"] for item in tree.get("accessors", [])]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError) as error:
        raise unreadable(path, f"glTF whose JSON cannot be used ({error!r:.80})", "a whole glTF file") from error
    size = path.stat().st_size + sum(place.stat().st_size for place in _named_files(path, uris))
    if not all(type(count) is int and count >= 0 for count in counts) or sum(counts) > max(ALLOWED, 4 * size):
        raise unreadable(path, f"accessors that promise more than {size} bytes hold", "accessors of what is there")


def _named_files(path: Path, uris: list[Any]) -> Iterator[Path]:
    folder = path.parent.resolve()
    for uri in uris:
        if not isinstance(uri, str):
            raise unreadable(path, f"a buffer at {uri!r:.80}", "the name of a file")
        # trimesh takes any text with this word for the data themselves.
        if "base64," in uri:
            continue
        try:
            places = [(folder / name).resolve() for name in (uri, unquote(uri))]
            inside = all(place.is_relative_to(folder) for place in places) and "\\" not in uri and "://" not in uri
            found = inside and places[0].is_file()
        except (OSError, ValueError):
            inside = found = False
        if not inside:
            raise unreadable(path, f"a buffer at {uri!r:.80}", "files in its own folder")
        if not found:
            raise unreadable(path, f"a buffer at {uri!r:.80}, where no file is", "all files of the scene together")
        yield places[0]


def _gltf_json(path: Path) -> bytes:
    with path.open("rb") as stream:
        head = stream.read(20)
        if not head.startswith(b"glTF"):
            return head + stream.read()
        if len(head) < 20 or head[16:20] != b"JSON":
            raise ValueError("no JSON at the beginning")
        return stream.read(int.from_bytes(head[12:16], "little"))
