"""A drive that begins at speed, with few rings."""

import numpy as np
import pytest

from dqreg import Odometry
from dqreg.rigid import pose
from dqreg.synth.many_views import street_drive

# The fourth is lost no more; what follows shows that it stays so.
FRAMES = 8


@pytest.fixture(scope="module")
def fast():
    """The frame after the first one is suspect, and the next is lost in what the first one saw."""
    return street_drive(FRAMES, step=2.5, rings=16, rng=np.random.default_rng(20_689))


def test_a_drive_that_begins_at_speed_goes_on_from_its_suspect_frame_and_says_so(fast):
    odometry = Odometry()
    results = [odometry.register_frame(scan, stamp=0.1 * k) for k, scan in enumerate(fast.scans[:FRAMES])]
    assert "low_inlier_fraction" in results[1].verdict.codes
    steps, truth = (pose.inverse(T[1:-1]) @ T[2:] for T in (odometry.poses, fast.T_world_scan[:FRAMES]))
    # A tenth of the voxel, which is 0.6 m here.
    assert np.linalg.norm(steps[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 0.06
    # That the frame is right nobody knows.
    assert {r.verdict.level for r in results[1:]} == {"suspect"}
    assert all("frame 1 was not accepted" in str(r.verdict.reasons) for r in results[2:])


def test_a_lost_frame_that_does_not_fit_the_suspect_one_leaves_the_map_as_it_is(fast):
    # No search in the map, which would not find the noise either, and takes as long as all else.
    odometry = Odometry(map_search="never")
    for k in (0, 1):
        odometry.register_frame(fast.scans[k], stamp=0.1 * k)
    before = odometry.local_map
    noise = np.random.default_rng(0).uniform(-10, 10, (6000, 3))
    assert odometry.register_frame(noise, stamp=0.2).verdict.level == "failed"
    np.testing.assert_array_equal(odometry.local_map, before)
    # The time of the last trusted frame too: else the pace of the next would be that since the suspect one.
    assert odometry._timeline._gap == pytest.approx(0.2, rel=1e-12)
    # And the next one goes on, two steps after the suspect one.
    again = odometry.register_frame(fast.scans[3], stamp=0.3)
    assert np.isfinite(again.T_target_source).all()
