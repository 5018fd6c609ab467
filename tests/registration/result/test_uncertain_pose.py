from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.rigid.twist import TRANSLATION_FIRST
from dqreg.trust.covariance import covariance_of, observe_directions, partial_information_of
from dqreg.trust.information import Information
from tests.registration.result.test_result import failed, good

CENTRE = np.array([3.0, -2.0, 5.0])
SAMPLES = 20_000


def covariance(scale: float = 1e-3) -> np.ndarray:
    """Small enough that remainders of second order are a thousandth; rotations and translations depend."""
    root = scale * np.random.default_rng(0).normal(size=(6, 6))
    return root @ root.T + scale**2 * np.eye(6)


def result(T: np.ndarray | None = None, **changes: Any) -> Registration:
    T = pose.exp([0.4, -0.7, 0.2, 1.0, 2.0, -3.0]) if T is None else T
    return dataclasses.replace(good(T, centre=CENTRE), **{"covariance": covariance(), **changes})


def drawn(of: Registration) -> np.ndarray:
    """Poses drawn from the covariance as its documentation defines it: about(exp(x), centre) @ T."""
    rng = np.random.default_rng(1)
    x = rng.multivariate_normal(np.zeros(6), of.covariance, size=SAMPLES)
    return pose.about(pose.exp(x), CENTRE) @ of.T_target_source


def assert_covariance(samples: np.ndarray, expected: np.ndarray) -> None:
    """Sample covariance against the expected one, whitened: each number is off by about 1/sqrt(SAMPLES)."""
    root = np.linalg.inv(np.linalg.cholesky(expected))
    np.testing.assert_allclose(root @ np.cov(samples.T) @ root.T, np.eye(6), atol=6.0 / np.sqrt(SAMPLES))


def test_gtsam_reads_it_as_it_is() -> None:
    """Monte-Carlo with GTSAM's own difference of poses; and its own factor finds six on average."""
    gtsam = pytest.importorskip("gtsam")
    found = result()
    C = found.covariance_in("source")
    mean = gtsam.Pose3(found.T_target_source)
    poses_drawn = [gtsam.Pose3(T) for T in drawn(found)[:4000]]
    samples = np.array([mean.localCoordinates(T) for T in poses_drawn])
    root = np.linalg.inv(np.linalg.cholesky(C))
    np.testing.assert_allclose(root @ np.cov(samples.T) @ root.T, np.eye(6), atol=6.0 / np.sqrt(4000))
    factor = gtsam.BetweenFactorPose3(0, 1, mean, gtsam.noiseModel.Gaussian.Covariance(C))
    values, errors = gtsam.Values(), []
    values.insert(0, gtsam.Pose3())
    values.insert(1, mean)
    for T in poses_drawn:
        values.update(1, T)
        errors.append(2.0 * factor.error(values))
    assert np.mean(errors) == pytest.approx(6.0, rel=6 * np.sqrt(2 / 6) / np.sqrt(len(errors)))


def test_ros_means_the_place_of_the_child_and_rotations_about_the_axes_of_the_parent() -> None:
    found = result()
    T = drawn(found)
    R = T[:, :3, :3] @ found.T_target_source[:3, :3].T
    turns = pose.log(pose.from_parts(R, np.zeros(3)))[:, :3]
    samples = np.hstack([T[:, :3, 3] - found.T_target_source[:3, 3], turns])
    assert_covariance(samples, found.covariance_in("source", order="tr", side="left"))


def test_g2o_means_translation_first_and_half_angles() -> None:
    """g2o's error of EdgeSE3 is that of toVectorMQT: translation and vector of the quaternion of inv(T) T_true."""
    found = result()
    step = pose.inverse(found.T_target_source) @ drawn(found)
    halves = 0.5 * pose.log(pose.from_parts(step[:, :3, :3], np.zeros(3)))[:, :3]
    half = np.r_[[1.0] * 3, [0.5] * 3]
    expected = found.covariance_in("source", order="tr") * half[:, None] * half
    assert_covariance(np.hstack([step[:, :3, 3], halves]), expected)


def test_open3ds_pose_graph_weighs_as_we_mean() -> None:
    """Two edges that disagree: its optimum is the mean that their informations ask for, and not that of other sides."""
    registration = load_open3d().pipelines.registration
    first = result()
    x = np.array([2e-4, -1e-4, 1e-4, 3e-4, 1e-4, -2e-4])  # remainders of second order: 0.6 % of this
    second = result(first.T_target_source @ pose.exp(x), covariance=np.diag([0.5, 1, 4, 9, 0.3, 1]) * 1e-6)
    graph = registration.PoseGraph()
    graph.nodes.append(registration.PoseGraphNode(np.eye(4)))  # the target
    graph.nodes.append(registration.PoseGraphNode(first.T_target_source))
    for each in (first, second):
        graph.edges.append(registration.PoseGraphEdge(1, 0, each.T_target_source, each.information_in("source"), False))
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(reference_node=0),
    )
    theirs = pose.inverse(graph.nodes[0].pose) @ graph.nodes[1].pose

    def mean_by(side: str) -> np.ndarray:
        a, b = (each.information_in("source", side=side) for each in (first, second))
        return first.T_target_source @ pose.exp(np.linalg.solve(a + b, b @ x))

    assert pose.offset_between(theirs, mean_by("right")) < 0.01 * np.linalg.norm(x)
    assert pose.offset_between(theirs, mean_by("left")) > 0.1 * np.linalg.norm(x)


@pytest.mark.parametrize(
    "twist", [np.zeros(6), [0.4, -0.7, 0.2, 1, 2, -3], [0, 0, np.pi, 50, 0, 0], [2, 1, 0, 0, -9, 4]]
)
def test_each_convention_is_the_other_seen_from_elsewhere(twist: Any) -> None:
    """A left increment about the target's origin is a right one about the source's by the pose's adjoint, and so on."""
    T = pose.exp(twist)
    found = result(T)
    left, right = found.covariance_in("target"), found.covariance_in("source")
    A = pose.adjoint(T)
    np.testing.assert_allclose(A @ right @ A.T, left, atol=1e-12 * np.abs(left).max())
    np.testing.assert_allclose(found.covariance_in("centre"), found.covariance, atol=1e-18)
    swapped = found.covariance_in("source", order="tr")
    np.testing.assert_array_equal(swapped, right[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)])
    np.testing.assert_allclose(found.information_in("source") @ right, np.eye(6), atol=1e-7)
    np.testing.assert_allclose(found.information @ found.covariance, np.eye(6), atol=1e-10)


def free_along(twists: np.ndarray, T: np.ndarray) -> tuple[Registration, np.ndarray]:
    """A result whose information leaves some twists about the centre free, and that information."""
    rng = np.random.default_rng(4)
    basis = np.linalg.qr(np.hstack([twists, rng.normal(size=(6, 6 - twists.shape[1]))]))[0]
    values = np.r_[np.zeros(twists.shape[1]), rng.uniform(0.1, 1.0, 6 - twists.shape[1])]
    known = Information(values, basis, 1000.0, 0.01, 1.0, CENTRE)
    found = result(
        T,
        covariance=covariance_of(known),
        observability=observe_directions(known),
        partial_information=partial_information_of(known),
    )
    return found, (basis * values) @ basis.T * 1000.0 / 0.01**2


def test_a_free_motion_has_no_information_and_no_covariance_in_any_frame() -> None:
    """A pin that stands askew: it turns about its axis. What is held is known exactly from everywhere."""
    axis, T = np.array([0.6, 0.0, 0.8]), pose.exp([0.4, -0.7, 0.2, 1.0, 2.0, -3.0])
    found, exact = free_along(np.r_[axis, np.zeros(3)][:, None], T)
    np.testing.assert_allclose(found.information, exact, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.information @ np.r_[axis, np.zeros(3)], 0.0, atol=1e-3)
    along_x = pose.exp([0.0, np.arctan2(0.6, 0.8), 0.0, 0.0, 0.0, 0.0])  # its z is the axis
    placed, _ = free_along(np.r_[axis, np.zeros(3)][:, None], along_x)
    there = placed.covariance_in("centre", side="right")
    # Along the source's own axes only its z is free: five rows have numbers, and they are those of the exact inverse.
    assert np.isnan(np.diag(there)).tolist() == [False, False, True, False, False, False]
    J = pose.adjoint(pose.inverse(pose.from_parts(along_x[:3, :3], np.zeros(3))))
    held = [0, 1, 3, 4, 5]
    tight = np.linalg.inv(J @ np.linalg.inv(exact + np.outer(v := np.r_[axis, np.zeros(3)], v)) @ J.T)
    expected = np.linalg.inv(tight[np.ix_(held, held)])
    np.testing.assert_allclose(there[np.ix_(held, held)], expected, rtol=1e-6, atol=1e-15)
    # In the frame of the covariance it is the covariance, rows of NaN included.
    np.testing.assert_allclose(found.covariance_in("centre"), found.covariance, rtol=1e-9, atol=1e-15)


def test_a_file_of_old_says_what_its_covariance_does() -> None:
    root = covariance()
    root[2] = root[:, 2] = np.nan
    found = result(covariance=root)
    held = [0, 1, 3, 4, 5]
    np.testing.assert_allclose(
        found.information[np.ix_(held, held)], np.linalg.inv(root[np.ix_(held, held)]), rtol=1e-6
    )
    assert not found.information[2].any()
    assert np.isnan(found.covariance_in("source")).any()


def test_what_cannot_be_answered_is_said() -> None:
    for name in ("covariance_in", "information_in"):
        with pytest.raises(InputError, match="found no pose"):
            getattr(failed(), name)("source")
        with pytest.raises(InputError, match='"source", "target" or "centre"; got \'world\''):
            getattr(result(), name)("world")
        with pytest.raises(InputError, match='"rt"'):
            getattr(result(), name)("source", order="rx")
        with pytest.raises(InputError, match='"left"'):
            getattr(result(), name)("source", side="up")
    locked = np.diag([1e-6, 1e-6, 0.0, 1e-6, 1e-6, 1e-6])
    with pytest.raises(InputError, match="known exactly"):
        _ = result(covariance=locked).information
    assert result(covariance=locked).covariance_in("target").shape == (6, 6)


def test_rows_that_are_not_finite_stay_in_their_places_as_nan() -> None:
    """An organised cloud, as `register` takes it; what stands in the other rows is what its other points become."""
    points = np.random.default_rng(0).normal(size=(40, 3))
    expected = result().apply(points)
    bad = {3: [np.nan] * 3, 7: [1.0, np.nan, 2.0], 8: [np.inf] * 3, 11: [0.0, 1.0, -np.inf]}
    for row, values in bad.items():
        points[row], expected[row] = values, np.nan
    np.testing.assert_array_equal(result().apply(points), expected)
    np.testing.assert_array_equal(result().apply(np.full((2, 3), np.nan)), np.full((2, 3), np.nan))
    assert result().apply(np.zeros((0, 3))).shape == (0, 3)
    # Some drivers hand out the image.
    np.testing.assert_array_equal(result().apply(points.reshape(5, 8, 3)), expected.reshape(5, 8, 3))


def test_one_point_is_moved_as_by_its_pose() -> None:
    found = result()
    moved = found.apply([1, 2, 3])
    np.testing.assert_array_equal(moved, pose.apply(found.T_target_source, [1, 2, 3]))
    assert moved.shape == (3,)
    for strange in (5.0, [1.0, 2.0], np.zeros((4, 2)), np.zeros((3, 9))):
        with pytest.raises(InputError, match=r"points must have shape \(n, 3\)"):
            found.apply(strange)
