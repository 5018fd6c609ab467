"""What an odometry does with a frame: place it, judge it, learn from it."""

from __future__ import annotations

import dataclasses
from collections import deque
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose, median
from dqreg._statuses import Status
from dqreg.icp import Alignment
from dqreg.kernels.threads import Later
from dqreg.odometry.align import MIN_POINTS_FOR_CELLS, FrameSearch
from dqreg.odometry.assess import LOST_FRACTION, first_frame, frame_result, information_of_place
from dqreg.odometry.deskewing import REPEATED_MISFIT_VOXELS, Deskewed, undo_first_sweep
from dqreg.odometry.frame import DownsampledFrame, RawFrame
from dqreg.odometry.kiss import KissParts
from dqreg.odometry.next_frame import NextFrame
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.repeats import like_itself, similar_shifts, with_met_normals
from dqreg.odometry.rivals import ComparedFrame, is_free, looked_through, map_sample, placed
from dqreg.odometry.self_similarity import FrameView
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import Pace, predict
from dqreg.odometry.timeline import Timeline
from dqreg.odometry.tracker_state import Standing
from dqreg.odometry.unexplained_turns import looking, unturned
from dqreg.odometry.unseen_rotations import Since, TurnedFrame, compared_turns
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.registration.result.empty_results import without_pose
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.rigid.single_pose import orthonormal
from dqreg.trust.limits import fraction_fits
from dqreg.trust.records import Reason

# Points below which a frame gets no pose, and cannot begin a map.
MIN_POINTS = 30
# Frames over which the usual fraction of inliers is taken; steps without which no prediction is known to be good.
USUAL_FRACTION_FRAMES, MIN_STEPS = 10, 3
# Points that predictions miss by so many voxels at most lie in the cells that they belong to, or beside them. Of those
# that they miss by such a share of the largest distance of a pair, enough find their matches.
NEAR_VOXELS, TRUSTED_REACHES = 0.75, 0.5
# The first motion may be so many times what one frame is usually off its prediction: that stands still.
FIRST_MOTION_DEVIATIONS = 3.0


class Tracker:
    """Map, motion and frames so far."""

    def __init__(self, settings: OdometrySettings, start: Any) -> None:
        self.settings = settings
        self._begin(start)

    def _begin(self, start: Any) -> None:
        self._lengths: Resolved | None = None
        self._kiss: KissParts | None = None
        self._at = Standing(np.eye(4) if start is None else as_pose(start, "start"))
        self._usual: deque[float] = deque(maxlen=USUAL_FRACTION_FRAMES)
        self._pace = Pace()
        # The first frame, while nobody knows the motion during its sweep.
        self._first: DownsampledFrame | None = None
        # Whether the motion is what this frame and the first one told together.
        self._is_under_way = False
        # Where a frame was like itself nowhere.
        self._unlike: FloatArray | None = None
        # What the last frame saw.
        self._view: FrameView | None = None
        self._timeline = Timeline(self.settings.history)

    def _place(self, raw: RawFrame, ratio: float, expected: Prediction | None, *, insert: bool) -> Registration:
        if not len(raw.points):
            return self._failed("the frame holds no finite point", raw, "no points")
        lengths = self._lengths or self.settings.resolve(raw.points)
        kiss = self._kiss or KissParts(lengths)
        if expected is not None and self._kiss is not None:
            # What deskews the frame: the motion that is expected, over all of the frames that it spans.
            step = orthonormal(pose.inverse(self._at.T_last) @ expected.T_map_frame)
            motion = orthonormal(predict(np.eye(4), step, 1.0 / self._timeline.span))
            self._at = dataclasses.replace(self._at, motion=motion)
        frame = raw.downsampled(lengths)
        if frame is None or len(frame.seen) < MIN_POINTS:
            why = (
                f"downsampling leaves {0 if frame is None else len(frame.seen)} of {len(raw.points)} points (within "
                f"{lengths.max_range:.4g}, voxels of {lengths.voxel_size:.4g}); {MIN_POINTS} are needed"
            )
            return self._failed(why, raw, "too few points")
        if self._at.world is None:
            self._lengths, self._kiss, world = lengths, kiss, VoxelMap(lengths)
            T = self._at.T_last if expected is None else expected.T_map_frame
            self._merge(world, frame, dataclasses.replace(self._at, world=world, T_last=T))
            self._first = None if frame.back is None else frame
            return first_frame(self._at.T_last, raw.notes, self._settings_of(frame))
        self._is_under_way = self._undo_first_sweep(self._at.world, lengths, frame, ratio)
        return self._register(NextFrame(frame, raw.notes, self._at.world, lengths, kiss, ratio, expected, insert))

    def _undo_first_sweep(self, world: VoxelMap, lengths: Resolved, frame: DownsampledFrame, ratio: float) -> bool:
        """Make the map anew of the first frame without the motion during its sweep; whether that was found."""
        if self._first is None or frame.back is None:
            return False
        search = FrameSearch(world.surface, lengths, self.settings, np.nan, [(self._at.T_last, self._at.T_last)])
        sweep = undo_first_sweep(search, self._first, frame, ratio)
        if sweep is None:
            return False
        self._first = None
        self._at = dataclasses.replace(self._at, motion=sweep.motion, world=sweep.map or world)
        return sweep.fits

    def _ahead(self, raw: RawFrame) -> RawFrame:
        """A frame downsampled ahead of its turn, beside the frame before, where that decides nothing of it."""
        if self._lengths is None or not len(raw.points):
            return raw
        return dataclasses.replace(raw, ahead=(self._lengths, raw.downsampled(self._lengths)))

    def _failed(self, why: str, raw: RawFrame, status: Status) -> Registration:
        self._timeline.missed += 1
        return without_pose((Reason(why, "too_few_points"), *raw.notes), status, {})

    def _register(self, given: NextFrame) -> Registration:
        T_last, motion = self._at.T_last, self._at.motion
        frame, lengths, kiss, ratio, expected = given.frame, given.lengths, given.kiss, given.ratio, given.expected
        T_predicted = orthonormal(predict(T_last, motion, ratio)) if expected is None else expected.T_map_frame
        surface, T_likely = given.world.surface, T_predicted
        if expected is None:
            T_likely, motion = self._pace.expect(T_last, motion, ratio)
        else:
            self._pace.leave(T_predicted)
        frame = frame.without(motion)
        # Points farther off than its own can reach cannot be met.
        surface.about(T_last[:3, 3], frame.reach + lengths.reach)
        anchors, is_told = self._anchors(orthonormal(T_likely)), expected is not None and expected.holds(lengths.reach)
        search = FrameSearch(surface, lengths, self.settings, self._usual_fraction, anchors, is_told)
        # With times it is deskewed once more, and seen then.
        seen = self._seen(frame, lengths) if frame.back is None else None
        deskewed = self._deskewed(search, frame, trusted=expected is not None or kiss.deviation <= lengths.voxel_size)
        turned = self._turned(search, deskewed, expected, seen)
        frame, notes = turned.deskewed.frame, given.notes + turned.deskewed.notes
        seen = seen or self._seen(frame, lengths)
        measured = expected is not None and expected.information is not None
        first = self._compared(search, turned, given, T_predicted, seen)
        # Times tell nothing where the first step was not trusted, and no motion is known.
        timed = self._timeline.is_timed and (bool(self._usual) or not self._timeline.missed)
        T = first.aligned.T_target_source
        asked = first.aligned.found and not (timed or measured or self._is_unlike(frame, T, lengths.reach))
        # After the depth image, beside the information.
        similar = Later(lambda: similar_shifts(search, with_met_normals(frame, first.aligned))) if asked else None
        # While what was seen is made beside: it is none of the information's.
        information = information_of_place(first, frame.reach)
        # A map that holds what a frame looked through would confirm the next ones.
        first = looked_through(turned.told(first, search), seen.result(), map_sample(surface))
        # What is said of it then changes neither its pose nor whether it enters; places that it is like ask the map.
        if grows := given.insert and self._surely_enters(first, frame) and not asked and not measured:
            given.world.insert(lambda: frame.dense, orthonormal(T))
        place = first if similar is None else like_itself(first, search, frame, seen.result(), similar)
        # For the next frame, which is taken for as dense.
        self._view = seen.result()
        found = frame_result(place, information, frame, self._usual_fraction, notes, self._settings_of(frame), expected)
        slides = self._at.link.slides(found) and self._at.kept_out < self.settings.patience
        enters = grows or (self._is_absorbed(place) and not slides)
        result = self._at.link.linked(found, place, self._timeline.count, merged=enters)
        accepted = result.verdict.level == "accepted"
        if similar is not None or not accepted:
            self._unlike = T if similar is not None and accepted and not len(similar.result()) else None
        learned = dataclasses.replace(given, frame=frame, insert=given.insert and not grows)
        self._learn(learned, result, T_predicted, enters=enters)
        return result

    def _deskewed(self, search: FrameSearch, frame: DownsampledFrame, *, trusted: bool) -> Deskewed:
        """Where a frame lies, without the motion during its sweep; the prediction may be trusted anyway."""
        off, lengths = np.inf if self._timeline.missed > self._timeline.slid else self._pace.off, search.lengths
        # A sweep tells its own motion: one step that was as predicted is enough.
        likely = trusted or self._is_under_way or off <= TRUSTED_REACHES * lengths.reach
        if self._pace.steps < MIN_STEPS:
            off = np.inf
        near = self._is_under_way or off <= NEAR_VOXELS * lengths.voxel_size
        trusted = trusted or off <= TRUSTED_REACHES * lengths.reach
        worthwhile = REPEATED_MISFIT_VOXELS * lengths.voxel_size
        # Where a near start fails, a frame is sought from farther off before its motion is left out.
        for is_near in [True, False] if near else [False]:
            if likely and (found := Deskewed.at_once(frame, search, worthwhile, near=is_near)) is not None:
                return found
        found = Deskewed(frame, search.find(frame, trust_motion=trusted, near=near))
        return found if frame.back is None else found.repeated(search, worthwhile)

    def _turned(
        self, search: FrameSearch, deskewed: Deskewed, expected: Prediction | None, seen: Later[FrameView] | None
    ) -> TurnedFrame:
        """A frame after all turns that may have happened since the last trusted one, unless others tell the motion."""
        if expected is not None or self._slides_on(deskewed.aligned):
            return TurnedFrame(deskewed, doubts=() if expected is None else expected.doubts)
        steps = self._timeline.span
        since = Since(steps, orthonormal(predict(self._at.T_last, self._at.motion, steps)))
        # Rarely asked for.
        view = seen or self._seen(deskewed.frame, search.lengths, beside=False)
        return compared_turns(
            search,
            deskewed,
            since,
            REPEATED_MISFIT_VOXELS * search.lengths.voxel_size,
            looking(search.surface, view),
        )

    def _compared(
        self,
        search: FrameSearch,
        turned: TurnedFrame,
        given: NextFrame,
        T_predicted: FloatArray,
        seen: Later[FrameView],
    ) -> ComparedFrame:
        """A frame after poses along its weakest direction, and those without a turn, were compared."""
        frame, aligned, expected = turned.deskewed.frame, turned.deskewed.aligned, given.expected
        measured = expected is not None and expected.information is not None
        spread = expected.spread if expected and measured else self._deviation(given.kiss, aligned, expected)
        place = placed(search, frame, aligned, T_predicted, spread, measured=measured)
        T_before = turned.T_before if expected is None else expected.T_before
        return place if T_before is None else unturned(place, search, frame, T_before, looking(search.surface, seen))

    def _is_unlike(self, frame: DownsampledFrame, T: FloatArray, reach: float) -> bool:
        """Whether a frame of all but the same place was like itself nowhere: what it saw is what this one sees."""
        before = None if self._timeline.missed else self._unlike
        return before is not None and frame.scan._spread.motion(before, T) <= reach

    def _seen(self, frame: DownsampledFrame, lengths: Resolved, *, beside: bool = True) -> Later[FrameView]:
        before = self._view
        return Later(lambda: FrameView.of(frame.dense, lengths.near, before), beside=beside)

    def _is_absorbed(self, place: ComparedFrame) -> bool:
        """Whether a frame is absorbed: one that has a pose, and fits as usual, or the last ones did not either."""
        aligned = place.aligned
        fits = place.is_escaped or fraction_fits(aligned.inlier_fraction, self._usual_fraction)
        accepted = (fits and not place.is_refused) or self._at.kept_out >= self.settings.patience
        return aligned.found and aligned.inlier_fraction >= LOST_FRACTION and accepted

    def _deviation(self, kiss: KissParts, aligned: Alignment, expected: Prediction | None) -> float:
        """How far off constant velocity may be: infinite after a gap or a doubtful frame, and much at first."""
        is_sought = expected is not None and expected.T_before is not None
        if is_sought or ((self._timeline.missed or self._timeline.is_guessed) and not self._slides_on(aligned)):
            return np.inf
        is_first = expected is None and not self._usual
        return kiss.deviation * (FIRST_MOTION_DEVIATIONS if is_first else self._timeline.steps)

    def _slides_on(self, aligned: Alignment) -> bool:
        """Whether a frame slides as all since the last trusted one do: nothing but the motion tells its place."""
        return self._timeline.has_slid and is_free(aligned)

    def _surely_enters(self, place: ComparedFrame, frame: DownsampledFrame) -> bool:
        """Whether a frame is absorbed whatever its information says: it leaves no motion free that the map held."""
        may_slide = self._at.link.is_held and (place.is_free or len(frame.seen) < MIN_POINTS_FOR_CELLS)
        return self._is_absorbed(place) and not may_slide

    def _anchors(self, T_predicted: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Where the sensor may be: at the last trusted pose going on, or at the last doubtful one."""
        anchors = [(self._at.T_last, T_predicted)]
        return anchors if self._at.T_doubtful is None else [*anchors, (self._at.T_doubtful, self._at.T_doubtful)]

    def _learn(self, given: NextFrame, result: Registration, T_predicted: FloatArray, *, enters: bool) -> None:
        if result.verdict.level == "failed":
            self._timeline.missed += 1
            return
        T = result.T_target_source
        if not enters:
            self._timeline.missed += 1
            self._timeline.slid += (slides := self._at.link.slides(result))
            T_doubtful = self._at.T_doubtful if slides else T
            self._at = dataclasses.replace(self._at, T_doubtful=T_doubtful, kept_out=self._at.kept_out + 1)
            return
        deviation = pose.inverse(T_predicted) @ T
        given.kiss.learn(deviation)
        # Of a gap only the mean motion is known, and of one that nobody measured none.
        step = pose.inverse(self._at.T_last) @ T
        before, ahead = self._at.motion, self._timeline.is_ahead
        motion = before if ahead else orthonormal(predict(np.eye(4), step, 1.0 / self._timeline.steps))
        self._pace.learn(given.frame.scan._spread, T, before, motion)
        self._timeline.trust()
        self._usual.append(result.inlier_fraction)
        at = dataclasses.replace(self._at, T_last=T, motion=motion)
        self._merge(given.world, given.frame, at, insert=given.insert)

    @property
    def _usual_fraction(self) -> float:
        return median(np.array(self._usual))

    def _merge(self, world: VoxelMap, frame: DownsampledFrame, at: Standing, *, insert: bool = True) -> None:
        if insert:
            world.insert(lambda: frame.dense, at.T_last)
        self._at, self._first = dataclasses.replace(at, kept_out=0, T_doubtful=None), None

    def _settings_of(self, frame: DownsampledFrame) -> dict[str, Any]:
        return {
            **({} if self._lengths is None else dataclasses.asdict(self._lengths)),
            "method": self.settings.method,
            "centre": self._at.T_last[:3, 3].tolist(),
            "used_points": len(frame.seen),
            "source_points": len(frame.dense),
            "source_scale": 1.0,
            **frame.times,
        }
