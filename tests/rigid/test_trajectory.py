from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.errors import InputError
from dqreg.rigid import DualQuaternion, Trajectory, pose

TIMES = np.array([0.0, 0.5, 0.8, 2.0, 2.3, 4.0])
METHODS = ["screw", "cubic"]


def smooth(t):
    """A motion without any symmetry, and more than half a turn long."""
    t = np.asarray(t, dtype=float)
    twist = [np.sin(t), 0.5 * t, 0.3 * np.cos(2 * t), t * t / 3, np.sin(3 * t), -t]
    return pose.exp(np.stack(np.broadcast_arrays(*twist), axis=-1))


def body_velocity(at, t, h=1e-5):
    """Central difference of the motion, in the body's frame."""
    return pose.log(pose.inverse(at(t - h)) @ at(t + h)) / (2 * h)


@pytest.fixture
def path():
    return Trajectory(TIMES, smooth(TIMES))


@pytest.mark.parametrize("method", METHODS)
def test_it_passes_through_its_poses(path, method):
    np.testing.assert_allclose(path.at(TIMES, method=method), path.poses, atol=1e-13)
    assert path.at(1.0, method=method).shape == (4, 4)
    assert path.at([[1.0, 2.0, 3.0]], method=method).shape == (1, 3, 4, 4)


def test_a_screw_between_two_poses_is_sclerp(path):
    a, b = (DualQuaternion.from_matrix(T) for T in path.poses[2:4])
    np.testing.assert_allclose(path.at(0.8 + 0.3 * 1.2), a.sclerp(b, 0.3).as_matrix(), atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_velocities_are_the_derivative(path, method):
    for t in (0.2, 0.7, 1.1, 3.0):
        there = path.velocities(t, method=method)
        np.testing.assert_allclose(there, body_velocity(lambda s: path.at(s, method=method), t), atol=1e-8)
        world = pose.adjoint(path.at(t, method=method)) @ there
        np.testing.assert_allclose(path.velocities(t, frame="world", method=method), world, atol=1e-12)
        h = 1e-6  # T(t + h) = exp(h x) T(t)
        ahead = pose.exp(h * world) @ path.at(t, method=method)
        np.testing.assert_allclose(path.at(t + h, method=method), ahead, atol=1e-9)
    assert path.velocities().shape == (6, 6)


def test_the_velocity_of_the_cubic_has_no_jumps_and_that_of_the_screws_has(path):
    before, after = (TIMES[1:-1] + side * 1e-9 for side in (-1, 1))
    jump = {m: path.velocities(after, method=m) - path.velocities(before, method=m) for m in METHODS}
    np.testing.assert_allclose(jump["cubic"], 0, atol=1e-6)
    assert np.abs(jump["screw"]).max() > 0.1


@pytest.mark.parametrize(("method", "order"), [("screw", 2), ("cubic", 3)])
def test_order_of_convergence(method, order):
    # The error halfway between poses of a smooth motion falls by 2^order or more where they are twice as dense.
    def error(count):
        knots = np.linspace(0, 4, count)
        t = knots[:-1] + 0.5 * np.diff(knots)
        there = Trajectory(knots, smooth(knots)).at(t, method=method)
        return np.abs(pose.log(pose.inverse(smooth(t)) @ there)).max()

    assert np.log2(error(65) / error(129)) > order - 0.25


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_velocity_is_kept(method):
    twist = np.array([0.3, -0.2, 0.1, 1.0, 2.0, -0.5])
    path = Trajectory(TIMES, pose.exp(TIMES[:, None] * twist))
    t = np.linspace(0, 4, 23)
    np.testing.assert_allclose(path.at(t, method=method), pose.exp(t[:, None] * twist), atol=1e-12)
    np.testing.assert_allclose(path.velocities(t, method=method), np.tile(twist, (23, 1)), atol=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_the_curve_does_not_depend_on_the_world_frame(path, method):
    T = pose.random(np.random.default_rng(0), reach=3)
    moved, t = path.moved(T), np.linspace(0, 4, 9)
    np.testing.assert_allclose(moved.at(t, method=method), T @ path.at(t, method=method), atol=1e-12)
    np.testing.assert_allclose(moved.relative(2), path.relative(2), atol=1e-13)
    np.testing.assert_allclose(moved.velocities(t, method=method), path.velocities(t, method=method), atol=1e-11)


def test_relative_length_and_resampling(path):
    np.testing.assert_allclose(path.poses[:-2] @ path.relative(2), path.poses[2:], atol=1e-13)
    straight = Trajectory([0, 1, 2], pose.exp([[0] * 6, [0, 0, 0, 3, 4, 0], [0, 0, 0, 3, 4, 12]]))
    assert straight.length == pytest.approx(17)
    dense = path.resample(np.linspace(0, 4, 33), method="cubic")
    assert len(dense) == 33
    np.testing.assert_array_equal(dense.at(0.125), path.at(0.125, method="cubic"))
    alone = Trajectory([7.0], np.eye(4)[None])
    np.testing.assert_array_equal(alone.at(7.0), np.eye(4))
    two = Trajectory([0, 1], path.poses[:2])
    np.testing.assert_allclose(two.at(0.3), two.at(0.3, method="cubic"), atol=1e-14)


def test_poses_of_scipy_are_taken(path):
    transform = pytest.importorskip("scipy.spatial.transform")
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("RigidTransform came with SciPy 1.16")
    theirs = Trajectory(TIMES, transform.RigidTransform.from_matrix(path.poses))
    np.testing.assert_allclose(theirs.poses, path.poses, atol=1e-15)
    assert dqreg.Trajectory is Trajectory


def test_errors(path):
    eyes = np.tile(np.eye(4), (3, 1, 1))
    for arguments, words in (
        (([0, 1], eyes), r"\(n,\) and \(n, 4, 4\)"),
        (([], np.zeros((0, 4, 4))), "n > 0"),
        (([0, 1, 1], eyes), "times must increase"),
        (([0, np.nan, 1], eyes), "times"),
        (([0, 1, 2], 2 * eyes), "poses"),
    ):
        with pytest.raises(InputError, match=words):
            Trajectory(*arguments)
    for use, words in (
        (lambda: path.at(4.1), "from 0 to 4"),
        (lambda: path.at(np.nan), "from 0 to 4"),
        (lambda: path.at(1.0, method="squad"), "method"),
        (lambda: path.velocities(1.0, frame="map"), "frame"),
        (lambda: path.relative(0), "at least 1"),
        (lambda: Trajectory([0], eyes[:1]).velocities(), "at least two"),
    ):
        with pytest.raises(InputError, match=words):
            use()
