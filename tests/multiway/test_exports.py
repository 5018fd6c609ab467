import dataclasses
from itertools import combinations

import numpy as np
import pytest

from dqreg.multiway.exports import factors_of, to_pose_graph, to_trajectory
from dqreg.multiway.pose_graph.edges import graph_of
from dqreg.multiway.pose_graph.graph import solve_graph
from dqreg.rigid import pose
from tests.multiway.edges_of_truth import edges_of, world


def used(count: int):
    T = world(count, seed=0)
    edges = edges_of(T, combinations(range(count), 2), 1e-3, seed=1)
    return T, [dataclasses.replace(edge, used=True) for edge in edges]


def test_factors_are_right_increments_in_the_frame_of_the_source() -> None:
    """The chi-square of any pose is the same in both conventions, to first order."""
    _, edges = used(3)
    factors = factors_of(edges, 3)
    for k, edge in enumerate(edges):
        result = edge.registration
        twist = 1e-4 * np.arange(1.0, 7.0)
        moved = pose.about(pose.exp(twist), np.array(result.settings["centre"])) @ result.T_target_source
        right = pose.log(pose.inverse(result.T_target_source) @ moved)
        ours = twist @ np.linalg.solve(result.covariance, twist)
        assert right @ np.linalg.solve(factors.covariances[k], right) == pytest.approx(ours, rel=1e-4)


def test_a_pair_that_all_scans_contradict_is_no_sharp_factor() -> None:
    _, edges = used(3)
    sharp = factors_of(edges, 3).covariances
    wide = factors_of([dataclasses.replace(edges[0], chi2=346.0), dataclasses.replace(edges[1], chi2=9.0), edges[2]], 3)
    np.testing.assert_allclose(wide.covariances[0], 346.0 / 6.0 * sharp[0])
    np.testing.assert_array_equal(wide.covariances[1:], sharp[1:])


def test_gtsam_takes_the_file_as_it_is(tmp_path) -> None:
    gtsam = pytest.importorskip("gtsam")
    T, edges = used(5)
    path = tmp_path / "graph.g2o"
    path.write_text(to_pose_graph(T, edges, 0))
    graph, values = gtsam.readG2o(str(path), True)
    assert (graph.size(), values.size()) == (10, 5)
    # Half of the sum of chi-squares, at the true poses.
    exact = graph_of(edges, 5).chi2(np.concatenate([T, np.eye(4)[None]])).sum()
    assert 2.0 * graph.error(values) == pytest.approx(exact, rel=1e-2)


def test_gtsam_takes_the_factors_as_they_are() -> None:
    """The program of the how-to: factors into a graph, with a prior on the anchor; GTSAM's optimum is ours."""
    gtsam = pytest.importorskip("gtsam")
    T, edges = used(5)
    factors = factors_of(edges, 5)
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, j, measured, C in zip(factors.targets, factors.sources, factors.poses, factors.covariances, strict=True):
        noise = gtsam.noiseModel.Gaussian.Covariance(C)
        graph.add(gtsam.BetweenFactorPose3(int(i), int(j), gtsam.Pose3(measured), noise))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(T[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-9)))
    for k, each in enumerate(T):
        initial.insert(k, gtsam.Pose3(each))
    found = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    ours = solve_graph(graph_of(edges, 5), np.concatenate([T, np.eye(4)[None]]), np.arange(1, 5))
    # Errors are of 1e-3; what the two treat differently is of second order.
    for k in range(5):
        np.testing.assert_allclose(found.atPose3(k).matrix(), ours[k], atol=2e-5)


def test_trajectories_say_which_scans_are_not_placed() -> None:
    T = world(3, seed=0)
    T[1] = np.nan
    kitti = np.array([line.split() for line in to_trajectory(T, "kitti").splitlines()], dtype=float)
    assert np.isnan(kitti).all(axis=1).tolist() == [False, True, False]
    assert [line.split()[0] for line in to_trajectory(T, "tum").splitlines()] == ["0.000000000", "2.000000000"]
