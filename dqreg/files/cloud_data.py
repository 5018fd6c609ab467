"""The points of one file as plain arrays, cleaned of rows that hold no measurement."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.files.untrusted import unreadable


@dataclasses.dataclass(frozen=True)
class CloudData:
    """What a file says about a cloud of points.

    Attributes
    ----------
    points : ndarray, (n, 3)
        Finite positions in the file's frame and unit, n >= 1, with every digit that the file holds.
    normals : ndarray, (n, 3) or None
        One direction per point, finite and not zero, its length as in the file.
    viewpoint : ndarray, (3,) or None
        Where the sensor stood, in the same frame, if the file says so.
    units : str or None
        Length unit ("m", "mm", ...), if the format states one.
    dropped : int
        Rows left out: a position with NaN or infinity, or a promised normal that is missing.
    """

    points: FloatArray
    normals: FloatArray | None = None
    viewpoint: FloatArray | None = None
    units: str | None = None
    dropped: int = 0


@dataclasses.dataclass(frozen=True)
class TimedCloudData(CloudData):
    """A cloud of a file with a column for the time of each point."""

    times: FloatArray | None = None  # (n,): As in the file


@dataclasses.dataclass(frozen=True)
class SweepData(CloudData):
    """A cloud of a format whose files are sweeps in metres about their sensor; of other points it may say neither."""


def make_cloud(
    path: Path,
    points: FloatArray,
    normals: FloatArray | None = None,
    viewpoint: FloatArray | None = None,
    times: FloatArray | None = None,
    units: str | None = None,
) -> CloudData:
    """Cloud of a file, without the rows that are not usable.

    A row goes if its position is not finite. Where the file gives normals, a row without a usable one (NaN or zero, as
    cameras write it at edges) goes too; if no row has one, the points stay without.
    """
    if not len(points):
        raise unreadable(path, "no points", "at least one")
    keep = finite_rows(points)
    if not keep.any():
        raise unreadable(path, f"{len(points)} points, all NaN or infinite", "at least one finite point")
    if normals is not None:
        directed = keep & _is_direction(normals)
        normals, keep = (normals, directed) if directed.any() else (None, keep)
    if not keep.all():
        points, normals = points[keep], None if normals is None else normals[keep]
        times = None if times is None else times[keep]
    cloud = CloudData(
        points=np.ascontiguousarray(points, dtype=np.float64),
        normals=None if normals is None else np.ascontiguousarray(normals, dtype=np.float64),
        viewpoint=viewpoint,
        units=units,
        dropped=int(len(keep) - np.count_nonzero(keep)),
    )
    return cloud if times is None else TimedCloudData(**vars(cloud), times=times)


def finite_rows(rows: FloatArray) -> BoolArray:
    """Which rows hold finite numbers alone. Shapes: (n, k); returns (n,)."""
    # One sum is thirty times as fast as a look at each number, and finite unless something is wrong or huge.
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(rows.sum()):
            return np.ones(len(rows), dtype=bool)
    return np.asarray(np.isfinite(rows).all(axis=1))


def why_unusable(points: FloatArray) -> str:
    """Why none of some points can be used, and what to do, in words."""
    if not len(points):
        return "it is empty"
    finite = int(np.count_nonzero(finite_rows(points)))
    if not finite:
        return f"all {len(points)} rows hold NaN or infinity"
    return (
        f"the normals of all {finite} finite points are zero or not finite: leave the normals out, and they are "
        "estimated from the points"
    )


def _is_direction(normals: FloatArray) -> BoolArray:
    usable: BoolArray = finite_rows(normals) & np.asarray((normals != 0.0).any(axis=1))
    return usable
