"""Stacks of unit dual quaternions, beside the poses and the twists that they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.multiway.pose_graph import dual_poses
from dqreg.rigid import pose, quaternion
from tests.strategies import FloatArray, angles, floats, poses, translations, unit_vectors

ROUNDING = 1e-13


def stacks(count: int) -> st.SearchStrategy[list[FloatArray]]:
    return st.lists(poses(), min_size=count, max_size=count)


def assert_same(found: FloatArray, expected: FloatArray, of: list[FloatArray]) -> None:
    """Two stacks of poses are equal but for the rounding of translations as long as those given."""
    reach = 1.0 + sum(float(np.abs(T[:3, 3]).max()) for T in of)
    np.testing.assert_allclose(found[..., :3, :3], expected[..., :3, :3], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found[..., :3, 3], expected[..., :3, 3], rtol=0, atol=ROUNDING * reach)


def assert_unit(dq: FloatArray, reach: float) -> None:
    np.testing.assert_allclose(np.linalg.norm(dq[..., :4], axis=-1), 1.0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.sum(dq[..., :4] * dq[..., 4:], axis=-1), 0.0, rtol=0, atol=ROUNDING * reach)


@settings(deadline=None, max_examples=60)
@given(stacks(4))
def test_products_and_inverses_are_those_of_the_poses(four: list[FloatArray]) -> None:
    T = np.stack(four)
    dq = dual_poses.from_matrices(T)
    assert_same(dual_poses.to_matrices(dq), T, four)
    assert_same(dual_poses.to_matrices(dual_poses.inverse(dq)), pose.inverse(T), four)
    a, b, A, B = dq[:2], dq[2:], T[:2], T[2:]
    product = dual_poses.multiply(a, b)
    assert_same(dual_poses.to_matrices(product), A @ B, four)
    assert_unit(product, 1.0 + float(np.abs(T[:, :3, 3]).sum()))
    # One for all of a stack is that with each.
    np.testing.assert_array_equal(dual_poses.multiply(dq[0], b)[1], dual_poses.multiply(dq[0], dq[3]))


@settings(deadline=None, max_examples=60)
@given(stacks(3))
def test_they_are_a_group(three: list[FloatArray]) -> None:
    a, b, c = dual_poses.from_matrices(np.stack(three))
    left, right = (
        dual_poses.multiply(dual_poses.multiply(a, b), c),
        dual_poses.multiply(a, dual_poses.multiply(b, c)),
    )
    assert_same(dual_poses.to_matrices(left), dual_poses.to_matrices(right), three)
    none = dual_poses.from_matrices(np.eye(4))
    assert_same(dual_poses.to_matrices(dual_poses.multiply(a, none)), three[0], three)
    for both in (dual_poses.multiply(a, dual_poses.inverse(a)), dual_poses.multiply(dual_poses.inverse(a), a)):
        assert_same(dual_poses.to_matrices(both), np.eye(4), three)
    back = dual_poses.multiply(dual_poses.inverse(b), dual_poses.inverse(a))
    np.testing.assert_allclose(
        dual_poses.inverse(dual_poses.multiply(a, b)), back, rtol=0, atol=ROUNDING * (1.0 + np.abs(back).max())
    )


def test_errors_of_a_long_product_do_not_grow_off_the_constraints() -> None:
    rng = np.random.default_rng(0)
    steps = dual_poses.from_matrices(pose.random(rng, reach=1.0, shape=(1_000,)))
    # As if each factor had been rounded to single precision.
    rough, product = steps.astype(np.float32).astype(np.float64), steps[0]
    for step in rough:
        product = dual_poses.multiply(product, step)
    assert_unit(product, 1_000.0)


@settings(deadline=None, max_examples=60)
@given(unit_vectors(), angles(), translations())
def test_exp_is_that_of_the_twist(axis: FloatArray, angle_rad: float, shift: FloatArray) -> None:
    twist = np.r_[angle_rad * axis, shift]
    dq = dual_poses.exp(twist)
    assert_unit(dq, 1.0 + float(np.abs(shift).max()))
    assert_same(dual_poses.to_matrices(dq), pose.exp(twist), [pose.from_parts(np.eye(3), shift)])
    if angle_rad < 3.14:
        # The shift comes back through the inverse of what it went through, whose norm is at most pi / 2 here.
        expected = np.r_[twist[:3], twist[3:]]
        np.testing.assert_allclose(dual_poses.log(dq)[:3], expected[:3], rtol=0, atol=ROUNDING)
        size = 1.0 + float(np.abs(shift).max())
        np.testing.assert_allclose(dual_poses.log(dq)[3:], expected[3:], rtol=0, atol=10.0 * ROUNDING * size)


@settings(deadline=None, max_examples=60)
@given(poses())
def test_log_leads_back_by_the_shorter_rotation_whatever_the_sign(T: FloatArray) -> None:
    dq = dual_poses.from_matrices(T)
    for either in (dq, -dq):
        twist = dual_poses.log(either)
        assert np.linalg.norm(twist[:3]) <= np.pi + ROUNDING
        assert_same(dual_poses.to_matrices(dual_poses.exp(twist)), T, [T, T])
    # At a half-turn either axis is right.
    if np.linalg.norm(pose.log(T)[:3]) < 3.14:
        reach = 1.0 + float(np.abs(T[:3, 3]).max())
        np.testing.assert_allclose(dual_poses.log(-dq), pose.log(T), rtol=0, atol=10.0 * ROUNDING * reach)


@settings(deadline=None, max_examples=60)
@given(unit_vectors(), unit_vectors(), floats(-15.0, -3.0))
def test_near_the_identity_nothing_is_lost(axis: FloatArray, direction: FloatArray, exponent: float) -> None:
    twist = 10.0**exponent * np.r_[axis, direction]
    found = dual_poses.log(dual_poses.exp(twist))
    np.testing.assert_allclose(found, twist, rtol=0, atol=ROUNDING * 10.0**exponent)


@pytest.mark.parametrize("axis", np.eye(3))
def test_a_half_turn_is_one(axis: FloatArray) -> None:
    shift = np.array([1.0, -2.0, 3.0])
    T = pose.from_parts(2.0 * np.outer(axis, axis) - np.eye(3), shift)
    dq = dual_poses.from_matrices(T)
    assert quaternion.canonical(dq[:4])[0] == pytest.approx(0.0, abs=ROUNDING)
    assert np.linalg.norm(dual_poses.log(dq)[:3]) == pytest.approx(np.pi, abs=ROUNDING)
    np.testing.assert_allclose(dual_poses.to_matrices(dual_poses.multiply(dq, dq))[:3, :3], np.eye(3), atol=ROUNDING)


def test_no_poses_are_none() -> None:
    none = np.zeros((0, 8))
    assert dual_poses.from_matrices(np.zeros((0, 4, 4))).shape == (0, 8)
    assert dual_poses.exp(dual_poses.log(dual_poses.multiply(none, dual_poses.inverse(none)))).shape == (0, 8)
