"""Frames that are not found where they are expected, and sought in all of the map."""

from types import SimpleNamespace

import numpy as np
import pytest

import dqreg.odometry.sought_frames as sought_frames
from dqreg import Odometry
from dqreg.errors import InputError
from dqreg.registration.result.empty_results import without_pose
from dqreg.rigid import pose
from dqreg.synth.many_views import street_drive
from dqreg.trust.records import Reason

# A tenth of the voxel, which is 0.35 m here.
NEAR = 0.035
# The frame after a gap of so many, at 0.8 m each.
AFTER_GAP = 13


def off(result, drive, number):
    truth = pose.inverse(drive.T_world_scan[0]) @ drive.T_world_scan[number]
    return np.linalg.norm(result.T_target_source[:3, 3] - truth[:3, 3])


@pytest.fixture(scope="module")
def drive():
    return street_drive(15, rings=16, rng=np.random.default_rng(21_112))


def after_five(drive, **options):
    odometry = Odometry(**options)
    for number in range(5):
        odometry.register_frame(drive.scans[number], stamp=0.1 * number)
    return odometry


def test_a_drive_comes_back_onto_its_map_after_a_long_gap_and_says_how(drive):
    odometry, codes = after_five(drive), []
    for number in (AFTER_GAP, AFTER_GAP + 1):
        result = odometry.register_frame(drive.scans[number], stamp=0.1 * number)
        assert off(result, drive, number) < NEAR
        codes.append(result.verdict.codes)
    assert codes == [("accepted", "sought_in_map"), ("accepted",)]


def test_a_first_step_that_nobody_knows_is_found_and_stays_in_doubt():
    # Rings of the ground lie on themselves best where the sensor was before: 2.8 m off.
    fast = street_drive(3, step=3.0, rings=16, rng=np.random.default_rng(21_112))
    odometry = Odometry()
    for number, scan in enumerate(fast.scans):
        result = odometry.register_frame(scan, stamp=0.1 * number)
        assert off(result, fast, number) < NEAR
    assert result.verdict.level == "suspect"


def test_frames_of_another_place_are_sought_less_and_less_often_and_change_nothing(drive, monkeypatch):
    odometry, asked = after_five(drive), []
    nowhere = without_pose((Reason("no pose", "no_pose"),), "no correspondences", {})
    monkeypatch.setattr(sought_frames, "sought_in_map", lambda *_, **__: asked.append(number) or nowhere)
    before, rng = odometry.local_map, np.random.default_rng(0)
    for number in range(4):
        result = odometry.register_frame(rng.uniform(-10, 10, (2_000, 3)), stamp=0.5 + 0.1 * number)
        assert result.verdict.level == "failed"
    assert asked == [0, 1, 3]
    np.testing.assert_array_equal(odometry.local_map, before)


def test_no_frame_is_sought_where_that_is_not_wanted(drive, monkeypatch):
    monkeypatch.setattr(sought_frames, "sought_in_map", lambda *_, **__: pytest.fail("it was sought"))
    odometry = after_five(drive, map_search="never")
    result = odometry.register_frame(drive.scans[AFTER_GAP], stamp=0.1 * AFTER_GAP)
    assert result.verdict.level != "accepted"
    assert "search" not in result.timings


def test_a_search_that_has_no_time_to_end_changes_nothing_and_says_so(drive):
    never = after_five(drive, map_search="never")
    limited, stamp = after_five(drive, time_limit=1e-6), 0.1 * AFTER_GAP
    expected = never.register_frame(drive.scans[AFTER_GAP], stamp=stamp)
    result = limited.register_frame(drive.scans[AFTER_GAP], stamp=stamp)
    assert result.verdict.level == expected.verdict.level
    assert result.verdict.codes == (*expected.verdict.codes, "search_time_limit")
    np.testing.assert_array_equal(result.T_target_source, expected.T_target_source)
    assert result.timings["search"] <= result.timings["total"]


@pytest.mark.parametrize(
    ("wrong", "words"), [({"map_search": "always"}, "unknown map_search"), ({"time_limit": 0.0}, "time_limit must be")]
)
def test_how_a_frame_is_sought_is_checked(wrong, words):
    with pytest.raises(InputError, match=words):
        Odometry(**wrong)


def test_a_frame_that_leaves_a_motion_free_where_the_map_held_all_is_sought(drive):
    odometry = after_five(drive)
    given = SimpleNamespace(world=odometry._at.world, expected=None)
    free = without_pose((Reason("free along x", "unconstrained"),), "converged", {})
    odometry._timeline.missed = 1
    assert odometry._is_sought(given, free)
    odometry._at.link.is_held = False
    assert not odometry._is_sought(given, free)
