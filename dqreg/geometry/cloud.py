"""A checked cloud of points, with normals and the sensor's place where they are known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_float,
    as_vectors,
    bounds,
    require_workable,
    require_workable_ends,
)
from dqreg._records import made_of, one_line, remember, remembered
from dqreg.errors import InputError
from dqreg.files.cloud_data import finite_rows, why_unusable
from dqreg.geometry import exports
from dqreg.geometry.depth import depth_points
from dqreg.geometry.moved_points import LatePoints


@dataclasses.dataclass(frozen=True)
class PointCloud(LatePoints):
    """Points of one frame, float64; rows that are not finite are left out and counted.

    Parameters
    ----------
    points : array_like, (n, 3)
        Positions in the cloud's own frame, any length unit. Not copied where they are rows of float64: an array that
        is filled again, as by a driver, is given as a copy.
    normals : array_like, (n, 3), optional
        One direction per point; lengths other than one are normalised. A row that is zero or not finite costs
        its point, because a normal was promised there.
    viewpoint : array_like, (3,), optional
        Where the sensor stood, in the same frame; it orients estimated normals.
    units : str, optional
        Length unit, where the file says so ("mm", "m", ...).
    dropped : int
        Rows left out so far; those found here are added.
    times : array_like, (n,), optional
        When each point was measured, any unit and offset: the verdict then asks whether the pose drifts during the
        scan. Default: points are taken to come in the order of the scan.

    Attributes
    ----------
    points : ndarray, (n, 3)
        The finite points.
    normals : ndarray, (n, 3) or None
        Unit normals of the same rows.

    Raises
    ------
    InputError
        If shapes do not match, no usable point is left, or lengths are beyond what float64 can square.

    Examples
    --------
    >>> cloud = PointCloud([[0, 0, 0], [1, 0, 0], [float("nan"), 0, 0]])
    >>> len(cloud), cloud.dropped
    (2, 1)
    >>> len(cloud.to_open3d().points), cloud.to_trimesh().vertices.shape
    (2, (2, 3))
    """

    __repr__ = one_line
    points: FloatArray
    normals: FloatArray | None = None
    viewpoint: FloatArray | None = None
    units: str | None = None
    dropped: int = 0
    times: FloatArray | None = None

    def __post_init__(self) -> None:
        points = as_vectors(self.points, "points", finite=False)
        # What is not finite shows at the ends.
        ends = bounds(points) if len(points) else (np.zeros(3), np.zeros(3))
        keep = np.ones(len(points), dtype=bool) if np.isfinite(ends).all() else finite_rows(points)
        normals = None if self.normals is None else _unit_normals(self.normals, len(points))
        if normals is not None:
            keep &= finite_rows(normals)
        times = None if self.times is None else _times(self.times, len(points))
        lost = int(len(points) - np.count_nonzero(keep))
        if lost == len(points):
            raise InputError(f"a cloud needs at least one finite point; {why_unusable(points)}")
        if lost:
            points, normals = points[keep], None if normals is None else normals[keep]
            times = None if times is None else times[keep]
            ends = bounds(points)
        require_workable_ends(*ends, "points")
        remember(self, _known_ends=ends)
        place = _viewpoint(self.viewpoint)
        _freeze(self, points=points, normals=normals, dropped=self.dropped + lost, viewpoint=place, times=times)

    def __len__(self) -> int:
        return len(self._unmoved[0])

    @property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates, each (3,): known since the points were checked."""
        # A copy made of the fields alone does not know them.
        known = remembered(self, "_known_ends")
        return bounds(self.points) if known is None else known

    def _moved(self, offset: FloatArray, scale: float = 1.0) -> PointCloud:
        """The cloud scaled about zero, then shifted: no point has to be checked again, or moved before it is asked for.

        Until then the points that were given have to stay as they are.
        """
        # Rounding keeps their order, so the ends stay the ends.
        low, high = (scale * end + offset for end in self._ends)
        require_workable_ends(low, high, "points")
        viewpoint = None if self.viewpoint is None else scale * self.viewpoint + offset
        later = self.points, np.array([scale, *offset])
        return self._changed(viewpoint=_viewpoint(viewpoint), _known_ends=(low, high), _later=later)

    def _taken(self, rows: IntArray | BoolArray) -> PointCloud:
        """Some of its points, one at least, each with all that is known of it: no point has to be checked again."""
        points = self.points[rows]
        normals, times = (None if column is None else column[rows] for column in (self.normals, self.times))
        return self._changed(points=points, normals=normals, times=times, _known_ends=bounds(points))

    def _standing_for(self, points: FloatArray, normals: FloatArray | None) -> PointCloud:
        """Other points that stand for those of this cloud, such as means: seen from the same place, at no one time."""
        return dataclasses.replace(self, points=points, normals=normals, times=None)

    def _changed(self, **values: Any) -> PointCloud:
        """The same with other values, which need no check."""
        # As `copy.copy` has it, which asks for much that a cloud has not.
        known = {**vars(self), **values}
        # Points are there, or what they are made of.
        for given, other in (("points", "_later"), ("_later", "points")):
            if given in values:
                known.pop(other, None)
        return made_of(type(self), known)

    @classmethod
    def from_depth(
        cls,
        depth: Any,
        intrinsics: Any,
        *,
        depth_scale: float | None = None,
        depth_trunc: float | None = None,
        stride: int = 1,
        normals: bool = True,
        units: str | None = "m",
    ) -> PointCloud:
        """Cloud of a depth image, in the camera's frame (x right, y down, z forward), seen from its origin.

        Parameters
        ----------
        depth : array_like, (h, w)
            Depth along the optical axis; zero, negative, not finite, 65535 and the largest unsigned value mean none.
        intrinsics : (3, 3) array_like, (fx, fy, cx, cy), or Open3D's PinholeCameraIntrinsic
            Pinhole camera; whole pixel coordinates are the middles of pixels.
        depth_scale : float, optional
            Numbers of the image a unit of length. Default: 1000 for whole numbers (mm to m), 1 for others.
        depth_trunc : float, optional
            Largest depth used, in units of length.
        stride : int
            Every so many rows and columns.
        normals : bool
            Whether to fit normals from the grid; pixels without a plane around them are then dropped.
        units : str, optional
            Length unit of the cloud: what the image gives after division by the scale.

        Returns
        -------
        PointCloud
            With viewpoint at the camera; ``dropped`` counts the pixels left out.

        Raises
        ------
        InputError
            If the image, the camera or a number cannot be used, or no pixel holds a depth.
        UnitsError
            If no depth camera sees so far in metres, and neither ``depth_scale`` nor ``units`` says that it does.

        Examples
        --------
        >>> cloud = PointCloud.from_depth(np.full((8, 8), 2000, dtype=np.uint16), (500.0, 500.0, 3.5, 3.5))
        >>> len(cloud), cloud.units, cloud.normals[0, 2].round(9).tolist()
        (64, 'm', -1.0)
        """
        found = depth_points(
            depth, intrinsics, depth_scale=depth_scale, depth_trunc=depth_trunc, stride=stride, normals=normals,
            metres=units == "m",
        )  # fmt: skip
        return cls(found.points, found.normals, np.zeros(3), units, found.dropped)

    def to_open3d(self) -> Any:
        """The cloud as Open3D's (legacy) PointCloud, with the normals.

        Returns
        -------
        open3d.geometry.PointCloud
            A copy.
        """
        return exports.cloud_to_open3d(self.points, self.normals)

    def to_trimesh(self) -> Any:
        """The cloud as trimesh's PointCloud.

        Returns
        -------
        trimesh.PointCloud
            Without normals, which it has no place for.
        """
        return exports.to_trimesh(self.points, None, self.units)

    def to_pyvista(self) -> Any:
        """The cloud as PyVista's PolyData, with the normals as "Normals".

        Returns
        -------
        pyvista.PolyData
            A copy.

        Raises
        ------
        MissingDependencyError
            If PyVista is not installed.
        """
        return exports.to_pyvista(self.points, None, {} if self.normals is None else {"Normals": self.normals})

    def to_pointcloud2(self, frame_id: str = "", stamp: float = 0.0, precision: str | None = None) -> Any:
        """The cloud as a ROS message sensor_msgs/PointCloud2, with the fields x, y, z and normal_x, normal_y, normal_z.

        Parameters
        ----------
        frame_id : str
            Frame of the points, for the header.
        stamp : float
            Time, seconds, for the header.
        precision : {"float32", "float64"}, optional
            Default: float32, as drivers send it; float64 where that would move points by more than 1e-5 of the
            cloud's diagonal, as in maps with coordinates in the millions.

        Returns
        -------
        sensor_msgs.msg.PointCloud2
            Where ROS is not installed, a record with the same parts under the same names.

        Raises
        ------
        InputError
            If the precision is unknown.

        Examples
        --------
        >>> message = PointCloud([[0, 0, 1], [1, 0, 1]]).to_pointcloud2("map", 12.5)
        >>> message.header.stamp.nanosec, message.point_step, message.width
        (500000000, 12, 2)
        """
        columns = exports.cloud_columns(self.points, self.normals)
        return exports.to_pointcloud2(columns, frame_id, stamp, precision)


def _freeze(cloud: PointCloud, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(cloud, name, value)


def _unit_normals(value: Any, count: int) -> FloatArray:
    normals = as_vectors(value, "normals", finite=False)
    if len(normals) != count:
        raise InputError(f"normals must be one row per point; got {len(normals)} normals for {count} points")
    # By the largest number first: squares of very long and very short normals leave float64.
    largest = np.abs(normals).max(axis=1, keepdims=True, initial=0.0)
    usable = np.isfinite(largest) & (largest > 0.0)
    unit: FloatArray = np.divide(normals, largest, out=np.full_like(normals, np.nan), where=usable)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit


def _times(value: Any, count: int) -> FloatArray:
    times = as_float(value, "times")
    if times.shape != (count,):
        raise InputError(f"times must be one number per point; got shape {times.shape} for {count} points")
    return times


def _viewpoint(value: Any) -> FloatArray | None:
    if value is None:
        return None
    viewpoint = as_float(value, "viewpoint")
    if viewpoint.shape != (3,) or not np.isfinite(viewpoint).all():
        raise InputError(f"viewpoint must be three finite numbers; got {viewpoint.tolist()}")
    require_workable(viewpoint[None], "the coordinates of the viewpoint")
    return viewpoint
