"""A checked cloud of points, with normals and the sensor's place where they are known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, as_float, as_vectors
from dqreg.errors import InputError


@dataclasses.dataclass(frozen=True)
class PointCloud:
    """Points of one frame, float64; rows that are not finite are left out and counted.

    Parameters
    ----------
    points : array_like, (n, 3)
        Positions in the cloud's own frame, any length unit.
    normals : array_like, (n, 3), optional
        One direction per point; lengths other than one are normalised. A row that is zero or not finite costs
        its point, because a normal was promised there.
    viewpoint : array_like, (3,), optional
        Where the sensor stood, in the same frame; it orients estimated normals.
    units : str, optional
        Length unit, where the file says so ("mm", "m", ...).
    dropped : int
        Rows left out so far; those found here are added.

    Attributes
    ----------
    points : ndarray, (n, 3)
        The finite points.
    normals : ndarray, (n, 3) or None
        Unit normals of the same rows.

    Raises
    ------
    InputError
        If shapes do not match or no usable point is left.

    Examples
    --------
    >>> cloud = PointCloud([[0, 0, 0], [1, 0, 0], [float("nan"), 0, 0]])
    >>> len(cloud), cloud.dropped
    (2, 1)
    """

    points: FloatArray
    normals: FloatArray | None = None
    viewpoint: FloatArray | None = None
    units: str | None = None
    dropped: int = 0

    def __post_init__(self) -> None:
        points = as_vectors(self.points, "points", finite=False)
        keep = np.isfinite(points).all(axis=1)
        normals = None if self.normals is None else _unit_normals(self.normals, len(points))
        if normals is not None:
            keep &= np.isfinite(normals).all(axis=1)
        lost = int(len(points) - np.count_nonzero(keep))
        if lost == len(points):
            found = "it is empty" if not lost else f"all {lost} rows hold NaN, infinity or a normal that is zero"
            raise InputError(f"a cloud needs at least one finite point; {found}")
        if lost:
            points, normals = points[keep], None if normals is None else normals[keep]
        _freeze(self, points=points, normals=normals, dropped=self.dropped + lost, viewpoint=_viewpoint(self.viewpoint))

    def __len__(self) -> int:
        return len(self.points)


def _freeze(cloud: PointCloud, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(cloud, name, value)


def _unit_normals(value: Any, count: int) -> FloatArray:
    normals = as_vectors(value, "normals", finite=False)
    if len(normals) != count:
        raise InputError(f"normals must be one row per point; got {len(normals)} normals for {count} points")
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: FloatArray = np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 0.0)
    return unit


def _viewpoint(value: Any) -> FloatArray | None:
    if value is None:
        return None
    viewpoint = as_float(value, "viewpoint")
    if viewpoint.shape != (3,) or not np.isfinite(viewpoint).all():
        raise InputError(f"viewpoint must be three finite numbers; got {viewpoint.tolist()}")
    return viewpoint
