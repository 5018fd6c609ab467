from __future__ import annotations

import functools

import numpy as np
import pytest

from dqreg.compare.trust import drives
from dqreg.compare.trust.kinds import KINDS
from dqreg.odometry import Odometry, tracker
from dqreg.synth.many_views import street_drive

# Poses along x; frames of a simulated LiDAR of 32 rings in a corridor 4 m wide with pilasters every 5 m.
PITCH, DEPTH = 5.0, 0.25


@functools.cache
def driven(step: float, depth: float = DEPTH, frames: int = 3, *, timed: bool = False):
    rng = np.random.default_rng(4)
    drive = drives.drive(drives.corridor(rng, PITCH, depth), drives.straight(step, rng)[:frames], rng)
    odometry = Odometry()
    stamps = 0.1 * np.arange(frames) if timed else [None] * frames
    return [odometry.register_frame(p, stamp=t) for p, t in zip(drive.frames, stamps, strict=True)], drive.poses


def test_small_steps_along_equal_pilasters_are_right_and_accepted_where_the_time_is_known():
    results, poses = driven(0.6, timed=True)
    for result, T in zip(results, poses, strict=True):
        assert result.verdict.level == "accepted"
        # A third of a voxel, which is about 0.16 m here.
        assert np.linalg.norm(result.T_target_source[:3, 3] - T[:3, 3]) < 0.05


def test_without_times_a_place_one_period_on_is_named():
    # Frames may be missing: one that jumped by 5 along the pilasters would look the same.
    results, _ = driven(0.6, frames=2)
    assert results[1].verdict.codes == ("alternative_poses",)
    for each in results[1].alternatives:
        step = each.T_target_source[:3, 3] - results[1].T_target_source[:3, 3]
        # Along the pilasters, and not the same place again: that is half of the period off at most.
        assert abs(step[0]) > 0.5 * PITCH
        assert np.linalg.norm(step[1:]) < 0.1 * abs(step[0])


def test_times_tell_nothing_of_like_places_where_the_first_step_is_not_known():
    # The frame between holds too few points: a way of two periods in two steps is as likely as any.
    rng = np.random.default_rng(4)
    drive = drives.drive(drives.corridor(rng, PITCH, DEPTH), drives.straight(0.6, rng)[:2], rng)
    odometry = Odometry(map_search="never")
    for number, points in enumerate((drive.frames[0], drive.frames[1][:10], drive.frames[1])):
        result = odometry.register_frame(points, stamp=0.1 * number)
    assert np.linalg.norm(result.T_target_source[:3, 3] - drive.poses[1][:3, 3]) < 0.05
    assert result.verdict.codes == ("alternative_poses",)


@pytest.mark.parametrize("seed", [20_020, 20_021])
def test_after_a_gap_in_time_the_motion_before_decides_between_like_places_no_more(seed):
    # A hall of equal columns, and a way of one period while no frame came, as the stamps say: a dozen steps.
    drive = KINDS["drive-jump"].task(seed)
    half = len(drive.frames) // 2
    way = np.linalg.norm(np.diff(drive.poses[:, :3, 3], axis=0), axis=1)
    stamps, odometry = 0.1 * np.concatenate([[0.0], np.cumsum(way / np.median(way))]), Odometry()
    results = [odometry.register_frame(p, stamp=t) for p, t in zip(drive.frames, stamps, strict=True)]
    assert results[half].verdict.level == "suspect"
    assert "alternative_poses" in results[half].verdict.codes
    # What hangs on it is in doubt.
    assert "accepted" not in [result.verdict.level for result in results[half:]]


def test_a_furnished_hall_is_like_itself_nowhere():
    drive = KINDS["drive-hall"].task(1)
    odometry = Odometry()
    results = [odometry.register_frame(points) for points in drive.frames[:3]]
    assert [result.verdict.level for result in results] == ["accepted"] * 3


@pytest.mark.parametrize("step", [1.9, pytest.param(2.3, marks=pytest.mark.soak)])
def test_a_frame_that_slid_along_equal_pilasters_is_never_accepted(step):
    results, poses = driven(step)
    for result, T in zip(results[1:], poses[1:], strict=True):
        right = np.linalg.norm(result.T_target_source[:3, 3] - T[:3, 3]) < 0.3
        assert right or result.verdict.level != "accepted"


def test_nothing_holds_a_frame_along_bare_walls_whatever_the_rings_say():
    # The rings lie where they lay before, seen from the sensor: the fit is best where the frame has not moved at all.
    results, _ = driven(0.9, depth=0.0)
    for result in results[1:]:
        assert result.verdict.level == "suspect"
        assert "unconstrained" in result.verdict.codes
        free = result.observability[0]
        assert free.is_free
        assert free.kind == "translation"
        assert abs(free.axis[0]) > 0.99


def test_what_hangs_on_a_frame_that_was_not_accepted_says_so():
    results, _ = driven(0.9, depth=0.0)
    assert "untrusted_map" not in results[1].verdict.codes
    assert results[2].verdict.codes[0] == "untrusted_map"


@pytest.mark.parametrize(("kind", "seed"), [("drive-bare", 8203), ("drive-pilasters", 8138), ("drive-pilasters", 8619)])
def test_a_first_step_that_stuck_at_the_start_is_not_accepted(kind, seed):
    """Truth: the poses that the frames were made at, a metre apart. Nothing is known of the motion yet."""
    drive = KINDS[kind].task(seed)
    odometry = Odometry()
    result = [odometry.register_frame(points) for points in drive.frames[:2]][1]
    right = np.linalg.norm(result.T_target_source[:3, 3] - drive.poses[1][:3, 3]) < drive.allowed
    assert right or result.verdict.level != "accepted"
    assert right or result.alternatives


def test_a_frame_that_is_like_itself_nowhere_says_so_for_those_beside_it(monkeypatch):
    # Counted: how often a frame is looked at for shifts onto itself, along a street, 0.8 a frame.
    asked = []
    plain = tracker.similar_shifts
    monkeypatch.setattr(tracker, "similar_shifts", lambda *given: asked.append(plain(*given)) or asked[-1])
    frames = street_drive(5, rings=32, rng=np.random.default_rng(20)).scans
    odometry, counts = Odometry(), []
    for points in (frames[0], frames[1], frames[1], *frames[2:]):
        assert odometry.register_frame(points).verdict.level == "accepted"
        counts.append(len(asked))
    assert not any(map(len, asked))
    # Never before there is a map; once where it stands; again once it has gone on by the largest distance of a pair.
    assert counts[:3] == [0, 1, 1]
    assert 1 < counts[-1] < len(frames)
    # A sensor that was carried begins anew, be it set down where it stood.
    assert odometry.relocalise(frames[-1]).verdict.level == "accepted"
    before = len(asked)
    odometry.register_frame(frames[-1])
    assert len(asked) == before + 1
