from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.steps.plane_steps import FIGURES
from dqreg.kernels.steps.sweep_steps import step_on_planes_of_sweep
from dqreg.odometry.sweep import swept
from dqreg.rigid import pose, twist


@pytest.mark.parametrize("outliers", [0, 300])
def test_pose_and_motion_of_a_sweep_are_found_at_once(outliers: int) -> None:
    # Law: points on three planes, seen while the sensor moved, lie on them again.
    rng = np.random.default_rng(outliers)
    feet, normals = rng.uniform(-8, 8, (1200, 3)), np.eye(3)[np.arange(1200) % 3]
    back, true = rng.uniform(-1, 0, 1200), twist.exp(np.array([0.2, -0.1, 0.7, 3.0, -2.0, 1.0]))
    change = np.array([-2e-4, 1e-4, 4e-4, 3e-2, 2e-2, -2e-2])
    points = swept(pose.apply(pose.inverse(true), feet), -back, twist.exp(change))
    points[:outliers] += rng.uniform(-1, 1, (outliers, 3))
    T, found = true @ twist.exp(np.array([1e-3, -2e-3, 1e-3, 0.02, -0.03, 0.02])), np.zeros(6)
    weights, figures, distances = np.zeros(1200), np.zeros(FIGURES), np.zeros(1200)
    # One that met nothing, and one that met no plane.
    distances[-1], normals[-2] = 5.0, 0.0
    limits = np.array([0.5, 0.5, 2.0, 1e-3, 1e-3, 0.5, 8.0, 0.0, 0.0, 0.1])
    planes = feet, normals, distances, *np.zeros((2, 1200))
    step_on_planes_of_sweep(points, back, *planes, limits, 80, T, found, weights, figures)
    assert weights[-1] == 0.0
    np.testing.assert_allclose(weights[-2], figures[1], rtol=1e-6)
    np.testing.assert_allclose(found, change, atol=3e-3 if outliers else 1e-5)
    assert np.linalg.norm(twist.log(T @ pose.inverse(true))) < (2e-2 if outliers else 1e-4)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)


def test_what_no_point_faces_is_left_as_it_was() -> None:
    # Law: along a corridor neither pose nor motion change.
    rng = np.random.default_rng(1)
    feet, normals = rng.uniform(-8, 8, (900, 3)), np.eye(3)[1 + np.arange(900) % 2]
    back, T, found = rng.uniform(-1, 0, 900), np.eye(4), np.zeros(6)
    points = feet + 0.01 * rng.normal(size=(900, 1)) * normals
    limits = np.array([0.5, 0.5, 2.0, 1e-3, 1e-3, 0.5, 8.0, 0.0, 0.0, 0.1])
    planes = feet, normals, *np.zeros((3, 900))
    step_on_planes_of_sweep(points, back, *planes, limits, 30, T, found, np.zeros(900), np.zeros(FIGURES))
    assert abs(T[0, 3]) < 1e-3
    assert abs(found[3]) < 1e-3


def test_neither_pose_nor_motion_follow_the_noise_of_the_normals() -> None:
    # Law: the same where normals err: along the corridor they hold what nothing else does, wherever that is.
    rng = np.random.default_rng(1)
    feet, normals = rng.uniform(-8, 8, (900, 3)), np.eye(3)[1 + np.arange(900) % 2] + 0.03 * rng.normal(size=(900, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    back, T, found = rng.uniform(-1, 0, 900), np.eye(4), np.zeros(6)
    points = feet + 0.01 * rng.normal(size=(900, 1)) * normals - [0.0, 0.05, 0.05]
    limits = np.array([0.5, 0.5, 2.0, 1e-3, 1e-3, 0.5, 8.0, 0.0, 1.5, 1e-4])
    planes = feet, normals, np.zeros(900), np.full(900, 2.0 * 0.03**2), np.zeros(900)
    step_on_planes_of_sweep(points, back, *planes, limits, 100, T, found, np.zeros(900), np.zeros(FIGURES))
    np.testing.assert_allclose(T[1:3, 3], 0.05, atol=5e-3)
    np.testing.assert_allclose([T[0, 3], found[3]], 0.0, atol=1e-4)


@pytest.mark.parametrize("is_known", [True, False])
def test_planes_across_an_edge_pull_neither(is_known: bool) -> None:
    # Law: as of a pose alone.
    rng = np.random.default_rng(3)
    feet, normals = rng.uniform(-5, 5, (900, 3)), np.repeat(np.eye(3), 300, axis=0)
    points, rough = feet + 0.002 * rng.normal(size=(900, 1)) * normals, np.zeros(900)
    points[600:660, 2] -= 0.02
    rough[600:660] = 0.04**2 if is_known else 0.0
    T, back = np.eye(4), rng.uniform(-1, 0, 900)
    limits = np.array([0.012, 0.9, 0.25, 1e-3, 0.012, 0.5, 8.0, 0.0, 0.0, 0.1])
    planes = feet, normals, *np.zeros((2, 900)), rough
    step_on_planes_of_sweep(points, back, *planes, limits, 20, T, np.zeros(6), np.zeros(900), np.zeros(FIGURES))
    # The end of a sweep is known half as well as a pose alone.
    assert (abs(T[2, 3]) < 1e-3) == is_known
