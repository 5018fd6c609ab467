from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial import transform

from dqreg.errors import InputError
from dqreg.rigid import pose, twist
from dqreg.rigid import quaternion as quat
from dqreg.rigid.rotations import left_jacobian, left_jacobian_inverse
from tests.rigid.finite_differences import ROUNDING, jacobian
from tests.strategies import floats, poses, unit_vectors

fast = settings(deadline=None, max_examples=50)
LENGTHS_RAD = st.one_of(
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-7, 0.0999999, 0.1, np.pi - 1e-7, np.pi]), floats(0, 3.14)
)
rotation_vectors = st.tuples(unit_vectors(), LENGTHS_RAD).map(lambda draw: draw[0] * draw[1])
twists = st.tuples(rotation_vectors, unit_vectors(), floats(0, 10)).map(
    lambda draw: np.concatenate([draw[0], draw[1] * draw[2]])
)


def generator(twist):
    """The 4x4 matrix whose exponential is the pose."""
    G = np.zeros((4, 4))
    G[:3, :3], G[:3, 3] = quat.cross_matrix(twist[:3]), twist[3:]
    return G


@fast
@given(twists)
def test_exp_is_the_matrix_exponential(twist):
    np.testing.assert_allclose(pose.exp(twist), expm(generator(twist)), atol=1e-12)


@fast
@given(twists)
def test_exp_agrees_with_scipy(twist):
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("the oracle came with SciPy 1.16")
    np.testing.assert_allclose(pose.exp(twist), transform.RigidTransform.from_exp_coords(twist).as_matrix(), atol=1e-13)


@fast
@given(twists)
def test_log_undoes_exp(twist):
    back = pose.log(pose.exp(twist))
    if np.linalg.norm(twist[:3]) < np.pi - 1e-8:  # the two twists of a half-turn are both right
        np.testing.assert_allclose(back, twist, atol=1e-12)
    np.testing.assert_allclose(pose.exp(back), pose.exp(twist), atol=1e-13)


@fast
@given(poses())
def test_exp_undoes_log(T):
    twist = pose.log(T)
    assert np.linalg.norm(twist[:3]) <= np.pi + 1e-15
    back, length = pose.exp(twist), 1 + np.linalg.norm(T[:3, 3])
    np.testing.assert_allclose(back[:3, :3], T[:3, :3], atol=1e-13)
    np.testing.assert_allclose(back[:3, 3], T[:3, 3], rtol=0, atol=1e-12 * length)


def test_half_turns_have_the_canonical_axis():
    np.testing.assert_allclose(pose.log(np.diag([-1.0, 1, -1, 1])), [0, np.pi, 0, 0, 0, 0], atol=1e-15)


@fast
@given(twists, poses())
def test_adjoint_carries_twists_through_a_pose(twist, T):
    direct = T @ pose.exp(twist) @ pose.inverse(T)
    length = 1 + np.linalg.norm(T[:3, 3])
    np.testing.assert_allclose(pose.exp(pose.adjoint(T) @ twist), direct, rtol=0, atol=1e-12 * length)


@fast
@given(rotation_vectors)
def test_left_jacobian_is_the_derivative_of_the_rotation(w):
    # exp(w + dw) exp(w)^-1 has the rotation vector J dw.
    R_back = pose.exp([*w, 0, 0, 0])[:3, :3].T

    def leftover(x):
        T = np.eye(4)
        T[:3, :3] = pose.exp([*x, 0, 0, 0])[:3, :3] @ R_back
        return pose.log(T)[:3]

    np.testing.assert_allclose(left_jacobian(w), jacobian(leftover, w), atol=10 * ROUNDING)


@fast
@given(rotation_vectors)
def test_left_jacobian_and_its_inverse(w):
    np.testing.assert_allclose(left_jacobian_inverse(w) @ left_jacobian(w), np.eye(3), atol=1e-14)
    np.testing.assert_allclose(left_jacobian(w) @ w, w, atol=1e-15)


def test_series_and_closed_form_meet():
    # Between the two branches, at 0.1 rad, nothing jumps.
    axis = np.array([2.0, -1.0, 2.0]) / 3
    for function in (left_jacobian, left_jacobian_inverse):
        gap = function((0.1 - 1e-14) * axis) - function((0.1 + 1e-14) * axis)
        assert np.abs(gap).max() < 1e-14


def test_stacks():
    rng = np.random.default_rng(8)
    twists = rng.normal(size=(3, 2, 6))
    T = pose.exp(twists)
    assert T.shape == (3, 2, 4, 4)
    np.testing.assert_allclose(T[2, 1], pose.exp(twists[2, 1]), atol=1e-15)
    np.testing.assert_allclose(pose.log(T), twists, atol=1e-13)
    assert pose.adjoint(T).shape == (3, 2, 6, 6)


def test_errors():
    with pytest.raises(InputError, match="twist must hold"):
        pose.exp([1, 2, 3])
    with pytest.raises(InputError, match="4x4"):
        pose.log(np.eye(3))
    with pytest.raises(InputError, match="orthonormal"):
        pose.log(np.full((4, 4), np.nan))
    with pytest.raises(InputError, match="4x4"):
        pose.adjoint(np.eye(3))


@pytest.mark.parametrize("bad", [np.ones(6) * 1j, ["a"] * 6, [None] * 6])
def test_a_twist_of_other_than_real_numbers_is_refused_by_name(bad):
    with pytest.raises(InputError, match="twist must be an array of real numbers"):
        pose.exp(bad)


@pytest.mark.parametrize("bad", [np.eye(3) * 1j, [["a"] * 3] * 3])
def test_a_rotation_of_other_than_real_numbers_is_refused_by_name(bad):
    with pytest.raises(InputError, match="R must be an array of real numbers"):
        pose.from_parts(bad, [0, 0, 0])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.7, 1.999, 2.001, 3.0, 6.0])
def test_the_left_jacobian_of_poses_is_the_derivative_of_exp(angle):
    rng = np.random.default_rng(5)
    for _ in range(3):
        w, v, d = rng.standard_normal((3, 3))
        x = np.concatenate([angle * w / np.linalg.norm(w), 3 * v])
        dx, h = np.concatenate([d, rng.standard_normal(3)]), 1e-5
        slope = twist.log(twist.exp(x + h * dx) @ pose.inverse(twist.exp(x - h * dx))) / (2 * h)
        np.testing.assert_allclose(twist.left_jacobian(x) @ dx, slope, atol=1e-8)
        if angle < 4:
            np.testing.assert_allclose(twist.left_jacobian_inverse(x) @ twist.left_jacobian(x), np.eye(6), atol=1e-12)


def test_the_left_jacobian_agrees_with_pytransform3d():
    peer = pytest.importorskip("pytransform3d.transformations")
    for x in np.random.default_rng(6).standard_normal((5, 6)):
        np.testing.assert_allclose(twist.left_jacobian(x), peer.left_jacobian_SE3(x), atol=1e-13)
