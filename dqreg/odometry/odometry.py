"""Scan-to-map odometry, frame by frame."""

from __future__ import annotations

import dataclasses
import time as clock
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry.fields import stamp_of
from dqreg.odometry.clock import stamp_given
from dqreg.odometry.frame import RawFrame, downsample_frame, read_frame
from dqreg.odometry.kiss import KissParts, load_kiss
from dqreg.odometry.map_file import SavedMap, load_map, save_map
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.settings import OdometryOptions, OdometrySettings, with_options
from dqreg.odometry.sought_frames import SeekingTracker, sought_in_map
from dqreg.odometry.tracker import MIN_POINTS
from dqreg.odometry.tracker_state import Standing
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.registration.options.option_checks import require_flag
from dqreg.registration.result.log import logged
from dqreg.registration.result.result import Registration
from dqreg.rigid import Trajectory


class Odometry(SeekingTracker):
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
        If a setting is out of range, or the pose not rigid.
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

    Later, in the same map, which stays as it is:

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     odometry.save(f"{folder}/room.npz")
    ...     again = Odometry.load(f"{folder}/room.npz")
    >>> again.register_frame(walls - [0.25, 0, 0], insert=False).T_target_source[0, 3].round(2).item()
    0.25
    >>> again.relocalise(walls - [0.3, 0, 0], again.poses[-1]).T_target_source[0, 3].round(2).item()
    0.3
    >>> again.reset()
    >>> len(again.poses), len(again.local_map)
    (0, 0)
    """

    def __init__(
        self, settings: OdometrySettings | None = None, *, start: Any = None, **options: Unpack[OdometryOptions]
    ) -> None:
        # Imports of seconds belong here, not into the first frame.
        load_kiss("preprocess")
        super().__init__(with_options(settings or OdometrySettings(), options), start)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle holds: there is none once a map is begun, parts of which are KISS-ICP's own."""
        if self._at.world is not None:
            raise InputError(
                "an Odometry with a map can be neither pickled nor copied: Odometry.save writes its map, last pose and "
                "settings to a file, and Odometry.load goes on from there, elsewhere too; its trajectory is in poses"
            )
        return self.__dict__

    def reset(self, start: Any = None) -> None:
        """Forget map, poses and motion; the next frame begins a new map.

        Parameters
        ----------
        start : (4, 4) array_like, optional
            Pose of the next frame, T_map_frame. Default: the identity.

        Raises
        ------
        InputError
            If the pose is not (4, 4) or (3, 4), or not rigid.
        """
        self._begin(start)

    @property
    def poses(self) -> FloatArray:
        """Pose T_map_frame of every frame so far, (n, 4, 4); NaN where none was found (see `bridge_gaps`)."""
        return self._timeline.poses

    @property
    def trajectory(self) -> Trajectory:
        """The frames that were placed, at their stamps; at their numbers, from 0, where one has none or goes back."""
        return self._timeline.trajectory

    @property
    def last_pose(self) -> FloatArray:
        """Pose of the last frame that was trusted, (4, 4); one that was kept out of the map does not change it."""
        return self._at.T_last.copy()

    @property
    def local_map(self) -> FloatArray:
        """Points of the map, (n, 3)."""
        return np.zeros((0, 3)) if self._at.world is None else self._at.world.points.copy()

    def register_frame(
        self,
        points: Any,
        timestamps: Any = None,
        *,
        stamp: float | None = None,
        prediction: Any = None,
        prediction_covariance: Any = None,
        insert: bool = True,
    ) -> Registration:
        """Place one frame in the map.

        Parameters
        ----------
        points : (n, 3) array_like or object
            Points in the sensor's frame, as `register` takes them, for example a PointCloud2 message; rows that are not
            finite are left out.
        timestamps : (n,) array_like, optional
            Time of each point in the sweep, any unit and offset: the motion during the sweep is undone with it. The
            pose is that of the last point that was seen, at ``settings["pose_time"]``: of a frame that lost its second
            half, of its middle. Times that run backwards go unseen. Default: the field ``t``, ``time`` or
            ``timestamp`` of the points.
        stamp : float, optional
            Time of the frame, seconds: scales the predicted motion where frames are missing, and lets the motion
            decide where a frame is like itself elsewhere (columns at equal distances). A wrong one makes that frame
            suspect and no other; of a clock that was set anew the second is taken. Default: that of a message's header.
        prediction : (4, 4) array_like, optional
            Where other sensors (wheels, an IMU) expect the frame, T_map_frame: ``last_pose`` times their motion since
            the frame that has it: not since one that was kept out. Default: constant velocity.
        prediction_covariance : (6, 6) array_like, optional
            Of a left increment about the sensor in the map's axes, rotation first, as the result's own. With it, the
            prediction is weighed with the frame: it decides what the frame leaves free, in a corridor for example.
        insert : bool
            Whether the frame may enter the map; False follows the sensor in a map that stays as it is.

        Returns
        -------
        Registration
            ``T_target_source`` is T_map_frame; the covariance is about the sensor (``settings["centre"]``): how well
            the frame is known to lie in the map around it, and so a step between neighbouring frames (see `nees`). How
            far that part of the map lies off the first frame, which grows on the way, is not in it. A frame that cannot
            be placed has NaN and "failed"; the next one goes on. One that is lost, or fits badly, where it is expected
            is sought in all of the map, which takes as long as many frames, and seldom where that is in vain.

        Raises
        ------
        InputError
            If the shapes are wrong, the stamp is no number, or ``insert`` neither True nor False.
        """
        began = clock.perf_counter()
        require_flag("insert", insert)
        raw = self._ahead(read_frame(points, timestamps))
        expected = Prediction.of(prediction, prediction_covariance)
        return self._registered(
            raw, stamp_of(points) if stamp is None else stamp_given(stamp), expected, began, insert=insert
        )

    def _registered(
        self, raw: RawFrame, stamp: float | None, expected: Prediction | None, began: float, *, insert: bool = True
    ) -> Registration:
        ratio, remark = self._timeline.ratio(stamp)
        result = self._place(raw, ratio, expected, insert=insert)
        if remark is not None:
            verdict = result.verdict
            said = verdict._remarked(remark) if remark.code == "new_clock" else verdict.doubted(remark)
            result = dataclasses.replace(result, verdict=said)
        self._timeline.add(result.T_target_source, stamp)
        # Its own, and nobody has seen it yet: a copy would be checked anew.
        result.timings["total"] = clock.perf_counter() - began
        return logged(result, f"frame {self._timeline.count}")

    def relocalise(self, points: Any, start: Any = None) -> Registration:
        """Find the sensor in the map, wherever it is: after it was carried, or in a map that was loaded.

        Parameters
        ----------
        points : (n, 3) array_like or object
            Points of one frame in the sensor's frame.
        start : (4, 4) array_like, optional
            Where to look first, T_map_frame. Default: everywhere, by a global search.

        Returns
        -------
        Registration
            That of `register` to the map. Where it is accepted, the next frame is expected there. Without a start it
            is suspect where another turn fits as well: walls of a hall whose furniture was replaced.

        Raises
        ------
        InputError
            If there is no map, or too few points are left.
        """
        raw = read_frame(points, None)
        if self._kiss is None or self._at.world is None or self._lengths is None:
            raise InputError("there is no map to be found in: register a frame first, or load a map")
        frame = downsample_frame(raw, self._lengths)
        if frame is None or len(frame.scan) < MIN_POINTS:
            raise InputError(f"downsampling leaves too few of {len(raw.points)} points; {MIN_POINTS} are needed")
        found = sought_in_map(self._at.world, frame, self._lengths, self.settings, start)
        if found.verdict.level == "accepted":
            self._go_on_from(found, self._at.world)
        return found

    def save(self, path: str | Path) -> None:
        """Write the map with its settings, to be read by `load`: arrays and a JSON header in an NPZ archive, no pickle.

        Parameters
        ----------
        path : str or Path
            File to write, as it is named.

        Raises
        ------
        InputError
            If there is no map yet, or the file cannot be written.
        """
        if self._at.world is None or self._lengths is None:
            raise InputError("there is no map to save; register a frame first")
        save_map(path, SavedMap(self._at.world.points, self._at.T_last, self.settings, self._lengths))

    @staticmethod
    def load(path: str | Path) -> Odometry:
        """Odometry that goes on in a saved map, with its settings and last pose.

        Parameters
        ----------
        path : str or Path
            NPZ archive that `save` of the same version wrote.

        Returns
        -------
        Odometry
            It expects the sensor where it was last; `relocalise` finds it elsewhere.

        Raises
        ------
        InputError
            If the file is missing, holds something else, or a map without points or with some that are not finite.
        """
        saved = load_map(path)
        made = Odometry(saved.settings, start=saved.T_map_frame)
        made._lengths, made._kiss = saved.lengths, KissParts(saved.lengths)
        made._at = Standing(saved.T_map_frame, world=VoxelMap(saved.lengths, saved.points))
        return made
