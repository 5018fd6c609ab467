"""Whatever a caller gives as a source or a target, opened and named."""

from __future__ import annotations

import os
from typing import Any

from dqreg.errors import InputError
from dqreg.files import read_geometry
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.objects import object_geometry, of_file


def as_geometry(value: Any, name: str = "points") -> PointCloud | Mesh:
    """The cloud or mesh that a file or an object holds, with all that it says of unit, viewpoint and times.

    Parameters
    ----------
    value : path or object
        A file of a format that `dqreg.files` reads; an (n, 3) array or tensor; a structured array, DataFrame or
        dictionary with x, y and z (pye57's too); a ROS PointCloud2 message; ``(vertices, faces)``; `PointCloud`,
        `Mesh`; what `dqreg.files` returns; an Open3D cloud or mesh (legacy or tensor), a trimesh cloud, mesh or scene,
        a PyVista PolyData, a laspy LasData, a small_gicp cloud.
    name : str
        What the caller calls it, for the message of an error.

    Returns
    -------
    PointCloud or Mesh
        Float64 copies or views; the object itself is never changed.

    Raises
    ------
    InputError
        If the object is none of these, or what it or the file holds cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> as_geometry([[0, 0, 0], [1, 0, 0]]).points.shape
    (2, 3)
    >>> named = np.array([(0, 1, 2, 0.5)], dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")])
    >>> as_geometry(named).points.tolist()
    [[0.0, 1.0, 2.0]]
    """
    if not isinstance(value, (str, os.PathLike)):
        return object_geometry(value, name)
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
