"""Turns that may have happened unseen: after a gap in time a hall fits half a turn on, with 85 % inliers against 97 %.

Near the prediction nothing tells: those are enough for a view that is new. So all turns are compared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Scan
from dqreg.icp import Alignment
from dqreg.odometry.align import LATTICE_STEP_DEG, FrameSearch
from dqreg.odometry.deskewing import Deskewed
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.rivals import ComparedFrame, map_sample, share_looked_through, shift_between
from dqreg.odometry.self_similarity import FrameView
from dqreg.odometry.starts import best_poses, candidates
from dqreg.odometry.timeline import MAX_PREDICTED_STEPS
from dqreg.odometry.unexplained_turns import LOOKED_THROUGH_SHARE, Looked, in_a_step
from dqreg.rigid import pose, single_pose
from dqreg.rigid.single_pose import orthonormal
from dqreg.trust.records import Alternative, Reason

# Share of the inliers of the best pose, or of the frames before, from which on another one is as good: half-turns of
# furnished halls came to 0.92 at most, right poses after all turns to 0.97 and more, and the right one to 0.948 of its
# half-turn where other furniture stood there.
AS_GOOD_SHARE = 0.94
# The same where constant velocity leads: right poses in streets came to 0.91 after four frames, a half-turn to 0.84.
MET_SHARE = 0.9
# A frame that fits less well than so, and looked through the map, may have turned within one step.
FITS_LESS_SHARE = 0.98
# Frames since the last trusted one from which on there was a gap: stamps jitter.
GAP_STEPS = 1.5
# Poses that are judged by many points, and initial poses that are refined, so many steps of the lattice apart.
SHORTLIST, INITIAL_POSES = 180, 6
APART_STEPS, WHOLE_TURN_DEG = 2.1, 180.0
# Share of the best run with few points below which another one is not refined with all.
LIKELY_SHARE = 0.8
# Turns about the middle of what is seen that are refined; share of its points beyond what counts as its ends.
OWN_TURNS, MIDDLE_QUANTILE = 3, 0.01


@dataclasses.dataclass(frozen=True)
class Since:
    """What may have happened since the last trusted frame."""

    steps: float  # Frames since then, by the stamps where there are any
    T_expected: FloatArray  # (4, 4): Where constant velocity leads in these

    @property
    def is_gap(self) -> bool:
        """Whether frames are missing."""
        return self.steps > GAP_STEPS

    def asks(self, search: FrameSearch, run: Alignment) -> bool:
        """Whether other turns are to be compared: not where a frame fits as usual where constant velocity leads."""
        if not self.is_gap:
            return run.inlier_fraction < MET_SHARE * search.usual
        is_short = self.steps <= MAX_PREDICTED_STEPS and self.is_met(search, run.T_target_source)
        return not is_short or not run.inlier_fraction >= AS_GOOD_SHARE * search.usual

    def is_suspicious(self, search: FrameSearch, run: Alignment, looked: Looked) -> bool:
        """Whether a frame fits a little less than usual, and looked through a little of the map."""
        fits_less = run.inlier_fraction < FITS_LESS_SHARE * search.usual
        return fits_less and run.found and looked(run) > LOOKED_THROUGH_SHARE

    def turn_deg(self, search: FrameSearch) -> float:
        """The largest turn, in degrees."""
        return min(WHOLE_TURN_DEG, search.settings.search_deg * self.steps)

    def is_met(self, search: FrameSearch, T: FloatArray) -> bool:
        """Whether the sensor is where constant velocity leads: in a like place it would be there by chance only."""
        return shift_between(self.T_expected, T) <= search.lengths.reach


@dataclasses.dataclass(frozen=True)
class TurnedFrame:
    """A frame after other turns were compared."""

    deskewed: Deskewed
    since: Since | None = None  # None where others tell the motion
    others: tuple[Alignment, ...] = ()  # Where it ends after other turns
    doubts: tuple[Reason, ...] = ()  # What speaks against its place
    T_before: FloatArray | None = None  # (4, 4): Where it was about to be placed without a turn, if another was chosen

    def told(self, place: ComparedFrame, search: FrameSearch) -> ComparedFrame:
        """The place of the frame with what speaks against it after a gap."""
        run, since = place.aligned, self.since
        place = dataclasses.replace(place, doubts=self.doubts) if self.doubts else place
        if since is None or not since.is_gap or not run.found:
            return place
        share, frame = run.inlier_fraction, self.deskewed.frame
        is_met = since.is_met(search, run.T_target_source)
        if share < (MET_SHARE if is_met else AS_GOOD_SHARE) * search.usual:
            place = dataclasses.replace(place, doubts=(_doubt(share, search.usual, since.steps),))
        if is_met and since.steps <= MAX_PREDICTED_STEPS:
            return place
        others = [other for other in self.others if not _is_same(search, frame, run, other)]
        equal = _equals(_as_good(others, run), run)
        return dataclasses.replace(place, rivals=(*place.rivals, *equal)) if equal else place


def compared_turns(
    search: FrameSearch, found: Deskewed, since: Since, worthwhile: float, looked: Looked
) -> TurnedFrame:
    """The best of all turns that may have happened; without a gap of any, only where the frame fits badly.

    Or where it looked through the map: then one that fits better and did so less is the better one.
    """
    run = found.aligned
    is_asked = since.asks(search, run)
    if not is_asked and not since.is_suspicious(search, run, looked):
        return TurnedFrame(found, since)
    others = _others(search, found, since.turn_deg(search) if since.is_gap else WHOLE_TURN_DEG)
    best = max(others, key=lambda other: other.inlier_fraction, default=run)
    enough = best.inlier_fraction if since.is_gap or not is_asked else AS_GOOD_SHARE * best.inlier_fraction
    # Poses along what holds a frame least are compared later: none that fits badly is worth leaving the prediction.
    if search.fits(best) and run.inlier_fraction < enough and (is_asked or looked(best) < looked(run)):
        others = [*(other for other in others if other is not best), run]
        found = Deskewed(found.frame, best, found.notes)
        found = found if found.frame.back is None else found.repeated(search, worthwhile)
    is_guess = not since.is_gap and search.fits(found.aligned) and since.asks(search, found.aligned)
    # Of turns that all fit less than usual the best is a guess: in a place that looks alike it looks through the map.
    doubted = is_guess and since.is_suspicious(search, found.aligned, looked)
    doubts = (_guess(found.aligned, search.usual),) if doubted else ()
    T_found = run.T_target_source if run.found else since.T_expected
    T_before = None if found.aligned is run else in_a_step(since.T_expected, T_found, search.settings.search_deg)
    return TurnedFrame(found, since, tuple(others), doubts, T_before)


def _guess(run: Alignment, usual: float) -> Reason:
    words = (
        f"{100 * run.inlier_fraction:.0f} % of the points are inliers at the best of all turns, after "
        f"{100 * usual:.0f} % in the frames before, and the frame looked through what stands there: the sensor may be "
        "in a place that looks alike"
    )
    return Reason(words, "falling_inlier_fraction")


def _doubt(share: float, usual: float, steps: float) -> Reason:
    words = (
        f"{100 * share:.0f} % of the points are inliers, after {100 * usual:.0f} % in the frames before, and the last "
        f"of those is {steps:.3g} frames ago: the view may be new, or the sensor turned in a place that looks alike"
    )
    return Reason(words, "falling_inlier_fraction")


def equal_turns(search: FrameSearch, frame: DownsampledFrame) -> tuple[Alternative, ...]:
    """Where a frame lies as well as at a known pose, the first anchor, after any turn.

    One that looks through the map, where the pose itself does not, is excluded by what stands there.
    """
    run = search.refine(search.scan_of(frame), search.anchors[0][0])
    if not (others := _as_good(_others(search, Deskewed(frame, run), WHOLE_TURN_DEG), run)):
        return ()
    view, standing = FrameView.of(frame.dense, search.lengths.near), map_sample(search.surface)
    looked = [share_looked_through(each, view, standing) for each in (run, *others)]
    if not looked[0] > LOOKED_THROUGH_SHARE:
        others = [other for other, share in zip(others, looked[1:], strict=True) if not share > LOOKED_THROUGH_SHARE]
    return _equals(others, run)


def _as_good(others: Sequence[Alignment], run: Alignment) -> list[Alignment]:
    """Those that hold about as many inliers as a pose, or more."""
    return [other for other in others if other.inlier_fraction >= AS_GOOD_SHARE * run.inlier_fraction]


def _equals(others: Sequence[Alignment], run: Alignment) -> tuple[Alternative, ...]:
    """Runs as other poses beside one."""
    T = run.T_target_source
    return tuple(
        Alternative(other.T_target_source, other.history[-1].rms, words=_words(T, other.T_target_source))
        for other in others
    )


def _words(T: FloatArray, other: FloatArray) -> str:
    turn = np.rad2deg(single_pose.angle_between(T, other))
    return f"{shift_between(other, T):.3g} away, turned by {turn:.0f} degrees"


def _others(search: FrameSearch, found: Deskewed, limit_deg: float) -> list[Alignment]:
    """Where a frame ends after other turns, each place once."""
    frame, known = found.frame, [found.aligned]
    scan = search.scan_of(frame)
    starts = _initial_poses(search, scan, found.aligned, limit_deg)
    # From where it lies as well: a few points may find what all of them, held by their rings, did not.
    starts += [found.aligned.T_target_source] if found.aligned.found else []
    for coarse in likely([search.approach(scan, start) for start in starts]):
        run = search.settle(scan, coarse.T_target_source, coarse, anew=True)
        if run.status == "converged" and not any(_is_same(search, frame, run, other) for other in known):
            known.append(run)
    return known[1:]


def likely(runs: Sequence[Alignment]) -> list[Alignment]:
    """Those of runs with few points that may hold as many inliers as the best one."""
    least = LIKELY_SHARE * max((run.inlier_fraction for run in runs), default=0.0)
    return [run for run in runs if not run.ended_early and run.inlier_fraction >= least]


def _is_same(search: FrameSearch, frame: DownsampledFrame, one: Alignment, other: Alignment) -> bool:
    apart = frame.scan._spread.motion(one.T_target_source, other.T_target_source)
    return bool(apart <= 0.5 * search.lengths.reach)


def _initial_poses(search: FrameSearch, scan: Scan, run: Alignment, limit_deg: float) -> list[FloatArray]:
    """The likeliest turns of a lattice that are distinct, and of those that lay what was seen around onto itself."""
    poses = np.concatenate([candidates(*anchor, limit_deg, LATTICE_STEP_DEG) for anchor in search.anchors])
    apart, cap, kept = np.deg2rad(APART_STEPS * LATTICE_STEP_DEG), 0.5 * search.lengths.reach, list[FloatArray]()
    for T in best_poses(search.surface, scan.points, poses, cap, (SHORTLIST, SHORTLIST)):
        if all(single_pose.angle_between(T, other) > apart for other in kept):
            kept.append(T)
        if len(kept) == INITIAL_POSES:
            break
    if not run.found or limit_deg < 90.0:
        return kept
    own = [T for T in _about_middle(run) if np.rad2deg(single_pose.angle_between(T, run.T_target_source)) <= limit_deg]
    return [*kept, *best_poses(search.surface, scan.points, np.stack(own), cap, (len(own), OWN_TURNS))]


def _about_middle(run: Alignment) -> list[FloatArray]:
    """The pose of a frame after quarter and half turns about the middle of what it saw: those of a rectangular hall."""
    points, normals = single_pose.apply(run.T_target_source, run.pairs.scan.points), run.pairs.closest.normals
    axes = np.linalg.eigh(normals.T @ normals)[1]
    low, high = np.quantile(points @ axes, [MIDDLE_QUANTILE, 1.0 - MIDDLE_QUANTILE], axis=0)
    about = pose.from_parts(np.eye(3), axes @ (0.5 * (low + high)))
    turns = [quarters * 0.5 * np.pi * axis for axis in axes.T for quarters in (1, 2, 3)]
    return [
        orthonormal(about @ pose.exp(np.r_[turn, np.zeros(3)]) @ pose.inverse(about) @ run.T_target_source)
        for turn in turns
    ]
