"""Motion by wheels and gyroscopes: topics of a bag become predictions for the frames."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("kiss_icp")
pytest.importorskip("rosbags", reason="pip install 'dqreg[ros]'")

from dqreg.errors import InputError
from dqreg.odometry.motion import Gyroscope, MotionGuide, MotionPrior, Wheels
from dqreg.odometry.motion_topics import open_motion
from dqreg.odometry.scans import open_scans
from dqreg.odometry.trajectory import read_trajectory
from dqreg.rigid import Trajectory, pose, quaternion, twist
from tests.cli.command import run
from tests.odometry.bag_files import cloud_message, write_bag
from tests.odometry.motion_files import Messages
from tests.odometry.test_online import corridor

START = 1_763_800_000.0
# Where the sensor sits on its base: before the axle, above it, turned.
X = twist.exp([0.1, -0.2, 0.7, 0.4, 0.1, 0.9])


class Answer:
    """What the guide asks of a result."""

    def __init__(self, T):
        self.T_target_source, self.settings = T, {"reach": 0.5, "voxel_size": 0.5}


def guided(prior, truth, stamps):
    guide = MotionGuide(prior)
    for T, stamp in zip(truth, stamps, strict=True):
        yield guide.options(stamp)
        guide.learn(Answer(T), T, stamp)


def test_a_gyroscope_is_followed_to_the_error_of_its_order():
    times = np.linspace(0.0, 1.0, 201)
    rates = np.column_stack([np.sin(5 * times), np.cos(3 * times), 2.0 * times])
    followed = quaternion.integrate([1, 0, 0, 0], rates, times, frame="body")
    found = Gyroscope(times, rates).between(times[30], times[170])
    expected = quaternion.to_matrix(quaternion.multiply(quaternion.conjugate(followed[30]), followed[170]))
    # The trapezoid's error and that of the order of turns: h^2 / 12 times the integrals of |w''| and |w x w'|.
    slopes = np.gradient(rates, times, axis=0)
    bends = np.gradient(slopes, times, axis=0)
    size = np.linalg.norm(bends, axis=1) + np.linalg.norm(np.cross(rates, slopes), axis=1)
    bound = (times[1] - times[0]) ** 2 / 12.0 * np.trapezoid(size[30:171], times[30:171])
    angle = np.linalg.norm(twist.log(pose.from_parts(expected.T @ found[:3, :3], np.zeros(3)))[:3])
    assert 0.0 < angle < bound
    # A constant velocity is exact, between samples too.
    steady = Gyroscope(times, np.tile([0.0, 0.0, 1.5], (201, 1))).between(0.1234, 0.4567)
    np.testing.assert_allclose(twist.log(steady)[:3], [0.0, 0.0, 1.5 * 0.3333], atol=1e-12)


def test_wheels_predict_the_sensor_whose_base_turns_below_it():
    # Law: T_odom_base X is the sensor's pose, so the prediction is the truth, whatever the lever.
    stamps = np.arange(5.0)
    base = twist.exp(np.outer(np.arange(9) / 2, [0.02, 0.01, 0.3, 0.5, 0.1, 0.0]))
    prior = MotionPrior(Wheels(Trajectory(np.arange(9) / 2, base), np.zeros((9, 6))), X, "")
    truth = base[::2] @ X
    told = list(guided(prior, truth, stamps))
    assert told[0] == {}
    for T, options in zip(truth[1:], told[1:], strict=True):
        np.testing.assert_allclose(options["prediction"], T, atol=1e-12)
        C = options["prediction_covariance"]
        assert np.linalg.eigvalsh(C)[0] > 0.0
        # A turn of the base that is wrong moves the sensor before it.
        assert np.trace(C[3:, 3:]) > 3 * (0.1 * 0.5) ** 2


def test_a_gyroscope_predicts_the_turn_and_constant_velocity_the_place():
    times, stamps = np.linspace(0.0, 3.0, 301), np.arange(4.0)
    rates = np.tile([0.0, 0.3, 0.0], (301, 1))
    prior = MotionPrior(Gyroscope(times, rates @ X[:3, :3].T), X, "")
    truth = np.array([twist.exp([0, 0.3 * t, 0, 0, 0, 0]) for t in stamps])
    truth[1:, :3, 3] = [[1, 0, 0], [2, 0, 0], [3, 0, 0]]
    told = list(guided(prior, truth, stamps))
    for number in (1, 2, 3):
        np.testing.assert_allclose(told[number]["prediction"][:3, :3], truth[number][:3, :3], atol=1e-9)
        # Beyond the reach of closest points, so that it never holds a place.
        assert np.linalg.eigvalsh(told[number]["prediction_covariance"][3:, 3:])[0] > 1.0
    np.testing.assert_allclose(np.linalg.norm(told[2]["prediction"][:3, 3] - truth[1][:3, 3]), 1.0, atol=1e-9)


def test_nothing_is_predicted_while_the_topic_is_silent():
    times = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)])
    prior = MotionPrior(Gyroscope(times, np.zeros((len(times), 3))), np.eye(4), "")
    assert prior.usable(np.array([-0.5, 0.5, 0.9, 1.5, 2.5, 2.9, 3.5])).tolist() == [0, 1, 0, 0, 1, 0]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A corridor that shows no way along it, wheels, a gyroscope at rest, and where they sit."""
    rng, made, rows = np.random.default_rng(0), Messages("mcap"), {}
    path = tmp_path_factory.mktemp("bag") / "a"
    moments = np.arange(-1, 46) / 50
    rows["/points"] = [
        (START + 0.2 * k, cloud_message(corridor(0.3 * k, rng), None, START + 0.2 * k)) for k in range(5)
    ]
    along = [pose.from_parts(np.eye(3), [1.5 * t, 0, 0]) @ pose.inverse(X) for t in moments]
    rows["/odom"] = [(START + t, made.wheels(T, START + t)) for t, T in zip(moments, along, strict=True)]
    rows["/imu"] = [(START + t, made.imu(np.zeros(3), START + t)) for t in moments]
    rows["/late"] = [(START + t, made.wheels(T, START + t + 500)) for t, T in zip(moments, along, strict=True)]
    rows["/none"] = [(START + t, made.imu(np.zeros(3), START + t, measured=-1.0)) for t in moments]
    half = twist.exp(0.5 * twist.log(X))
    rows["/tf_static"] = [
        (START, made.fixed("base", "mast", half)),
        (START, made.fixed("lidar", "/mast", pose.inverse(half))),
    ]
    return write_bag(path, "mcap", rows)


def test_a_corridor_is_followed_with_the_topic_of_the_wheels(bag, tmp_path, capsys):
    # Truth: 0.3 a frame, as the wheels say; without them nothing tells that the sensor moves along the corridor.
    out, truth = tmp_path / "a.tum", np.outer(np.arange(5), [0.3, 0, 0])
    assert run("odometry", bag, "--motion", "/odom", "--out", out) == 0
    assert "nav_msgs/Odometry, 47 messages); base to lidar by /tf_static" in " ".join(capsys.readouterr().out.split())
    np.testing.assert_allclose(read_trajectory(out)[0][:, :3, 3], truth, atol=0.05)
    assert run("odometry", bag, "--out", out) == 1
    assert np.abs(read_trajectory(out)[0][-1, 0, 3] - truth[-1, 0]) > 0.2


def test_a_gyroscope_holds_no_place(bag, capsys):
    assert run("odometry", bag, "--motion", "/imu") == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "no /tf_static from imu to lidar: taken to coincide" in told


def test_what_tells_no_motion_is_named(bag, tmp_path):
    scans = open_scans(bag)
    with pytest.raises(
        InputError, match=r"did you mean /odom\?; usable are .*/odom \(nav_msgs/Odometry, 47 messages\)"
    ):
        open_motion(bag, "/odm", scans)
    with pytest.raises(InputError, match=r"--motion /points is no topic of"):
        open_motion(bag, "/points", scans)
    with pytest.raises(InputError, match="their clocks must agree"):
        open_motion(bag, "/late", scans)
    with pytest.raises(InputError, match="0 usable of 47 messages"):
        open_motion(bag, "/none", scans)
    with pytest.raises(InputError, match="names a topic of a bag"):
        open_motion(tmp_path, "/odom", scans)
    assert run("odometry", bag, "--motion", "/odom", "--engine", "kiss-icp") == 2
