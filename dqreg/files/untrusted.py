"""Untrusted files: what they are, and limits that are checked before any parser runs.

Zip archives (3MF, npz) may unpack to a thousand times their size, and scenes (glTF, 3MF) may place one body many times.
"""

from __future__ import annotations

import os
import struct
import zipfile
from pathlib import Path

from dqreg.errors import InputError, nearest

# How known files begin, what to call them, and the extensions under which they may stand.
SIGNATURES: tuple[tuple[bytes, str, tuple[str, ...]], ...] = (
    (b"ply\n", "a PLY file", (".ply",)),
    (b"ply\r", "a PLY file", (".ply",)),
    (b"# .PCD", "a PCD file", (".pcd",)),
    (b"\x93NUMPY", "a NumPy .npy file", (".npy",)),
    (b"PK\x03\x04", "a zip archive", (".npz", ".3mf")),
    (b"glTF", "a binary glTF (.glb) file", (".glb",)),
    (b"ISO-10303-21", "a STEP file", (".step", ".stp")),
    (b"\xff\xd8\xff", "a JPEG image", ()),
    (b"\x89PNG", "a PNG image", ()),
    (b"%PDF", "a PDF document", ()),
    (b"\x1f\x8b", "a gzip archive (unpack it first)", ()),
    (b"LASF", "a LAS or LAZ scan", (".las", ".laz")),
    (b"ASTM-E57", "an E57 scan", (".e57",)),
    (b"version https://git-lfs", "a Git LFS pointer (fetch the file itself with: git lfs pull)", ()),
    (b"<!DOCTYPE html", "a web page", ()),
    (b"<!doctype html", "a web page", ()),
    (b"<html", "a web page", ()),
)
# Endings of scans and parts, which a test compares with their readers; then those of poses, results, plans and bags.
ENDINGS = (
    ".ply", ".pcd", ".xyz", ".asc", ".xyzn", ".txt", ".csv", ".npy", ".npz", ".stl", ".obj", ".off", ".glb", ".gltf",
    ".3mf", ".step", ".stp", ".las", ".laz", ".e57", ".bin", ".pts",
    ".json", ".toml", ".tum", ".g2o", ".bag", ".mcap", ".db3",
)  # fmt: skip


def unreadable(path: Path, found: str, expected: str) -> InputError:
    """Error of a file that cannot be read, worded the same everywhere.

    >>> str(unreadable(Path("a.ply"), "no points", "at least one"))
    'cannot read a.ply: found no points; expected at least one'
    """
    return InputError(f"cannot read {path}: found {found}; expected {expected}")


def require_readable(path: str | os.PathLike[str], wanted: str = "a scan or part") -> Path:
    """Path of a file that exists, may be read and is not empty: no folder, no device, no pipe.

    >>> require_readable("no_such_scan.ply")
    Traceback (most recent call last):
    ...
    dqreg.errors.InputError: cannot read no_such_scan.ply: found no such file; expected the path of a scan or part
    """
    try:
        place = Path(path)
    except TypeError as error:
        raise InputError(f"a path must be text or a pathlib path; got {type(path).__name__}") from error
    if "\0" in str(place):
        raise unreadable(place, "a path with a null character", f"the path of {wanted}")
    try:
        if place.is_dir():
            raise unreadable(place, "a folder", "one file in it")
        if not place.exists() and str(place) == "-":
            raise unreadable(place, "the standard input, a pipe", "a file on disk; write what comes in to one first")
        if not place.exists():
            raise unreadable(place, "no such file", _near_names(place, wanted))
        if not place.is_file():
            raise unreadable(place, "a device or a pipe", "a file on disk")
        with place.open("rb") as stream:
            if not stream.read(1):
                raise unreadable(place, "an empty file (0 bytes)", f"{wanted}; was its transfer cut short?")
    except OSError as error:
        raise unreadable(place, (error.strerror or str(error)).lower(), "a file that may be read") from error
    return place


def read_record(path: str | os.PathLike[str], wanted: str) -> str:
    """Text of a record (a result, a recipe, a manifest ...), in UTF-8; whatever else lies there is an `InputError`."""
    place = require_readable(path, wanted)
    try:
        return place.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise unreadable(place, (error.strerror or str(error)).lower(), wanted) from error
    except UnicodeDecodeError as error:
        raise unreadable(place, "bytes that are no UTF-8 text", wanted) from error


def require_own_kind(path: Path, extension: str) -> None:
    """Raise if the first bytes show that a file is of another kind than its extension says."""
    with path.open("rb") as stream:
        head = stream.read(64)
    for beginning, kind, extensions in SIGNATURES:
        if head.startswith(beginning) and extension not in extensions:
            remedy = f"; rename it to {extensions[0]}" if len(extensions) == 1 else ""
            raise unreadable(path, kind, f"what the extension {extension} promises{remedy}")


def _near_names(path: Path, wanted: str) -> str:
    try:
        # Programs and pictures beside a scan are not what was meant.
        names = [e.name for e in path.parent.iterdir() if e.suffix.lower() in ENDINGS]
    except OSError:
        return f"the path of {wanted}; the folder {path.parent} cannot be listed"
    near = nearest(path.name, names, 2)
    return f"perhaps {' or '.join(near)} in the same folder" if near else f"the path of {wanted}"


# Real scans and parts compress to a tenth, seldom to a twentieth; deflate can reach a thousandth.
MAX_COMPRESSION = 30
# Faces or numbers, bytes of points, and bytes of all, that any file may expand to.
ALLOWED_COUNT, ALLOWED_POINT_BYTES = 1_000_000, 1_000_000
ALLOWED_BYTES = 64 << 20
# Levels of objects made of objects.
MAX_DEPTH = 100
# Bytes of a PLY or PCD file that its header must end within.
LONGEST_HEADER = 1 << 20


def max_faces(path: Path) -> int:
    """Triangles that a scene of this file size may hold."""
    # The densest files, zipped 3MF, have a triangle in five bytes.
    return max(ALLOWED_COUNT, path.stat().st_size // 2)


def require_proportion(path: Path, count: int, size: int) -> None:
    """Raise if a file promises more points, of so many bytes each, than it can hold."""
    held = path.stat().st_size
    if not 0 <= count * size <= max(ALLOWED_POINT_BYTES, MAX_COMPRESSION * held):
        found = f"{held} bytes that promise {count} points"
        raise unreadable(path, found, f"at most {MAX_COMPRESSION} times as many bytes")


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
