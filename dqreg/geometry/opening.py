"""Whatever a caller gives as a source or a target, opened and named."""

from __future__ import annotations

import os
from typing import Any

from dqreg.errors import InputError
from dqreg.files import read_geometry
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.objects import as_geometry, of_file


def open_geometry(value: Any, name: str) -> PointCloud | Mesh:
    """Geometry of a path or an object."""
    if not isinstance(value, (str, os.PathLike)):
        return as_geometry(value, name)
    data = read_geometry(value)
    try:
        return of_file(data)
    except InputError as error:
        raise InputError(f"{name} {os.fspath(value)}: {error}") from error


def describe(value: Any) -> str:
    """Name of what a caller gave, for reports: a path as it was written, else the type and the size."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    size = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"{type(value).__name__}{size}"
