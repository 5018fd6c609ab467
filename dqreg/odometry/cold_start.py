"""A drive that begins at speed, of which the map of the first frame soon shows nothing.

Sixteen rings at 20 m/s have few points in common after 0.1 s: the second frame is right and suspect, so it stays out of
the map, and the third is lost in what the first one saw. So where a frame is lost before any motion is known, the last
suspect frame is made part of the map, if the lost one is found then. All after it hang on that frame, and say so.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.odometry.assess import MapLink
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.next_frame import NextFrame
from dqreg.odometry.starts import predict
from dqreg.odometry.tracker import Tracker
from dqreg.odometry.tracker_state import Standing
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.rigid.single_pose import orthonormal


@dataclasses.dataclass(frozen=True, eq=False)
class SuspectFrame:
    """A frame with a pose that was kept out of the map."""

    frame: DownsampledFrame
    T_map_frame: FloatArray  # (4, 4)
    motion: FloatArray  # (4, 4): Of one step, up to it
    number: int


class ColdStartTracker(Tracker):
    """A tracker that goes on from a suspect frame while no motion is known."""

    def _begin(self, start: Any) -> None:
        super()._begin(start)
        self._suspect: SuspectFrame | None = None

    def _register(self, given: NextFrame) -> Registration:
        suspect = self._suspect
        found = super()._register(given)
        if suspect is None or "lost" not in found.verdict.codes or not given.insert:
            return found
        before, timeline = self._at, self._timeline
        last, self._suspect, tried = timeline.last_trusted(), None, VoxelMap(given.lengths, given.world.points)
        tried.insert(lambda: suspect.frame.dense, suspect.T_map_frame)
        self._at = Standing(suspect.T_map_frame, suspect.motion, tried, MapLink.hanging_on(suspect.number))
        timeline.resume(timeline.count - suspect.number - 1)
        again = super()._register(dataclasses.replace(given, world=tried, ratio=timeline.steps))
        if again.verdict.level != "failed":
            return again
        self._at, self._suspect = before, suspect
        timeline.put_back(last)
        return found

    def _learn(self, given: NextFrame, result: Registration, T_predicted: FloatArray, *, enters: bool) -> None:
        steps, T_last = self._timeline.steps, self._at.T_last
        super()._learn(given, result, T_predicted, enters=enters)
        if enters:
            self._suspect = None
        elif result.verdict.level == "suspect" and not self._usual:
            T = result.T_target_source
            motion = orthonormal(predict(np.eye(4), pose.inverse(T_last) @ T, 1.0 / steps))
            self._suspect = SuspectFrame(given.frame, T, motion, self._timeline.count)
