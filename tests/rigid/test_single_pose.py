from __future__ import annotations

import math

import numpy as np
import pytest

from dqreg.rigid import pose, single_pose, twist


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.99e-3, 1.01e-3, 0.3, 2.0, 3.1, math.pi])
def test_one_pose_is_taken_as_a_stack_of_one(angle: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        axis, moved = rng.normal(size=3), rng.normal(size=3)
        coordinates = np.r_[angle * axis / np.linalg.norm(axis), moved]
        T = twist.exp(coordinates)
        # Translations of about one: the rounding of a hundred operations.
        np.testing.assert_allclose(T, twist.exp(coordinates[None])[0], rtol=0.0, atol=5e-14)
        if angle < math.pi:
            np.testing.assert_allclose(twist.log(T), twist.log(T[None])[0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("axis", [(-1.0, 0.0, 0.0), (0.0, -0.6, 0.8), (0.6, 0.8, 0.0)])
def test_one_exact_half_turn_has_the_axis_of_a_stack(axis: tuple[float, ...]) -> None:
    T = np.eye(4)
    T[:3, :3] = 2.0 * np.outer(axis, axis) - np.eye(3)
    np.testing.assert_allclose(twist.log(T), twist.log(T[None])[0], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.3, 2.0, 3.1, math.pi])
def test_the_angle_between_two_poses_is_that_of_stacks(angle: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        axis, T = rng.normal(size=3), twist.exp(rng.normal(size=6))
        other = T @ twist.exp(np.r_[angle * axis / np.linalg.norm(axis), rng.normal(size=3)])
        found = single_pose.angle_between(T, other)
        assert found == pytest.approx(float(pose.angle_between(T, other)), rel=0.0, abs=1e-15)
        assert found == pytest.approx(angle, rel=0.0, abs=2e-15)
