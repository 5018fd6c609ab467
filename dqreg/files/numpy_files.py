"""NumPy's own files: one array (.npy), or named arrays (.npz). Pickled objects in them are never run."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.tables import nameless_cloud
from dqreg.files.untrusted import require_safe_archive, unreadable

Array = np.ndarray[tuple[int, ...], np.dtype[np.generic]]

# Arrays that change what `points` means: the file is then a packed sequence, its numbers no coordinates.
PACKING_NAMES = ("offsets", "scale")
# Numbers that an archive of any size may become, each of which takes a few float64 on its way; more of a larger one.
MAX_NUMBERS = 3_000_000
# Columns that no cloud has: an image.
MAX_COLUMNS = 20


def read_npy(path: Path) -> CloudData:
    """Cloud of an array of shape (n, 3), (n, 4) with an intensity, which is not used, or (n, 6) with normals."""
    try:
        # Mapped first: a header that promises too much fails before memory is taken. Then read, because a map of a
        # file that is cut short meanwhile ends the whole process.
        np.load(path, mmap_mode="r", allow_pickle=False)
        array = np.load(path, allow_pickle=False)
    except Exception as error:
        # A damaged header is parsed as Python, which fails in as many ways as Python has errors.
        raise unreadable(path, f"no plain array ({error})", "an array of numbers, as numpy.save writes it") from error
    table = _as_table(path, array, "the array")
    # Four rows of four are a pose.
    if table.shape[1] not in (3, 4, 6) or table.shape == (4, 4):
        is_wide = table.shape[1] > 6 and len(table) in (3, 4, 6)
        remedy = "; where each column is a point, save its transpose" if is_wide else ""
        if min(table.shape) > MAX_COLUMNS:
            remedy = "; of a depth image dqreg.PointCloud.from_depth makes a cloud"
        shapes = "shape (n, 3), (n, 4) with an intensity, or (n, 6) with normals"
        raise unreadable(path, f"an array of shape {table.shape}", f"{shapes}{remedy}")
    # The fourth of four is an intensity, as in text and in KITTI's frames, unless the first counts the rows.
    return nameless_cloud(path, table)


def read_npz(path: Path) -> CloudData:
    """Cloud of the arrays ``points`` (n, 3) and, if present, ``normals`` (n, 3)."""
    arrays = read_arrays(path, ("points", "normals"), refused=PACKING_NAMES)
    count = sum(array.size for array in arrays.values())
    if count > max(MAX_NUMBERS, path.stat().st_size // 2):
        raise unreadable(path, f"{path.stat().st_size} bytes that unpack to {count} numbers", "a scan")
    points = _as_table(path, arrays["points"], "the array points")
    normals = _as_table(path, arrays["normals"], "the array normals") if "normals" in arrays else None
    if points.shape[1] != 3 or (normals is not None and normals.shape != points.shape):
        found = f"points of shape {points.shape}" + ("" if normals is None else f", normals of shape {normals.shape}")
        raise unreadable(path, found, "shape (n, 3), the same for both")
    return make_cloud(path, points, normals)


def read_arrays(path: Path, wanted: Sequence[str], refused: Sequence[str] = ()) -> dict[str, Array]:
    """Those of the wanted arrays that an archive holds; the first of them must be there."""
    require_safe_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            if wanted[0] not in names:
                raise unreadable(path, f"the arrays {', '.join(names) or '(none)'}", f"an array named {wanted[0]}")
            if set(refused) & set(names):
                raise unreadable(path, "a packed sequence of scans (offsets, scale)", "one cloud; unpack it first")
            return {name: _member(path, archive, name) for name in wanted if name in names}
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise unreadable(path, f"a damaged archive ({error})", "arrays as numpy.savez writes them") from error


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> Array:
    size = archive.getinfo(f"{name}.npy").file_size
    try:
        with archive.open(f"{name}.npy") as stream:
            promised = _promised_bytes(stream)
        if promised > size:
            raise ValueError(f"its header promises {promised} bytes, the file has {size}")
        with archive.open(f"{name}.npy") as stream:
            array: Array = np.lib.format.read_array(stream, allow_pickle=False)
    except (zipfile.BadZipFile, zlib.error):
        raise
    except Exception as error:
        # As above: the header is parsed as Python.
        raise unreadable(path, f"no plain array {name} ({error})", "an array of numbers") from error
    return array


def numbers(path: Path, array: Array, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Array of real numbers and of this shape, in float64; None stands for any length."""
    fits = len(shape) == array.ndim and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "fiu":
        words = str(tuple("n" if want is None else want for want in shape)).replace("'", "")
        found = f"{name} of shape {array.shape} and type {array.dtype}"
        raise unreadable(path, found, f"real numbers of shape {words}")
    # The cast of a signalling NaN, or of a long double beyond float64, warns.
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(array, dtype=np.float64)


def _promised_bytes(stream: IO[bytes]) -> int:
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return math.prod(shape) * int(dtype.itemsize)


def _as_table(path: Path, array: Array, name: str) -> FloatArray:
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        found = f"{name} of shape {array.shape} and type {array.dtype}"
        raise unreadable(path, found, "real numbers of shape (n, 3), or (n, 6) with normals")
    # The cast of a signalling NaN, or of a long double beyond float64, warns; both are dropped and counted.
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(array, dtype=np.float64)
