from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("kiss_icp")

from dqreg.errors import InputError
from dqreg.odometry import (
    OdometrySettings,
    bridge_gaps,
    evaluate,
    load_trajectory,
    nees,
    read_trajectory,
    write_trajectory,
)
from dqreg.rigid import Trajectory, pose, twist


def walk(count: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    T = [np.eye(4)]
    for _ in range(count - 1):
        T.append(T[-1] @ twist.exp(rng.normal(scale=[0.1, 0.1, 0.1, 1, 1, 1])))
    return np.stack(T)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**31), st.sampled_from(["kitti", "tum"]))
def test_what_is_written_is_read(tmp_path_factory, seed, form):
    path = tmp_path_factory.mktemp("t") / "a.txt"
    poses, times = walk(5, seed), np.linspace(1.6e9, 1.6e9 + 2, 5)
    write_trajectory(path, poses, times, form)
    read, stamps = read_trajectory(path)
    np.testing.assert_allclose(read, poses, atol=1e-12)
    if form == "tum":
        np.testing.assert_allclose(stamps, times, atol=1e-6)


def test_tum_puts_w_last_and_kitti_is_three_rows(tmp_path):
    T = pose.from_parts([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3])  # a quarter turn about z
    write_trajectory(tmp_path / "a.tum", [T], [7.0])
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.tum"), [7, 1, 2, 3, 0, 0, 0.5**0.5, 0.5**0.5], atol=1e-12)
    assert write_trajectory(tmp_path / "a.txt", [T]) == "kitti"
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.txt"), T[:3].ravel(), atol=1e-15)


def test_frames_whose_times_are_swapped_stand_in_tum_in_the_order_of_their_times(tmp_path):
    poses, times = walk(4), np.array([0.0, 0.2, 0.1, 0.3])
    write_trajectory(tmp_path / "a.tum", poses, times)
    path = load_trajectory(tmp_path / "a.tum")
    np.testing.assert_allclose(path.times, np.sort(times), atol=1e-9)
    np.testing.assert_allclose(path.poses, poses[[0, 2, 1, 3]], atol=1e-12)


def test_gaps_are_bridged_by_one_screw_and_left_out_of_tum(tmp_path):
    step = twist.exp([0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    poses = np.stack([np.linalg.matrix_power(step, i) for i in range(5)])
    holes = poses.copy()
    holes[[1, 2]] = np.nan
    bridged, rows = bridge_gaps(holes)
    np.testing.assert_allclose(bridged, poses, atol=1e-12)
    assert rows.tolist() == [1, 2]
    write_trajectory(tmp_path / "a.tum", holes)
    assert np.loadtxt(tmp_path / "a.tum")[:, 0].tolist() == [0, 3, 4]
    holes[[0, 4]] = np.nan
    np.testing.assert_array_equal(bridge_gaps(holes)[0], np.stack([poses[3]] * 5))
    with pytest.raises(InputError, match="none of the 2 frames"):
        bridge_gaps(np.full((2, 4, 4), np.nan))


def test_shapes_that_do_not_belong_together_are_named():
    path, covariances = np.stack([np.eye(4)] * 3), np.stack([np.eye(6)] * 3)
    with pytest.raises(InputError, match=r"poses must be \(n, 4, 4\).* got the shape \(3,\)"):
        bridge_gaps(np.ones(3))
    for wrong in ((path[0], covariances, path), (path, covariances, path[:2]), (path, covariances[:2], path)):
        with pytest.raises(InputError, match="one of each a frame; got"):
            nees(*wrong)
    with pytest.raises(InputError, match="a frame without points"):
        OdometrySettings().resolve(np.zeros((0, 3)))


@pytest.mark.parametrize("text", ["", "1 2 3\n", "a b\n", "1 " * 12 + "\n", "nan " * 12 + "\n", "0 " * 8 + "\n"])
def test_what_is_no_trajectory_is_refused(tmp_path, text):
    (tmp_path / "bad.txt").write_text(text)
    with pytest.raises(InputError, match=r"bad\.txt"):
        read_trajectory(tmp_path / "bad.txt")


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_errors_do_not_depend_on_the_frame_of_either_side(seed):
    rng = np.random.default_rng(seed)
    truth = walk(15, seed)
    poses = truth @ twist.exp(rng.normal(scale=0.01, size=(15, 6)))
    moved = evaluate(pose.random(rng, reach=5.0) @ poses, pose.random(rng, reach=5.0) @ truth)
    plain = evaluate(poses, truth)
    for step in (1, 10):
        for a, b in zip(moved.steps[step], plain.steps[step], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-7)
    # KISS-ICP's own metric aligns as well: an oracle for ours.
    assert plain.absolute_rmse == pytest.approx(plain.kiss_ate[1], rel=1e-6)
    assert moved.absolute_rmse == pytest.approx(plain.absolute_rmse, rel=1e-6)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31), st.sampled_from(["kitti", "tum"]))
def test_evo_reads_what_is_written_and_finds_the_same_errors(tmp_path_factory, seed, form):
    metrics, files = (pytest.importorskip(f"evo.{name}") for name in ("core.metrics", "tools.file_interface"))
    rng = np.random.default_rng(seed)
    folder, truth, times = tmp_path_factory.mktemp("t"), walk(15, seed), np.linspace(1.6e9, 1.6e9 + 7, 15)
    poses = pose.random(rng, reach=5.0) @ truth @ twist.exp(rng.normal(scale=0.01, size=(15, 6)))
    for name, rows in (("ours", poses), ("truth", truth)):
        write_trajectory(folder / name, rows, times, form)
    read = files.read_kitti_poses_file if form == "kitti" else files.read_tum_trajectory_file
    theirs, reference = (read(str(folder / name)) for name in ("ours", "truth"))
    np.testing.assert_allclose(theirs.poses_se3, poses, atol=1e-12)
    assert form == "kitti" or np.abs(theirs.timestamps - times).max() < 1e-6
    errors = evaluate(poses, truth)
    for relation, which in ((metrics.PoseRelation.rotation_angle_deg, 0), (metrics.PoseRelation.translation_part, 1)):
        for step in (1, 10):
            rpe = metrics.RPE(relation, delta=step, delta_unit=metrics.Unit.frames, all_pairs=True)
            rpe.process_data((reference, theirs))
            np.testing.assert_allclose(rpe.error, errors.steps[step][which], atol=1e-7)
    theirs.align(reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, theirs))
    assert errors.absolute_rmse == pytest.approx(ape.get_statistic(metrics.StatisticsType.rmse), rel=1e-9)


def test_a_straight_path_has_an_error_where_the_alignment_is_not_unique():
    truth = np.stack([pose.from_parts(np.eye(3), [0.2 * i, 0.0, 0.0]) for i in range(12)])
    poses = truth.copy()
    poses[::2, 1, 3] += 0.02
    # Half of the places lie 0.01 to either side of the line through their middle.
    errors = evaluate(poses, truth)
    assert errors.absolute_rmse == pytest.approx(0.01, rel=0.02)
    with pytest.warns(DeprecationWarning, match="absolute_rmse"):
        assert errors.evo_ape_rmse == errors.absolute_rmse


def test_g2o_holds_the_placed_frames_and_the_weight_of_each_step(tmp_path):
    poses = walk(5)
    poses[2] = np.nan
    covariances = np.tile(np.diag([1.0, 4.0, 9.0, 16.0, 25.0, 36.0]), (5, 1, 1))
    assert write_trajectory(tmp_path / "a.g2o", poses, covariances=covariances) == "g2o"
    lines = [line.split() for line in (tmp_path / "a.g2o").read_text().splitlines()]
    assert [line[1] for line in lines if line[0] == "VERTEX_SE3:QUAT"] == ["0", "1", "3", "4"]
    edges = [line for line in lines if line[0] == "EDGE_SE3:QUAT"]
    assert [line[1:3] for line in edges] == [["0", "1"], ["1", "3"], ["3", "4"]]
    information = np.zeros((6, 6))
    information[np.triu_indices(6)] = np.array(edges[-1][10:], dtype=float)
    information += np.triu(information, 1).T
    # By hand: translation first, in the axes of the sensor.
    R = poses[4, :3, :3]
    np.testing.assert_allclose(information[:3, :3], R.T @ np.diag(1.0 / np.array([16.0, 25.0, 36.0])) @ R, atol=1e-12)
    gtsam = pytest.importorskip("gtsam")
    graph, values = gtsam.readG2o(str(tmp_path / "a.g2o"), True)
    assert (graph.size(), values.size()) == (3, 4)
    with pytest.raises(InputError, match="one a frame"):
        write_trajectory(tmp_path / "a.g2o", poses, covariances=covariances[:3])


def test_lost_frames_are_counted():
    truth = walk(12)
    poses = truth.copy()
    poses[4] = np.nan
    poses[8:] = poses[8:] @ twist.exp([0, 0, 0.5, 0, 0, 0])
    assert evaluate(truth, truth).lost == 0
    assert evaluate(poses, truth).lost >= 2


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**31))
def test_nees_of_errors_drawn_from_the_covariances_is_chi_square(seed):
    rng = np.random.default_rng(seed)
    truth = pose.random(rng, reach=3.0) @ walk(200, seed)
    spread = rng.normal(size=(200, 6, 6)) * [0.01, 0.01, 0.01, 0.05, 0.05, 0.05]
    covariances = spread.transpose(0, 2, 1) @ spread
    draws = np.einsum("nji,nj->ni", spread, rng.normal(size=(200, 6)))
    # Left increments about the sensor, in the map's axes: the covariance's own meaning.
    poses = np.stack([pose.about(twist.exp(-d), T[:3, 3]) @ T for d, T in zip(draws, truth, strict=True)])
    values = nees(poses, covariances, np.linalg.inv(truth[0]) @ truth)
    # Five standard deviations of the mean of 200 values, each of variance 12: one seed in a million.
    assert abs(values.mean() - 6.0) < 5.0 * np.sqrt(12.0 / 200.0)
    assert np.mean((values > 1.2373) & (values < 14.4494)) > 0.85


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**31))
def test_nees_allows_for_steps_of_a_truth_that_are_known_so_well(seed):
    rng, sigma_deg, sigma = np.random.default_rng(seed), 0.5, 0.03
    poses = walk(200, seed)
    noise = np.r_[[np.deg2rad(sigma_deg)] * 3, [sigma] * 3]
    steps = pose.inverse(poses[:-1]) @ poses[1:] @ twist.exp(noise * rng.normal(size=(199, 6)))
    truth = [np.eye(4)]
    for step in steps:
        truth.append(truth[-1] @ step)
    # All of the error is the truth's; the poses are known a thousand times better.
    covariances = np.broadcast_to(1e-6 * np.diag(noise**2), (200, 6, 6))
    values = nees(poses, covariances, np.stack(truth), sigma_deg, sigma)
    assert abs(values.mean() - 6.0) < 5.0 * np.sqrt(12.0 / 199.0)


@pytest.mark.parametrize("name", ["a.tum", "b.txt"])
def test_a_trajectory_there_and_back_through_a_file(tmp_path, name):
    times = np.array([0.5, 1.0, 2.5])
    path = Trajectory(times, twist.exp(times[:, None] * [0.1, -0.2, 0.3, 1.0, 2.0, 3.0]))
    form = write_trajectory(tmp_path / name, path)
    back = load_trajectory(tmp_path / name)
    np.testing.assert_allclose(back.poses, path.poses, atol=1e-14)
    np.testing.assert_array_equal(back.times, times if form == "tum" else np.arange(3))


def test_a_file_whose_times_go_back_is_named(tmp_path):
    (tmp_path / "a.tum").write_text("1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"a\.tum: times must increase"):
        load_trajectory(tmp_path / "a.tum")
