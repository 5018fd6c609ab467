"""Points of a sweep as they would be seen at its end."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Scan
from dqreg.geometry.surface import Closest
from dqreg.icp import Alignment, InlierMixture
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.history import Iteration
from dqreg.odometry import Odometry, deskew
from dqreg.odometry.deskewing import fits_no_worse, sweep_steps
from dqreg.odometry.frame import DownsampledFrame, OwnPlanes, Whole, read_frame
from dqreg.odometry.sweep import swept
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
    # Oracle: KISS-ICP's own preprocessor, with all points in range.
    pytest.importorskip("kiss_icp")
    from dqreg.odometry.kiss import load_kiss

    points, times = RNG.normal(size=(100, 3)) * 5, RNG.uniform(3.0, 4.0, 100)
    compensate = load_kiss("preprocess").get_preprocessor(load_kiss("config").KISSConfig(data={"deskew": True}))
    found = np.array(compensate.preprocess(points, times, MOTION))
    far = np.linalg.norm(points, axis=1) > 0.0
    np.testing.assert_allclose(deskew(points, times, MOTION)[far], found, atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-4, 0.009, 0.011, 0.5, 3.0])
def test_a_sweep_is_moved_along_one_screw(turn):
    # Oracle: a pose for each point.
    points, back = RNG.normal(size=(60, 3)) * 20, RNG.uniform(-1, 0, 60)
    axis = np.array([0.6, -0.64, 0.48])
    step = np.concatenate([turn * axis, [0.9, -0.2, 0.1]])
    T = twist.exp(back[:, None] * step)
    moved = np.einsum("nij,nj->ni", T[:, :3, :3], points)
    np.testing.assert_allclose(swept(points, back, twist.exp(step), directions=True), moved, atol=1e-12)
    np.testing.assert_allclose(swept(points, back, twist.exp(step)), moved + T[:, :3, 3], atol=1e-12)


def test_what_was_seen_early_and_late_tells_the_motion():
    # Law: of points on three planes, skewed by a small motion and placed wrongly, the step and the change are found.
    places = RNG.uniform(-8, 8, (4000, 3))
    normals = np.eye(3)[np.arange(4000) % 3]
    places[normals > 0.0] = 9.0 * RNG.choice([-1.0, 1.0], 4000)
    back, T = RNG.uniform(-1, 0, 4000), twist.exp([0.2, -0.1, 0.7, 3.0, -2.0, 1.0])
    step, change = np.array([1e-4, -2e-4, 3e-4, 2e-3, -1e-3, 2e-3]), np.array([-2e-4, 1e-4, 4e-4, 3e-3, 2e-3, -2e-3])
    # Moved by the step and, by their times, the change they lie on the planes.
    right = pose.apply(pose.inverse(T @ twist.exp(step)), places)
    points = swept(right, -back, twist.exp(change))
    one = np.ones(4000)
    scan = Scan(points, normals @ T[:3, :3], one, 0.01 * one, False, 0.1, 0.01, 4000)
    pairs = Correspondences(scan, T, Closest(places, normals, one, np.arange(4000)), same_sign=False)
    whole = Whole(lambda: (points, back))
    frame = DownsampledFrame(whole, points, back, 14.0, 0.1, OwnPlanes(whole, points))
    aligned = Alignment(T, "converged", (), pairs, one, mixture=InlierMixture(0.1, 0.9, 1.0))
    found = sweep_steps(frame, aligned)
    # What a third of the points tells is believed to three quarters: the rest is left to the next round.
    np.testing.assert_allclose(found[1], change, atol=0.3 * np.abs(change).max())
    np.testing.assert_allclose(found[0], step, atol=0.3 * np.abs(step).max())


@pytest.mark.parametrize(
    ("share", "scale", "is_kept"), [(0.77, 0.187, True), (0.75, 0.169, True), (0.75, 0.187, False), (0.5, 0.169, False)]
)
def test_a_narrower_kernel_may_hold_fewer_points(share: float, scale: float, is_kept: bool) -> None:
    # A bend of 9 mrad undone: the share fell from 0.78 to 0.75, with the kernel's width from 0.187 to 0.169.
    def run(share: float, scale: float) -> Alignment:
        points = np.zeros((100, 3))
        scan = Scan(points, points, np.ones(100), np.ones(100), False, 0.1, 0.01, 100)
        pairs = Correspondences(
            scan, np.eye(4), Closest(points, points, np.zeros(100), np.arange(100)), same_sign=False
        )
        mixture, weights = InlierMixture(scale, share, 1.0), np.full(100, share)
        seen = Iteration(1, "fine", 100, 100, share, 0.1, scale, 0.0, 0.0, 0.0, 0.0, np.eye(4))
        return Alignment(np.eye(4), "converged", (seen,), pairs, weights, mixture=mixture)

    assert fits_no_worse(run(share, scale), run(0.78, 0.187)) == is_kept


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


def test_a_first_frame_with_times_may_be_followed_by_one_without() -> None:
    rng = np.random.default_rng(0)
    walls = rng.uniform(-4, 4, (6000, 3))
    walls[np.arange(6000), np.arange(6000) % 3] = np.sign(walls[np.arange(6000), np.arange(6000) % 3]) * 4
    odometry = Odometry()
    odometry.register_frame(walls, np.linspace(0.0, 0.1, 6000))
    assert odometry.register_frame(walls - [0.05, 0.0, 0.0]).inlier_fraction > 0.8


def test_after_a_gap_a_prediction_deskews_by_the_motion_of_one_sweep(moving, monkeypatch):
    # Truth: 0.3 a frame, six frames on; no more than five are what constant velocity may tell.
    odometry, undone = Odometry(), []
    for k in (0, 1):
        odometry.register_frame(moving.frames[k], moving.times[k], stamp=0.1 * k)
    plain = DownsampledFrame.without
    monkeypatch.setattr(DownsampledFrame, "without", lambda self, motion: plain(self, undone.append(motion) or motion))
    expected = odometry.last_pose @ pose.inverse(moving.truth[1]) @ moving.truth[7]
    odometry.register_frame(moving.frames[7], moving.times[7], stamp=0.7, prediction=expected)
    assert 0.27 < np.linalg.norm(undone[0][:3, 3]) < 0.33


def test_the_time_that_a_pose_is_of_is_that_of_the_last_point_that_was_seen():
    walls = np.random.default_rng(0).uniform(-4, 4, (6000, 3))
    walls[np.arange(6000), np.arange(6000) % 3] = np.sign(walls[np.arange(6000), np.arange(6000) % 3]) * 4
    times, odometry = 5.0 + np.linspace(0.0, 0.1, 6000), Odometry()
    assert odometry.register_frame(walls, times).settings["pose_time"] == times[-1]
    assert odometry.register_frame(walls[:3000], times[:3000]).settings["pose_time"] == times[2999]
    assert "pose_time" not in odometry.register_frame(walls).settings


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (np.float32(1.7e9 + np.linspace(0.0, 0.1, 500)), "float32"),
        # On either side of one step of 128.
        (np.float32(1.7e9 + np.linspace(0.0, 100.0, 500)), "float32"),
        (np.full(500, 0.5), "one time"),
        (1.7e9 + np.linspace(0.0, 0.1, 500), None),
        (np.float32(np.linspace(0.0, 0.1, 500)), None),
    ],
)
def test_times_that_single_precision_cannot_tell_apart_are_said_to_be_such(times, said):
    notes = read_frame(RNG.normal(size=(500, 3)), times).notes
    assert [(note.code, said in note) for note in notes] == ([] if said is None else [("not_deskewed", True)])
