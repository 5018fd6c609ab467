"""Wrong stamps, and clocks that are set anew."""

import numpy as np
import pytest

from dqreg import Odometry
from dqreg.errors import InputError
from dqreg.odometry.timeline import Timeline
from dqreg.synth.many_views import street_drive

USUAL = [0.1 * number for number in range(10)]
JUMP = [*USUAL[:5], 1e6, *USUAL[6:]]
RESET = [1.7e9 + 0.1 * number for number in range(5)] + USUAL[:5]
PAUSE = [*USUAL[:5], *(100.0 + stamp for stamp in USUAL[5:])]


def told(stamps, untrusted=()):
    """Ratio to the last motion, code and whether the motion decides, of every frame."""
    timeline, rows = Timeline(None), []
    for number, stamp in enumerate(stamps):
        ratio, remark = timeline.ratio(stamp)
        rows.append((ratio, None if remark is None else remark.code, timeline.is_timed))
        if number in untrusted:
            timeline.missed += 1
        else:
            timeline.trust()
    return rows


@pytest.mark.parametrize(
    ("stamps", "codes"),
    [
        (JUMP, {5: "time_stamp"}),
        (RESET, {5: "time_stamp", 6: "new_clock"}),
        (PAUSE, {5: "time_stamp", 6: "new_clock"}),
        ([*USUAL[:5], USUAL[4], *USUAL[6:]], {5: "time_stamp"}),
        ([*USUAL[:5], np.nan, *USUAL[6:]], {5: "time_stamp"}),
    ],
)
def test_the_frame_with_the_wrong_stamp_is_named_and_no_other(stamps, codes):
    assert {number: code for number, (_, code, _) in enumerate(told(stamps)) if code} == codes


@pytest.mark.parametrize("stamps", [JUMP, RESET, PAUSE, [*USUAL[:5], None, *USUAL[6:]], [*USUAL[:5], 0.4, *USUAL[6:]]])
def test_motion_is_predicted_by_one_step_across_a_wrong_stamp(stamps):
    # The step to the frame after it took half as long as its stamps say; those of today are exact to 2e-7 s.
    np.testing.assert_allclose([ratio for ratio, _, _ in told(stamps)], 1.0, atol=1e-5)


@pytest.mark.parametrize("stamps", [JUMP, RESET, PAUSE])
def test_over_an_unknown_time_the_motion_decides_nothing(stamps):
    assert [timed for _, _, timed in told(stamps)] == [False, *[True] * 4, False, *[True] * 4]
    # Nor while the last trusted frame is of another clock.
    later = told(stamps, untrusted=(5, 6))
    is_known = stamps is JUMP
    assert [timed for _, _, timed in later] == [False, *[True] * 4, False, is_known, is_known, True, True]


def test_a_gap_that_is_no_longer_than_its_stamps_say_is_not_named():
    assert told([0.0, 0.1, 0.2, 0.7, 0.8])[3] == (pytest.approx(5.0), None, True)


def test_a_wrong_first_step_does_not_spoil_the_clock_for_good():
    stamps = [0.0, 1e-6, *USUAL[2:]]
    assert {number for number, (_, code, _) in enumerate(told(stamps)) if code == "time_stamp"} <= {2, 3}


def test_a_drive_with_one_wrong_stamp_has_one_suspect_frame(jerky):
    odometry = Odometry()
    stamps = [0.0, 0.1, 0.2, 1e6, 0.4, 0.5]
    results = [odometry.register_frame(f, stamp=s) for f, s in zip(jerky.frames[:6], stamps, strict=True)]
    assert [r.verdict.codes[0] == "time_stamp" for r in results] == [False, False, False, True, False, False]
    assert [r.verdict.level for r in results] == [*["accepted"] * 3, "suspect", "accepted", "accepted"]


def test_a_new_clock_is_a_remark(jerky):
    odometry = Odometry()
    stamps = [1.7e9, 1.7e9 + 0.1, 0.0, 0.1]
    last = [odometry.register_frame(f, stamp=s) for f, s in zip(jerky.frames[:4], stamps, strict=True)][-1]
    assert last.verdict.level == "accepted"
    assert "new_clock" in last.verdict.codes


@pytest.mark.parametrize("stamp", ["x", "1.5", object()])
def test_a_stamp_that_is_no_number_is_named(jerky, stamp):
    with pytest.raises(InputError, match=r"stamp must be a number.*got"):
        Odometry().register_frame(jerky.frames[0], stamp=stamp)


def test_a_frame_that_was_found_again_leaves_the_pace_as_it_was():
    # Equal steps of 0.1 s, frames of noise, and the last one relocalised: the next two are expected one step on.
    frames = street_drive(9, rings=32, rng=np.random.default_rng(20)).scans
    odometry, noise = Odometry(map_search="never"), np.random.default_rng(0).uniform(-10.0, 10.0, (6000, 3))
    for k in range(5):
        odometry.register_frame(frames[k], stamp=0.1 * k)
    for k in (5, 6):
        assert odometry.register_frame(noise, stamp=0.1 * k).verdict.level == "failed"
    assert odometry.relocalise(frames[6]).verdict.level == "accepted"
    for k in (7, 8):
        assert odometry._timeline.missed == 0
        assert odometry._timeline._gap == pytest.approx(0.0)
        assert odometry.register_frame(frames[k], stamp=0.1 * k).verdict.level == "accepted"
        assert odometry._timeline._pace == pytest.approx(0.1)
