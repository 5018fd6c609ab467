"""Clouds written as binary PLY, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, as_vectors
from dqreg.atomic import write_atomically
from dqreg.errors import InputError

PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar"}


def write_cloud(path: str | os.PathLike[str], points: Any, normals: Any = None, colors: Any = None) -> None:
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
    if Path(path).suffix.lower() != ".ply":
        raise InputError(f"cannot write {path}: clouds are written as PLY; give a name that ends in .ply")
    positions = as_vectors(points, "points")
    if not len(positions):
        raise InputError(f"cannot write {path}: there are no points")
    columns = _columns(("x", "y", "z"), positions, _smallest_type(positions))
    if normals is not None:
        directions = _per_point(normals, "normals", len(positions))
        columns |= _columns(("nx", "ny", "nz"), directions, _smallest_type(directions))
    if colors is not None:
        columns |= _columns(("red", "green", "blue"), _as_bytes(colors, len(positions)), "u1")
    row = np.dtype([(name, "<" + kind) for name, (_, kind) in columns.items()])
    rows = np.zeros(len(positions), dtype=row)
    for name, (values, _) in columns.items():
        rows[name] = values
    head = [f"property {PLY_NAMES[kind]} {name}" for name, (_, kind) in columns.items()]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *head, "end_header", ""]
    write_atomically(path, "\n".join(lines).encode("ascii") + rows.tobytes())


def _columns(names: tuple[str, str, str], values: FloatArray, kind: str) -> dict[str, tuple[FloatArray, str]]:
    return {name: (values[:, k], kind) for k, name in enumerate(names)}


def _smallest_type(values: FloatArray) -> str:
    # Beyond float32's range the comparison says no, as it should; the overflow itself is no news.
    with np.errstate(over="ignore"):
        return "f4" if np.array_equal(values.astype(np.float32), values) else "f8"


def _per_point(value: Any, name: str, count: int) -> FloatArray:
    array = as_vectors(value, name)
    if len(array) != count:
        raise InputError(f"{name} must have one row per point; got {len(array)} rows for {count} points")
    return array


def _as_bytes(value: Any, count: int) -> FloatArray:
    whole = np.asarray(value).dtype.kind in "iu"
    colors = _per_point(value, "colors", count)
    top = 255.0 if whole else 1.0
    if colors.min() < 0.0 or colors.max() > top:
        found = f"{colors.min():g} to {colors.max():g}"
        raise InputError(f"colors must be integers from 0 to 255 or floats from 0 to 1; got {found}")
    scaled: FloatArray = np.round(colors * (255.0 / top))
    return scaled
