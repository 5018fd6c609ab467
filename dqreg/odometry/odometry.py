"""Scan-to-map odometry, frame by frame."""

from __future__ import annotations

import dataclasses
import time as clock
from collections import deque
from typing import Any, Unpack

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.geometry.fields import stamp_of
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.assess import first_frame, frame_result, without_pose
from dqreg.odometry.deskew import Deskewed
from dqreg.odometry.frame import DownsampledFrame, RawFrame, downsample_frame, read_frame
from dqreg.odometry.kiss import KissParts, load_kiss, rigid
from dqreg.odometry.map_surface import MapSurface, surface_within
from dqreg.odometry.rivals import Placed, placed
from dqreg.odometry.settings import OdometryOptions, OdometrySettings, Resolved
from dqreg.odometry.starts import predict
from dqreg.registration.log import logged
from dqreg.registration.result import Registration
from dqreg.rigid import Trajectory, pose
from dqreg.trust.doubts import fraction_fits
from dqreg.trust.records import Reason

# Points below which a frame gets no pose, and cannot begin a map.
FEWEST_POINTS = 30
# Frames over which the usual fraction of inliers is taken.
MEMORY = 10
# Reasons after which the place of a frame is not known.
LOOSE = {
    "unconstrained",
    "alternative_poses",
    "low_inlier_fraction",
    "falling_inlier_fraction",
    "lost",
    "no_correspondences",
}


class Odometry:
    """LiDAR odometry with a verdict and a covariance for every frame.

    Parameters
    ----------
    settings : OdometrySettings, optional
        All settings in one value.
    start : (4, 4) array_like, optional
        Pose of the first frame, T_map_frame. Default: the identity, so the map's frame is the first frame's.
    **options
        Fields of `OdometrySettings` by name, over those of ``settings``.

    Raises
    ------
    InputError
        If a setting is out of range.
    MissingDependencyError
        If ``kiss-icp`` is not installed.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> walls = rng.uniform(-4, 4, (6000, 3))
    >>> walls[np.arange(6000), np.arange(6000) % 3] = np.sign(walls[np.arange(6000), np.arange(6000) % 3]) * 4
    >>> odometry = Odometry()
    >>> for step in range(3):
    ...     result = odometry.register_frame(walls - [0.1 * step, 0, 0])
    >>> result.verdict.level, (odometry.poses[-1][:3, 3].round(2) + 0.0).tolist()
    ('accepted', [0.2, 0.0, 0.0])
    """

    def __init__(
        self, settings: OdometrySettings | None = None, *, start: Any = None, **options: Unpack[OdometryOptions]
    ) -> None:
        self.settings = (settings or OdometrySettings()).replaced(options)
        # Imports of seconds belong here, not into the first frame.
        load_kiss("mapping")
        load_open3d()
        self._lengths: Resolved | None = None
        self._kiss: KissParts | None = None
        self._surface: MapSurface | None = None
        self._T_last = np.eye(4) if start is None else as_pose(start, "start")
        self._motion = np.eye(4)
        self._T_doubtful: FloatArray | None = None
        self._poses: list[FloatArray] = []
        self._stamps: list[float | None] = []
        self._usual: deque[float] = deque(maxlen=MEMORY)
        # Frames kept out of the map in a row, frames since the last trusted one, and seconds since then; seconds a
        # frame, where stamps told.
        self._kept_out, self._missed, self._gap, self._pace = 0, 0, 0.0, 0.0
        self._stamp: float | None = None
        # Frame that the map hangs on though it was not accepted, for good or until a frame fits that cannot have slid.
        self._unlinked: int | None = None
        self._for_good = False

    @property
    def poses(self) -> FloatArray:
        """Pose T_map_frame of every frame so far, (n, 4, 4); NaN where none was found (see `bridge_gaps`)."""
        return np.array(self._poses).reshape(-1, 4, 4)

    @property
    def trajectory(self) -> Trajectory:
        """The frames that were placed, at their stamps; at their numbers, from 0, where one has none or goes back."""
        found = np.flatnonzero(np.isfinite(self.poses).all(axis=(1, 2)))
        if not len(found):
            raise InputError(f"none of the {len(self._poses)} frames was placed; there is no trajectory")
        stamps = np.array([np.nan if stamp is None else stamp for stamp in self._stamps])[found]
        timed = bool(np.isfinite(stamps).all() and np.all(np.diff(stamps) > 0.0))
        return Trajectory(stamps if timed else found.astype(np.float64), self.poses[found])

    @property
    def last_pose(self) -> FloatArray:
        """Pose of the last frame that was placed, (4, 4)."""
        return self._T_last.copy()

    @property
    def local_map(self) -> FloatArray:
        """Points of the map, (n, 3)."""
        return np.zeros((0, 3)) if self._kiss is None else self._kiss.points()

    def register_frame(self, points: Any, timestamps: Any = None, *, stamp: float | None = None) -> Registration:
        """Place one frame in the map.

        Parameters
        ----------
        points : (n, 3) array_like or object
            Points in the sensor's frame, as `register` takes them, for example a PointCloud2 message; rows that are not
            finite are left out.
        timestamps : (n,) array_like, optional
            Time of each point in the sweep, any unit and offset: the motion during the sweep is undone with it.
            Default: the field ``t``, ``time`` or ``timestamp`` of the points.
        stamp : float, optional
            Time of the frame, seconds: scales the predicted motion where frames are missing. Default: that of a
            message's header.

        Returns
        -------
        Registration
            ``T_target_source`` is T_map_frame; the covariance is about the sensor (``settings["centre"]``). A frame
            that cannot be placed has NaN and "failed"; the next one goes on.

        Raises
        ------
        InputError
            If the shapes are wrong.
        """
        began = clock.perf_counter()
        raw = read_frame(points, timestamps)
        stamp = stamp_of(points) if stamp is None else stamp
        ratio, doubt = self._time_ratio(stamp)
        result = self._place(raw, ratio)
        if doubt is not None:
            result = dataclasses.replace(result, verdict=result.verdict.doubted(doubt))
        self._poses.append(result.T_target_source)
        self._stamps.append(stamp)
        result = dataclasses.replace(result, timings={"total": clock.perf_counter() - began})
        return logged(result, f"frame {len(self._poses)}")

    def _time_ratio(self, stamp: float | None) -> tuple[float, Reason | None]:
        """Time since the last trusted frame over that of the last motion, and what is wrong with the stamp."""
        steps = 1.0 + self._missed
        if stamp is None:
            return steps, None
        before, self._stamp = self._stamp, float(stamp)
        if not np.isfinite(stamp):
            self._stamp = before
            return steps, Reason("the frame's time is not finite", "time_stamp")
        if before is None:
            return steps, None
        if stamp <= before:
            self._stamp = before
            words = f"the frame's time {stamp:.6f} is not after that of the frame before, {before:.6f}"
            return steps, Reason(words, "time_stamp")
        self._gap += stamp - before
        # Beyond a few steps constant velocity is a guess like any other.
        return (float(np.clip(self._gap / self._pace, 0.0, 5.0)) if self._pace else steps), None

    def _place(self, raw: RawFrame, ratio: float) -> Registration:
        if not len(raw.points):
            return self._failed("the frame holds no finite point", raw, "no points")
        lengths = self._lengths or self.settings.resolve(raw.points)
        kiss = self._kiss or KissParts(lengths)
        inside = kiss.compensate(raw.points, raw.times, self._motion)
        frame = downsample_frame(inside, lengths.voxel_size)
        if frame is None or len(frame.scan) < FEWEST_POINTS:
            why = (
                f"downsampling leaves {0 if frame is None else len(frame.scan)} of {len(raw.points)} points (within "
                f"{lengths.max_range:.4g}, voxels of {lengths.voxel_size:.4g}); {FEWEST_POINTS} are needed"
            )
            return self._failed(why, raw, "too few points")
        if self._kiss is None:
            self._lengths, self._kiss = lengths, kiss
            self._merge(kiss, frame)
            return first_frame(self._T_last, raw.notes, self._words(frame))
        return self._register(kiss, lengths, frame, raw, ratio)

    def _failed(self, why: str, raw: RawFrame, status: str) -> Registration:
        self._missed += 1
        return without_pose((Reason(why, "too_few_points"), *raw.notes), status, {})

    def _register(
        self, kiss: KissParts, lengths: Resolved, frame: DownsampledFrame, raw: RawFrame, ratio: float
    ) -> Registration:
        T_predicted = rigid(predict(self._T_last, self._motion, ratio))
        # Points beyond the frame's farthest, wherever it may have turned to, cannot be met.
        surface = self._surface or surface_within(kiss.points(), self._T_last[:3, 3], frame.reach + lengths.reach)
        self._surface = surface
        search = FrameSearch(surface, lengths, self.settings, self._usual_fraction, self._anchors(T_predicted))
        aligned, notes = search.find(frame.scan, trust_motion=kiss.deviation <= lengths.voxel_size), raw.notes
        if raw.times is not None and self.settings.deskew:
            deskewed = Deskewed(kiss, raw, lengths.voxel_size, frame, aligned, self._motion)
            deskewed = deskewed.repeated(search, self._T_last, ratio)
            frame, aligned, notes = deskewed.frame, deskewed.aligned, notes + deskewed.notes
        # After a frame that was not trusted constant velocity is worth nothing.
        place = placed(search, frame.scan, aligned, T_predicted, np.inf if self._missed else kiss.deviation)
        result = frame_result(place, surface, frame, self._usual_fraction, notes, self._words(frame))
        linked = self._linked(result, place)
        self._learn(kiss, frame, linked, T_predicted, ratio, trusted=place.is_escaped)
        return linked

    def _linked(self, result: Registration, place: Placed) -> Registration:
        """The result, doubted where it hangs on a frame that was not accepted."""
        if (
            self._unlinked is not None
            and not self._for_good
            and result.verdict.level == "accepted"
            and not place.is_weak
        ):
            self._unlinked = None
        before = self._unlinked
        if before is None and LOOSE.intersection(result.verdict.codes):
            merged = place.is_escaped or self._kept_out >= self.settings.patience
            merged |= result.verdict.level != "failed" and fraction_fits(result.inlier_fraction, self._usual_fraction)
            self._for_good = merged
            self._unlinked = len(self._poses) if merged or place.is_weak else None
        if before is None:
            return result
        words = (
            f"frame {before} was not accepted, and this pose hangs on it: it may be right against the frames since and "
            "wrong against those before"
        )
        return dataclasses.replace(result, verdict=result.verdict.doubted(Reason(words, "untrusted_map")))

    def _anchors(self, T_predicted: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Where the sensor may be: at the last trusted pose going on, or at the last doubtful one."""
        anchors = [(self._T_last, T_predicted)]
        return anchors if self._T_doubtful is None else [*anchors, (self._T_doubtful, self._T_doubtful)]

    def _learn(
        self,
        kiss: KissParts,
        frame: DownsampledFrame,
        result: Registration,
        T_predicted: FloatArray,
        ratio: float,
        *,
        trusted: bool,
    ) -> None:
        if result.verdict.level == "failed":
            self._missed += 1
            return
        T = result.T_target_source
        fits = trusted or fraction_fits(result.inlier_fraction, self._usual_fraction)
        if not fits and self._kept_out < self.settings.patience:
            # Reported, not absorbed: neither the map nor the motion learns from it.
            self._kept_out += 1
            self._missed += 1
            self._T_doubtful = T
            return
        kiss.learn(pose.inverse(T_predicted) @ T)
        steps = max(1.0 + self._missed, 1.0)
        # Of a gap only the mean motion is known.
        self._motion = rigid(predict(np.eye(4), pose.inverse(self._T_last) @ T, 1.0 / steps))
        self._pace, self._gap, self._missed = self._gap / steps, 0.0, 0
        self._T_last = T
        self._usual.append(result.inlier_fraction)
        self._merge(kiss, frame)

    @property
    def _usual_fraction(self) -> float:
        return float(np.median(self._usual)) if self._usual else np.nan

    def _merge(self, kiss: KissParts, frame: DownsampledFrame) -> None:
        kiss.insert(frame.dense, self._T_last)
        self._surface, self._kept_out, self._T_doubtful = None, 0, None

    def _words(self, frame: DownsampledFrame) -> dict[str, Any]:
        return {
            **({} if self._lengths is None else dataclasses.asdict(self._lengths)),
            "method": self.settings.method,
            "centre": self._T_last[:3, 3].tolist(),
            "used_points": len(frame.scan),
            "source_points": len(frame.dense),
            "source_scale": 1.0,
        }
