"""Frames that are not found near where they are expected, and sought in all of the map.

After frames that are missing, a sensor that was carried or knocked, or a first step that nobody knows, points lie too
far from their own faces, and rings of the ground lie on themselves best where the sensor was before. A global search
does not begin there. It takes as long as many frames: where it tells nothing new, the next one waits for longer.
"""

from __future__ import annotations

import copy
import dataclasses
from contextlib import suppress
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.icp.stopwatch import Stopwatch
from dqreg.kernels.threads import TimeUpError, until
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.assess import MapLink
from dqreg.odometry.cold_start import ColdStartTracker, SuspectFrame
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.nearby_places import place_nearby
from dqreg.odometry.next_frame import NextFrame
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import predict
from dqreg.odometry.timeline import LastTrusted
from dqreg.odometry.tracker_state import Standing
from dqreg.odometry.unexplained_turns import in_a_step
from dqreg.odometry.unseen_rotations import equal_turns
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.rigid.single_pose import orthonormal
from dqreg.trust.code_sets import PLACE_IN_DOUBT
from dqreg.trust.records import Reason

# Frames that wait after a search that told nothing new: so many times those after the one before and one, and at most.
LONGER_PAUSES, LONGEST_PAUSE = 2, 64


@dataclasses.dataclass(frozen=True, eq=False)
class _Before:
    """What a frame that stays out of the map changes of a drive."""

    at: Standing
    last: LastTrusted
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
        if waiting or not self._is_sought(given, found):
            return found
        watch = Stopwatch(self.settings.time_limit)
        result = self._placed_nearby(given, before, found, watch) or self._placed_in_map(given, before, found, watch)
        if self._timeline.missed:
            self._waiting, self._pause = self._pause, min(LONGER_PAUSES * self._pause + 1, LONGEST_PAUSE)
        else:
            self._pause, self._waiting = 0, 0
        result.timings["search"] = watch.total
        return result

    def _is_sought(self, given: NextFrame, found: Registration) -> bool:
        """Whether a frame is sought: what entered the map stays in it, and so does another map that was begun."""
        is_settled = not self._timeline.missed or self._at.world is not given.world
        is_asked = given.expected is None and self.settings.map_search == "doubt"
        is_lost = PLACE_IN_DOUBT.intersection(found.verdict.codes) or self._at.link.slides(found)
        return is_asked and not is_settled and bool(is_lost)

    def _placed_nearby(
        self, given: NextFrame, before: _Before, found: Registration, watch: Stopwatch
    ) -> Registration | None:
        """The frame at the only place nearby where it fits, if it is accepted there."""
        at, usual = before.at, self._usual_fraction
        if not usual > 0.0:
            return None
        T_expected = orthonormal(predict(at.T_last, at.motion, given.ratio))
        anchors = [(at.T_last, T_expected)] + ([] if at.T_doubtful is None else [(at.T_doubtful, at.T_doubtful)])
        search = FrameSearch(given.world.surface, given.lengths, self.settings, usual, anchors)
        T = None
        with suppress(TimeUpError), until(watch.deadline):
            T = place_nearby(search, given.frame.without(at.motion))
        if T is None:
            return None
        words = "its place was told by a search nearby in the map: where it was expected it was lost or in doubt"
        return self._placed_at(T, given, before, found, Reason(words, "sought_in_map"), accepted=True)

    def _placed_in_map(self, given: NextFrame, before: _Before, found: Registration, watch: Stopwatch) -> Registration:
        """The frame where a search in all of the map puts it, if that tells more than how it was found."""
        frame = given.frame.without(before.at.motion)
        sought = sought_in_map(given.world, frame, given.lengths, self.settings, time_limit=watch.left)
        if "search_time_limit" in sought.verdict.codes:
            unfinished = _unfinished(self.settings.time_limit)
            return dataclasses.replace(found, verdict=found.verdict._remarked(unfinished))
        if sought.verdict.level == "failed":
            return found
        doubts = () if sought.verdict.level == "accepted" else (_doubt(found, sought),)
        words = "its place was told by a global search in the map: near the expected one it was lost or in doubt"
        T, remark = orthonormal(sought.T_target_source), Reason(words, "sought_in_map")
        return self._placed_at(T, given, before, found, remark, doubts) or found

    def _placed_at(
        self,
        T: FloatArray,
        given: NextFrame,
        before: _Before,
        found: Registration,
        remark: Reason,
        doubts: tuple[Reason, ...] = (),
        *,
        accepted: bool = False,
    ) -> Registration | None:
        """The frame at a place, if that tells more than how it was found, or if it is accepted there."""
        after = self._kept()
        self._put_back(before)
        step = orthonormal(pose.inverse(before.at.T_last) @ T)
        motion = orthonormal(predict(np.eye(4), step, 1.0 / self._timeline.span))
        self._at = dataclasses.replace(before.at, motion=motion)
        T_expected = orthonormal(predict(before.at.T_last, before.at.motion, given.ratio))
        T_found = T_expected if found.verdict.level == "failed" else found.T_target_source
        sought = Prediction(T, doubts=doubts, T_before=in_a_step(T_expected, T_found, self.settings.search_deg))
        again = super()._register(dataclasses.replace(given, expected=sought))
        if self._timeline.missed:
            apart = float(given.frame.scan._spread.motion(found.T_target_source, again.T_target_source))
            is_elsewhere = not apart <= given.lengths.near
            if accepted or not _tells_more(again, found, is_sure=not doubts, is_elsewhere=is_elsewhere):
                self._put_back(after)
                return None
            self._at = dataclasses.replace(self._at, motion=before.at.motion)
        return dataclasses.replace(again, verdict=again.verdict._remarked(remark))

    def _kept(self) -> _Before:
        at = dataclasses.replace(self._at, link=copy.copy(self._at.link))
        return _Before(at, self._timeline.last_trusted(), self._suspect, self._unlike)

    def _put_back(self, before: _Before) -> None:
        self._at, self._suspect, self._unlike = before.at, before.suspect, before.unlike
        self._timeline.put_back(before.last)

    def _go_on_from(self, found: Registration, world: VoxelMap) -> None:
        """Expect the next frame where one was found."""
        self._at = Standing(orthonormal(found.T_target_source), world=world, link=MapLink(is_held=True))
        self._timeline.find_again()
        self._first = self._unlike = self._suspect = None
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


def _unfinished(limit: float | None) -> Reason:
    words = (
        f"the time limit of {limit:g} s ended the search for this frame in all of the map before its end: allow more "
        "(time_limit=), or call relocalise where there is time"
    )
    return Reason(words, "search_time_limit")


def sought_in_map(
    world: VoxelMap,
    frame: DownsampledFrame,
    lengths: Resolved,
    settings: OdometrySettings,
    start: Any = None,
    *,
    time_limit: float | None = None,
) -> Registration:
    """A frame registered to all of a map, by a global search where no initial pose is given."""
    watch = Stopwatch(time_limit)
    found = register(PointCloud(frame.dense, viewpoint=np.zeros(3)), world.points, start, time_limit=time_limit)
    if found.verdict.level != "accepted" or start is not None:
        return found
    with suppress(TimeUpError), until(watch.deadline):
        return _without_equal_turn(found, frame, world, lengths, settings)
    words = f"the time limit of {time_limit:g} s ended the comparison with other turns, one of which may fit as well"
    return dataclasses.replace(found, verdict=found.verdict.doubted(Reason(words, "alternative_poses")))


def _without_equal_turn(
    found: Registration, frame: DownsampledFrame, world: VoxelMap, lengths: Resolved, settings: OdometrySettings
) -> Registration:
    """The same, in doubt where all walls fit as well after another turn: of a hall whose furniture was replaced."""
    T = orthonormal(found.T_target_source)
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
