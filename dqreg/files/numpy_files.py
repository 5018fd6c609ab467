"""NumPy's own files: one array (.npy), or named arrays (.npz). Pickled objects in them are never run."""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.tables import nameless_cloud
from dqreg.files.untrusted import require_safe_archive, unreadable

# Arrays that change what `points` means: the file is then a packed sequence, its numbers no coordinates.
PACKING_NAMES = ("offsets", "scale")


def read_npy(path: Path) -> CloudData:
    """Cloud of an array of shape (n, 3), or (n, 6) with normals."""
    try:
        # Mapped first: a header that promises too much fails before memory is taken. Then read, because a map of a
        # file that is cut short meanwhile ends the whole process.
        np.load(path, mmap_mode="r", allow_pickle=False)
        array = np.load(path, allow_pickle=False)
    except Exception as error:
        # A damaged header is parsed as Python, which fails in as many ways as Python has errors.
        raise unreadable(path, f"no plain array ({error})", "an array of numbers, as numpy.save writes it") from error
    return nameless_cloud(path, _as_table(path, array, "the array"))


def read_npz(path: Path) -> CloudData:
    """Cloud of the arrays ``points`` (n, 3) and, if present, ``normals`` (n, 3)."""
    require_safe_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            if "points" not in names:
                raise unreadable(path, f"the arrays {', '.join(names) or '(none)'}", "an array named points")
            if set(PACKING_NAMES) & set(names):
                raise unreadable(path, "a packed sequence of scans (offsets, scale)", "one cloud; unpack it first")
            points = _member(path, archive, "points")
            normals = _member(path, archive, "normals") if "normals" in names else None
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise unreadable(path, f"a damaged archive ({error})", "arrays as numpy.savez writes them") from error
    if points.shape[1] != 3 or (normals is not None and normals.shape != points.shape):
        found = f"points of shape {points.shape}" + ("" if normals is None else f", normals of shape {normals.shape}")
        raise unreadable(path, found, "shape (n, 3), the same for both")
    return make_cloud(path, points, normals)


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> FloatArray:
    size = archive.getinfo(f"{name}.npy").file_size
    try:
        with archive.open(f"{name}.npy") as stream:
            promised = _promised_bytes(stream)
        if promised > size:
            raise ValueError(f"its header promises {promised} bytes, the file has {size}")
        with archive.open(f"{name}.npy") as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
    except (zipfile.BadZipFile, zlib.error):
        raise
    except Exception as error:
        # As above: the header is parsed as Python.
        raise unreadable(path, f"no plain array {name} ({error})", "an array of numbers") from error
    return _as_table(path, array, f"the array {name}")


def _promised_bytes(stream: IO[bytes]) -> int:
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return math.prod(shape) * int(dtype.itemsize)


def _as_table(path: Path, array: np.ndarray[tuple[int, ...], np.dtype[np.generic]], name: str) -> FloatArray:
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        found = f"{name} of shape {array.shape} and type {array.dtype}"
        raise unreadable(path, found, "real numbers of shape (n, 3), or (n, 6) with normals")
    # The cast of a signalling NaN, or of a long double beyond float64, warns; both are dropped and counted.
    with np.errstate(invalid="ignore", over="ignore"):
        return np.array(array, dtype=np.float64)
