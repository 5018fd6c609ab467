"""Places near where a frame is expected. Truth: the poses that rays were cast from."""

import numpy as np
import pytest

from dqreg.compare.trust.drives import frame
from dqreg.compare.trust.shapes import joined
from dqreg.odometry import Odometry
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import downsample_frame, read_frame
from dqreg.odometry.nearby_places import place_nearby
from dqreg.rigid import pose
from tests.odometry.test_unseen_rotations import ASIDE, CABINETS, HALL, MIDDLE, placed


def carried_from(start, pieces, by, yaw_deg):
    """Where a sensor is found that was carried in a hall, and where it is."""
    scene, rng, odometry = joined(*pieces), np.random.default_rng(3), Odometry()
    poses = [placed(start, 0.0, 0), placed(start, 2.0, 1), placed(np.add(start, (*by, 0.0)), yaw_deg, 2)]
    for number in range(2):
        found = odometry.register_frame(frame(scene, poses[number], rng), stamp=0.1 * number)
    lengths, T = odometry._lengths, found.T_target_source
    search = FrameSearch(odometry._at.world.surface, lengths, odometry.settings, found.inlier_fraction, [(T, T)])
    last = downsample_frame(read_frame(frame(scene, poses[2], rng), None), lengths)
    return place_nearby(search, last), pose.inverse(poses[0]) @ poses[2]


@pytest.mark.parametrize(("by", "yaw_deg"), [((-0.8, 0.5), 50.0), ((-0.6, 0.8), -50.0)])
def test_a_sensor_that_was_carried_is_found(by, yaw_deg):
    found, truth = carried_from(ASIDE, [*HALL, *CABINETS], by, yaw_deg)
    assert np.linalg.norm(found[:3, 3] - truth[:3, 3]) < 0.02
    assert np.rad2deg(pose.angle_between(found, truth)) < 0.3


def test_none_is_found_where_another_turn_fits_as_well():
    assert carried_from(MIDDLE, HALL, (0.0, 0.0), 30.0)[0] is None


def test_none_is_found_where_nothing_fits():
    odometry, rng = Odometry(), np.random.default_rng(3)
    scene = joined(*HALL)
    odometry.register_frame(frame(scene, placed(ASIDE, 0.0, 0), rng))
    lengths, T = odometry._lengths, np.eye(4)
    search = FrameSearch(odometry._at.world.surface, lengths, odometry.settings, 0.9, [(T, T)])
    noise = downsample_frame(read_frame(rng.uniform(-4, 4, (4_000, 3)), None), lengths)
    assert place_nearby(search, noise) is None
