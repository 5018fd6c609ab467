"""Points of a sweep as they would be seen at its end."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.odometry import deskew
from dqreg.rigid import Trajectory, pose, twist

RNG = np.random.default_rng(0)
MOTION = twist.exp([0.1, -0.2, 0.4, 1.0, 0.3, -0.2])


def seen(places, T):
    """Places of the world in the sensor's frame at poses T, (n, 4, 4)."""
    return np.einsum("nij,nj->ni", pose.inverse(T)[:, :3, :3], places - T[:, :3, 3])


def test_a_sweep_becomes_what_the_sensor_sees_at_its_end():
    # Law: places that stand still are those of the last pose, by the screw that the sensor moved along.
    places, times = RNG.normal(size=(200, 3)) * 10, RNG.permutation(200).astype(float)
    start = twist.exp([0.3, 0.1, -0.5, 4.0, 5.0, 6.0])
    T = start @ twist.exp(times[:, None] / 199.0 * twist.log(MOTION))
    expected = seen(places, np.broadcast_to(start @ MOTION, T.shape))
    # Any unit and offset of the times.
    np.testing.assert_allclose(deskew(seen(places, T), 1e6 + 0.5 * times, MOTION), expected, atol=1e-8)


def test_a_trajectory_tells_the_motion_where_it_is_no_screw():
    knots = np.linspace(0.0, 1.0, 6)
    path = Trajectory(knots, twist.exp(RNG.normal(0, 0.3, (6, 6))))
    places, times = RNG.normal(size=(50, 3)) * 10, RNG.uniform(0.2, 0.9, 50)
    expected = seen(places, np.broadcast_to(path.at(times.max()), (50, 4, 4)))
    np.testing.assert_allclose(deskew(seen(places, path.at(times)), times, path), expected, atol=1e-9)
    with pytest.raises(InputError, match="times"):
        deskew(places, times + 1.0, path)


def test_it_is_the_motion_compensation_of_kiss_icp():
    # Oracle: the preprocessor that the odometry uses, with all points in range.
    pytest.importorskip("kiss_icp")
    from dqreg.odometry.kiss import KissParts
    from dqreg.odometry.settings import OdometrySettings

    points, times = RNG.normal(size=(100, 3)) * 5, RNG.uniform(3.0, 4.0, 100)
    kiss = KissParts(OdometrySettings(max_range=100.0, voxel_size=1.0).resolve(points))
    np.testing.assert_allclose(deskew(points, times, MOTION), kiss.compensate(points, times, MOTION), atol=1e-9)


def test_rows_keep_their_places():
    points = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]])
    np.testing.assert_array_equal(deskew(points, [5.0, 5.0], MOTION)[0], points[0])
    assert np.isnan(deskew(points, [0.0, 1.0], MOTION)[1]).all()
    assert deskew(np.zeros((0, 3)), np.zeros(0), MOTION).shape == (0, 3)


@pytest.mark.parametrize(
    ("points", "times", "motion", "said"),
    [
        (np.zeros((2, 3)), [0.0], np.eye(4), "one a point"),
        (np.zeros((2, 2)), [0.0, 1.0], np.eye(4), r"\(n, 3\)"),
        (np.zeros((2, 3)), [0.0, np.nan], np.eye(4), "times"),
        (np.zeros((2, 3)), [0.0, 1.0], np.zeros((4, 4)), "motion"),
    ],
)
def test_what_is_no_sweep_is_refused(points, times, motion, said):
    with pytest.raises(InputError, match=said):
        deskew(points, times, motion)
