"""One frame of a sequence: checked, cleaned of what is no measurement, downsampled, with normals."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, bounds, median
from dqreg._records import remember
from dqreg.errors import InputError
from dqreg.files import read_cloud
from dqreg.files.cloud_data import TimedCloudData
from dqreg.geometry import Mesh, Scan
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import PlaneFits, fit_planes, sample_rows
from dqreg.geometry.objects import recognise
from dqreg.geometry.spacing import spacing_of
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.kernels.threads import Later, unlocked_property
from dqreg.odometry.settings import Resolved
from dqreg.odometry.sweep import swept
from dqreg.trust.records import Reason

# Voxels a point, over the map's: of what enters the map, without and with times,
MAP_SAMPLING_VOXELS, TIMED_MAP_SAMPLING_VOXELS = 0.5, 0.7
# and of what the pose is found from.
POSE_SAMPLING_VOXELS = 1.5
# Points that the pose is found from at most, without and with times: beyond, they add time and hardly any accuracy.
MAX_POSE_POINTS, MAX_TIMED_POSE_POINTS = 3_000, 2_400
# Share of a sweep within which points of a voxel are seen together: what is seen at its beginning and again at its end
# lies elsewhere.
SAME_TIME_SHARE_OF_SWEEP = 0.1
# Rows are taken in steps of so many, a large prime.
STRIDE_ROWS = 15_485_863
# Points of a fit: rings of a LiDAR leave few neighbours across them.
PLANE_NEIGHBOURS = 12
# Coordinates beyond which a return is no measurement.
MAX_COORDINATE = 1e150

# Points, (n, 3), and the time of each, (n,).
Timed = tuple[FloatArray, FloatArray]


@dataclasses.dataclass(frozen=True)
class RawFrame:
    """What came in, cleaned."""

    points: FloatArray  # (n, 3): Finite points in the sensor's frame; n may be 0
    times: FloatArray | None  # (n,): Time of each point, where they can be used to undo the motion
    notes: tuple[Reason, ...]  # What was left out and why
    # What it was downsampled to ahead of its turn, with which lengths
    ahead: tuple[Resolved, DownsampledFrame | None] | None = None

    @cached_property
    def corner(self) -> FloatArray:
        """Largest size of each coordinate, (3,), of at least one point."""
        return np.maximum(*map(np.abs, bounds(self.points)))

    @cached_property
    def span(self) -> tuple[float, float]:
        """First and last of the times, of at least one."""
        assert self.times is not None
        return float(self.times.min()), float(self.times.max())

    def downsampled(self, lengths: Resolved) -> DownsampledFrame | None:
        """The frame downsampled, if it was not ahead of its turn."""
        if self.ahead is not None and self.ahead[0] is lengths:
            return self.ahead[1]
        return downsample_frame(self, lengths)


def read_frame(points: Any, timestamps: Any) -> RawFrame:
    """Check a frame and leave out what is no measurement.

    >>> read_frame([[1, 2, 3], [0, 0, 0], [float("nan"), 1, 1]], None).notes
    ('2 of 3 returns are NaN, infinite or at the origin, and were left out',)
    """
    from dqreg.kernels.cells.voxel_rows import measured_rows
    from dqreg.kernels.threads import as_plain

    values, own_times = _values_of(points)
    timestamps = own_times if timestamps is None else timestamps
    # Half of the largest number squared would overflow in every length taken of it.
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    notes = []
    if lost := len(values) - measured_rows(as_plain(values), MAX_COORDINATE, low, high):
        # NaN is not below.
        x, y, z = np.abs(values).T < MAX_COORDINATE
        keep = nonzero_rows(values) & x & y & z
        words = f"{lost} of {len(values)} returns are NaN, infinite or at the origin, and were left out"
        notes.append(Reason(words, "dropped_points"))
    times = None if timestamps is None or np.size(timestamps) == 0 else as_float(timestamps, "timestamps").ravel()
    if times is not None:
        if len(times) != len(values):
            raise InputError(f"timestamps must be one a point; got {len(times)} for {len(values)} points")
        times = times[keep] if lost else times
        # What is not finite shows at the ends.
        ends = (float(times.min()), float(times.max())) if len(times) else (0.0, 1.0)
        if not (math.isfinite(ends[0]) and math.isfinite(ends[1])):
            notes.append(Reason("some times are not finite: the sweep was not deskewed", "not_deskewed"))
            times = None
        elif why := _why_no_sweep(*ends):
            notes.append(Reason(f"{why}: the sweep was not deskewed", "not_deskewed"))
            times = None
    found = RawFrame(values[keep] if lost else values, times, tuple(notes))
    remember(found, corner=np.maximum(np.abs(low), np.abs(high)))
    return found if times is None else remember(found, span=ends)


def _why_no_sweep(first: float, last: float) -> str:
    """Why times between these tell nothing; empty where they do."""
    step, single = float(np.spacing(np.float32(abs(last)))), (float(np.float32(first)), float(np.float32(last)))
    # Seconds since 1970, and the like: a whole unit is lost.
    if single == (first, last) and step > 1.0 and last - first <= step:
        return (
            f"the times of the points, about {last:.10g}, are those of single precision (float32), which differ by "
            f"{step:.3g} at least there; give float64, or the time since the sweep began"
        )
    return "" if last > first else "all points have one time"


def _values_of(points: Any) -> tuple[FloatArray, FloatArray | None]:
    """Points of a frame, finite or not, and their times where it has some."""
    if isinstance(points, (str, os.PathLike)):
        cloud = read_cloud(points)
        return cloud.points, cloud.times if isinstance(cloud, TimedCloudData) else None
    if isinstance(points, (list, tuple)):
        points = as_float(points, "points", "fiuO")
    if isinstance(points, np.ndarray) and not points.size:
        return np.zeros((0, 3)), None
    found = recognise(points, "points")
    if isinstance(found, Mesh):
        raise InputError(f"a frame is a cloud of points; got a mesh of {len(found.faces)} faces")
    return found.points, found.times


class Whole:
    """All of a frame that enters the map, each point where the sensor saw it, made when it is begun or asked for."""

    def __init__(self, make: Callable[[], Timed]) -> None:
        self._make = make
        self._made: Later[Timed] | None = None

    def begin(self) -> None:
        """Make it beside what the caller does."""
        if self._made is None:
            self._made = Later(self._make)

    def result(self) -> Timed:
        """Points, (n, 3), along a Morton curve, and the time of each, (n,)."""
        if self._made is None:
            self._made = Later(self._make, beside=False)
        return self._made.result()


class OwnPlanes:
    """Planes fitted to a frame alone, for who asks."""

    def __init__(self, whole: Whole, at: FloatArray) -> None:
        self._whole, self._at = whole, at

    @unlocked_property
    def fits(self) -> PlaneFits:
        """At some of the points, among all of them."""
        points, _ = self._whole.result()
        return fit_planes(NeighbourTree(points, in_order=True), points, self._at, PLANE_NEIGHBOURS)


@dataclasses.dataclass(frozen=True, eq=False)
class DownsampledFrame:
    """A frame downsampled twice."""

    whole: Whole
    seen: FloatArray  # (m, 3): What that is found from, each point where the sensor saw it
    back: FloatArray | None  # (m,): Time of each, from -1 at the beginning of the sweep to 0 at its end, if it is known
    reach: float  # Distance of the farthest of these from the sensor
    spacing: float  # Edge of the voxels of which one point each enters the map
    own: OwnPlanes  # Planes of these, as they were seen
    motion: FloatArray = dataclasses.field(default_factory=lambda: np.eye(4))  # (4, 4): Undone motion during the sweep
    end: float = np.nan  # Time of the last point in the unit of the times: the pose is that of then

    @property
    def times(self) -> dict[str, float]:
        """The time that its pose is of, for the settings of results, if it is known."""
        return {} if self.back is None else {"pose_time": self.end}

    @cached_property
    def dense(self) -> FloatArray:
        """What enters the map, (n, 3)."""
        points, back = self.whole.result()
        return points if self.back is None else swept(points, back, self.motion)

    @cached_property
    def scan(self) -> Scan:
        """What the pose is found from, without normals: the map has some."""
        count = len(self.seen)
        return Scan(
            points=self.seen if self.back is None else swept(self.seen, self.back, self.motion),
            normals=np.zeros((count, 3)),
            levers=np.zeros(count),
            residuals=np.full(count, np.nan),
            fitted=np.arange(count),
            oriented=False,
            spacing=self.spacing,
            noise=0.0,
            total=count,
        )

    @cached_property
    def fitted(self) -> Scan:
        """The same with normals that are fitted among all points."""
        fits, back = self.own.fits, self.back
        known, normals = fits.known, np.where(fits.known[:, None], fits.normals, 0.0)
        return dataclasses.replace(
            self.scan,
            normals=normals if back is None else swept(normals, back, self.motion, directions=True),
            levers=np.where(known, fits.lever, 0.0),
            residuals=fits.residuals,
            spacing=spacing_of(fits, self.seen),
            noise=median(fits.residuals[known]) if known.any() else 0.0,
        )

    def without(self, motion: FloatArray) -> DownsampledFrame:
        """The frame with another motion undone, (4, 4); as it is where its points have no times."""
        return self if self.back is None else dataclasses.replace(self, motion=motion)


def downsample_frame(raw: RawFrame, lengths: Resolved) -> DownsampledFrame | None:
    """Downsample a frame."""
    from dqreg.kernels.cells.voxel_rows import VoxelSums, first_of_voxels, one_of_voxels

    points, times = _in_range(raw, lengths)
    if not len(points):
        return None
    size, apart = (
        (MAP_SAMPLING_VOXELS if times is None else TIMED_MAP_SAMPLING_VOXELS) * lengths.voxel_size,
        POSE_SAMPLING_VOXELS * lengths.voxel_size,
    )
    if times is None:
        dense = _in_order(*VoxelSums.of(points, None, size, SAME_TIME_SHARE_OF_SWEEP).means())
        # In an order that is none: the first along the curve would be the same corner of each voxel.
        mixed = np.arange(len(dense[0])) * STRIDE_ROWS % len(dense[0])
        chosen = np.sort(mixed[first_of_voxels(np.take(dense[0], mixed, axis=0), apart)])
        seen, back = np.take(dense[0], chosen[sample_rows(len(chosen), MAX_POSE_POINTS)], axis=0), None
        whole = Whole(lambda: dense)
    else:
        first, last = raw.span if times is raw.times else (times.min(), times.max())
        when = times - last
        when /= last - first
        began = Later(lambda: VoxelSums.of(points, when, size, SAME_TIME_SHARE_OF_SWEEP))
        some = np.take(points, one_of_voxels(points, apart), axis=0)
        rows = morton_order(some)[sample_rows(len(some), MAX_TIMED_POSE_POINTS)]
        sums = began.result()
        seen, back = sums.means_at(np.take(some, rows, axis=0))
        whole = Whole(lambda: _in_order(*sums.means()))
    if len(seen) < 3:
        return None
    reach = float(np.linalg.norm(seen, axis=1).max())
    end = np.nan if times is None else float(last)
    return DownsampledFrame(whole, seen, back, reach, size, OwnPlanes(whole, seen), end=end)


def _in_order(points: FloatArray, back: FloatArray) -> Timed:
    """Points along a Morton curve, with their times."""
    order = morton_order(points)
    return np.take(points, order, axis=0), back[order]


def _in_range(raw: RawFrame, lengths: Resolved) -> tuple[FloatArray, FloatArray | None]:
    """Points in range, and their times where the motion is to be undone."""
    points, times = raw.points, raw.times if lengths.deskew else None
    if not len(points):
        return points, times
    # None is at the sensor.
    if raw.corner @ raw.corner < lengths.max_range**2 and lengths.min_range == 0.0:
        return points, times
    squares = np.einsum("ij,ij->i", points, points)
    near = (squares < lengths.max_range**2) & (squares > lengths.min_range**2)
    if near.all():
        return points, times
    times = None if times is None else times[near]
    return points[near], None if times is None or not np.ptp(times) > 0.0 else times
