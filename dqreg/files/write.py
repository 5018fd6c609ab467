"""Clouds written as binary PLY, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, as_float, as_vectors
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically

PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar"}
Columns = dict[str, tuple[NDArray[Any], str]]


def write_cloud(
    path: str | os.PathLike[str],
    points: Any,
    normals: Any = None,
    colors: Any = None,
    *,
    fields: Mapping[str, Any] | None = None,
    comments: Sequence[str] = (),
) -> None:
    """Write a cloud as a binary PLY file; on any failure no file, or the old one, is left.

    Coordinates are written in float32 if that loses no digit of any of them, else in float64; so are normals.

    Parameters
    ----------
    path : str or path
        A name that ends in ``.ply``, in an existing folder.
    points : array_like, (n, 3)
        Finite positions, n >= 1.
    normals : array_like, (n, 3), optional
        One finite direction per point.
    colors : array_like, (n, 3), optional
        Red, green, blue per point: integers from 0 to 255, or floats from 0 to 1.
    fields : mapping of str to array_like, (n,), optional
        Further numbers per point, each under its own name (letters, digits, underscores); float64.
    comments : sequence of str
        Lines of the header; what is not ASCII becomes a question mark.

    Raises
    ------
    InputError
        If an array does not fit or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.files import read_cloud
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_cloud(Path(folder) / "two.ply", [[0, 0, 0], [4400000.123456, 0, 1]])
    ...     read_cloud(Path(folder) / "two.ply").points[1, 0].item()
    4400000.123456
    """
    require_cloud_suffix(path)
    positions = as_vectors(points, "points")
    if not len(positions):
        raise InputError(f"cannot write {path}: there are no points")
    columns = _columns(("x", "y", "z"), positions, _smallest_type(positions))
    if normals is not None:
        directions = _per_point(normals, "normals", len(positions))
        columns |= _columns(("nx", "ny", "nz"), directions, _smallest_type(directions))
    if colors is not None:
        columns |= _columns(("red", "green", "blue"), _as_bytes(colors, len(positions)), "u1")
    for name, values in (fields or {}).items():
        columns[_field_name(name, columns)] = (_one_per_point(values, name, len(positions)), "f8")
    write_atomically(path, ply_bytes(columns, comments))


def require_cloud_suffix(path: str | os.PathLike[str]) -> None:
    """Refuse a name that promises another format than `write_cloud` writes."""
    if Path(path).suffix.lower() != ".ply":
        raise InputError(f"cannot write {path}: clouds are written as PLY; give a name that ends in .ply")


def ply_bytes(columns: Columns, comments: Sequence[str] = ()) -> bytes:
    """Binary PLY of points: under each name the values, one a point, and the type that they get."""
    count = len(columns["x"][0])
    row = np.dtype([(name, "<" + kind) for name, (_, kind) in columns.items()])
    head = [f"property {PLY_NAMES[kind]} {name}" for name, (_, kind) in columns.items()]
    notes = [f"comment {' '.join(line.split())}" for line in comments]
    first = ["ply", "format binary_little_endian 1.0", *notes, f"element vertex {count}"]
    header = "\n".join([*first, *head, "end_header", ""]).encode("ascii", errors="replace")
    # One block for header and rows: a cloud of 20 million points is not copied more than once.
    block = np.zeros(len(header) + count * row.itemsize, dtype=np.uint8)
    block[: len(header)] = np.frombuffer(header, dtype=np.uint8)
    rows = block[len(header) :].view(row)
    for name, (values, _) in columns.items():
        rows[name] = values
    return block.tobytes()


def _columns(names: tuple[str, str, str], values: FloatArray, kind: str) -> Columns:
    return {name: (values[:, k], kind) for k, name in enumerate(names)}


def _field_name(name: str, taken: Mapping[str, Any]) -> str:
    if not (name.isidentifier() and name.isascii()) or name in taken:
        raise InputError(f"a field needs a name of its own of letters, digits and underscores; got {name!r}")
    return name


def _one_per_point(value: Any, name: str, count: int) -> FloatArray:
    array = as_float(value, name)
    if array.shape != (count,):
        raise InputError(f"{name} must be {count} numbers, one per point; got shape {array.shape}")
    return array


def _smallest_type(values: FloatArray) -> str:
    # Beyond float32's range the comparison is False, as it should be; the overflow needs no warning.
    with np.errstate(over="ignore"):
        return "f4" if np.array_equal(values.astype(np.float32), values) else "f8"


def _per_point(value: Any, name: str, count: int) -> FloatArray:
    array = as_vectors(value, name)
    if len(array) != count:
        raise InputError(f"{name} must have one row per point; got {len(array)} rows for {count} points")
    return array


def _as_bytes(value: Any, count: int) -> FloatArray:
    colors = _per_point(value, "colors", count)
    whole = np.asarray(value).dtype.kind in "iu"
    top = 255.0 if whole else 1.0
    if colors.min() < 0.0 or colors.max() > top:
        found = f"{colors.min():g} to {colors.max():g}"
        raise InputError(f"colors must be integers from 0 to 255 or floats from 0 to 1; got {found}")
    scaled: FloatArray = np.round(colors * (255.0 / top))
    return scaled
