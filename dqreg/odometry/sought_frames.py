"""Frames that are not found near where they are expected, and sought in all of the map.

After frames that are missing, a sensor that was carried or knocked, or a first step that nobody knows, points lie too
far from their own faces, and rings of the ground lie on themselves best where the sensor was before. A global search
does not begin there. It takes as long as many frames: where it tells nothing new, the next one waits for longer.
"""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.assess import MapLink
from dqreg.odometry.cold_start import ColdStartTracker, SuspectFrame
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.kiss import rigid
from dqreg.odometry.next_frame import NextFrame
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import predict
from dqreg.odometry.tracker_state import Standing
from dqreg.odometry.unseen_rotations import equal_turns
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.registration.register import register
from dqreg.registration.result import Registration
from dqreg.rigid import pose
from dqreg.trust.code_sets import PLACE_IN_DOUBT
from dqreg.trust.records import Reason

# Frames that wait after a search that told nothing new: so many times those after the one before and one, and at most.
LONGER_PAUSES, LONGEST_PAUSE = 2, 64


@dataclasses.dataclass(frozen=True, eq=False)
class _Before:
    """What a frame that stays out of the map changes of a drive."""

    at: Standing
    missed: int
    slid: int
    suspect: SuspectFrame | None
    unlike: FloatArray | None


class SeekingTracker(ColdStartTracker):
    """A tracker that seeks a frame in all of the map where it is not found near its expected pose."""

    def _begin(self, start: Any) -> None:
        super()._begin(start)
        # Frames that wait after the next search in vain, and those that wait now.
        self._pause, self._waiting = 0, 0

    def _register(self, given: NextFrame) -> Registration:
        before, waiting = self._kept(), self._waiting
        self._waiting = max(waiting - 1, 0)
        found = super()._register(given)
        # What entered the map stays in it, and so does another map that was begun.
        is_settled = not self._timeline.missed or self._at.world is not given.world
        is_asked = given.expected is None and PLACE_IN_DOUBT.intersection(found.verdict.codes)
        if is_settled or waiting or not is_asked:
            return found
        sought = sought_in_map(given.world, given.frame.without(before.at.motion), given.lengths, self.settings)
        self._waiting, self._pause = self._pause, min(LONGER_PAUSES * self._pause + 1, LONGEST_PAUSE)
        if sought.verdict.level == "failed":
            return found
        after, T = self._kept(), rigid(sought.T_target_source)
        self._put_back(before)
        step = rigid(pose.inverse(before.at.T_last) @ T)
        motion = rigid(predict(np.eye(4), step, 1.0 / self._timeline.span))
        self._at = dataclasses.replace(before.at, motion=motion)
        is_sure = sought.verdict.level == "accepted"
        there = Prediction(T, doubts=() if is_sure else (_doubt(found, sought),))
        again = super()._register(dataclasses.replace(given, expected=there))
        apart = float(given.frame.scan._spread.motion(found.T_target_source, again.T_target_source))
        is_elsewhere = not apart <= given.lengths.near
        if self._timeline.missed and not _tells_more(again, found, is_sure=is_sure, is_elsewhere=is_elsewhere):
            self._put_back(after)
            return found
        if self._timeline.missed:
            self._at = dataclasses.replace(self._at, motion=before.at.motion)
        else:
            self._pause, self._waiting = 0, 0
        words = "its place was told by a global search in the map: near the expected one it was lost or in doubt"
        return dataclasses.replace(again, verdict=again.verdict._remarked(Reason(words, "sought_in_map")))

    def _kept(self) -> _Before:
        at, timeline = self._at, self._timeline
        at = dataclasses.replace(at, link=copy.copy(at.link))
        return _Before(at, timeline.missed, timeline.slid, self._suspect, self._unlike)

    def _put_back(self, before: _Before) -> None:
        self._at, self._suspect, self._unlike = before.at, before.suspect, before.unlike
        self._timeline.missed, self._timeline.slid = before.missed, before.slid

    def _go_on_from(self, found: Registration, world: VoxelMap) -> None:
        """Expect the next frame where one was found."""
        self._at = Standing(rigid(found.T_target_source), world=world, link=MapLink(is_held=True))
        self._timeline.missed, self._timeline.slid, self._first = 0, 0, None
        self._unlike = self._suspect = None
        self._pause, self._waiting = 0, 0


def _tells_more(again: Registration, found: Registration, *, is_sure: bool, is_elsewhere: bool) -> bool:
    """Whether a frame that was placed by a search is better off than before: there, or for what is known of it."""
    if again.verdict.level == "failed" or "unconstrained" in again.verdict.codes:
        return False
    is_new = is_elsewhere or again.verdict.level == "accepted"
    return is_new and (is_sure or not again.inlier_fraction <= found.inlier_fraction)


def _doubt(found: Registration, sought: Registration) -> Reason:
    words = (
        f"a global search in the map is not sure of this place ({sought.verdict.reasons[0]}), and near the expected "
        f"one {found.verdict.reasons[0]}"
    )
    return Reason(words, "alternative_poses")


def sought_in_map(
    world: VoxelMap, frame: DownsampledFrame, lengths: Resolved, settings: OdometrySettings, start: Any = None
) -> Registration:
    """A frame registered to all of a map, by a global search where no initial pose is given."""
    found = register(PointCloud(frame.dense, viewpoint=np.zeros(3)), world.points, start)
    if found.verdict.level != "accepted" or start is not None:
        return found
    return _without_equal_turn(found, frame, world, lengths, settings)


def _without_equal_turn(
    found: Registration, frame: DownsampledFrame, world: VoxelMap, lengths: Resolved, settings: OdometrySettings
) -> Registration:
    """The same, in doubt where all walls fit as well after another turn: of a hall whose furniture was replaced."""
    T = rigid(found.T_target_source)
    search = FrameSearch(world.surface, lengths, settings, np.nan, [(T, T)])
    search.surface.about(T[:3, 3], frame.reach + lengths.reach)
    if not (equal := equal_turns(search, frame)):
        return found
    words = (
        f"another pose is equally likely: see alternatives; the frame fits as well {equal[0].words}: give start= "
        "where it is known"
    )
    verdict = found.verdict.doubted(Reason(words, "alternative_poses"))
    return dataclasses.replace(found, verdict=verdict, alternatives=(*found.alternatives, *equal))
