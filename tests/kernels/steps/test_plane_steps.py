from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.steps.plane_steps import FIGURES, step_on_planes, weigh_by_roughness
from dqreg.rigid import pose, twist


@pytest.mark.parametrize("outliers", [0, 200])
def test_steps_on_planes_find_the_pose_among_outliers(outliers: int) -> None:
    rng = np.random.default_rng(outliers)
    feet, normals = rng.uniform(-5, 5, (900, 3)), np.repeat(np.eye(3), 300, axis=0)
    true = twist.exp(np.array([0.02, -0.01, 0.03, 0.05, 0.04, -0.06]))
    points = pose.apply(pose.inverse(true), feet)
    points[:outliers] += rng.uniform(-1, 1, (outliers, 3))
    T, weights, figures = np.eye(4), np.zeros(900), np.zeros(FIGURES)
    own = normals @ true[:3, :3]
    # Normals of another face count for nothing.
    own[-50:], points[-50:] = own[:50], points[-50:] + 0.3
    distances = np.linalg.norm(points - feet, axis=1)
    limits = np.array([0.5, 0.5, 2.0, 1e-3, 1e-3, 0.5, 8.0, 0.0, 0.0, 0.5, 0.0])
    step_on_planes(points, own, feet, normals, distances, *np.zeros((2, 900)), limits, 60, T, weights, figures)
    assert not weights[-50:].any()
    # Points that slide on their planes stay as far aside as they were: the kernel's width is of that size.
    assert np.linalg.norm(twist.log(T @ pose.inverse(true))) < (0.03 if outliers else 1e-6)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)


def test_what_nothing_holds_stays() -> None:
    rng = np.random.default_rng(0)
    feet, normals = rng.uniform(-5, 5, (400, 3)) * [1.0, 1.0, 0.0], np.tile([0.0, 0.0, 1.0], (400, 1))
    points, T = feet + np.array([0.0, 0.0, 0.1]), np.eye(4)
    distances, weights, figures = np.full(400, 0.1), np.zeros(400), np.zeros(FIGURES)
    limits = np.array([0.5, 0.5, 2.0, 1e-3, 1e-3, 0.5, 5.0, 0.0, 0.0, 0.5, 0.0])
    step_on_planes(points, normals, feet, normals, distances, *np.zeros((2, 400)), limits, 10, T, weights, figures)
    np.testing.assert_allclose(T[:3, 3], [0.0, 0.0, -0.1], atol=1e-6)


@pytest.mark.parametrize("is_known", [True, False])
def test_planes_across_an_edge_do_not_pull(is_known: bool) -> None:
    # Law: a floor whose planes beside the walls lie too high is met where the others are, once it is known how far the
    # points of each plane lie off it; weights and scale, which tell how well a frame fits, stay the same.
    rng = np.random.default_rng(3)
    feet, normals = rng.uniform(-5, 5, (900, 3)), np.repeat(np.eye(3), 300, axis=0)
    points, rough = feet + 0.002 * rng.normal(size=(900, 1)) * normals, np.zeros(900)
    points[600:660, 2] -= 0.02
    rough[600:660] = 0.04**2 if is_known else 0.0
    T, weights, figures = np.eye(4), np.zeros(900), np.zeros(FIGURES)
    limits = np.array([0.012, 0.9, 0.25, 1e-3, 0.012, 0.5, 8.0, 0.0, 0.0, 0.5, 1.0])
    none = np.zeros(900)
    step_on_planes(points, np.zeros((900, 3)), feet, normals, none, none, rough, limits, 20, T, weights, figures)
    assert weights[600:660].mean() > 0.2
    assert (abs(T[2, 3]) < 3e-4) == is_known


def test_a_plane_counts_half_squared_where_it_is_as_rough_as_the_kernel_is_wide() -> None:
    rough = np.array([0.0, 0.02**2, 0.2**2])
    weights = np.array([0.5, 1.0, 1.0])
    weigh_by_roughness(weights, rough, 0.02)
    np.testing.assert_allclose(weights, [0.5, 0.25, 1.0 / 101.0**2], rtol=1e-14)


@pytest.mark.parametrize("silent", [0.0, 1.0])
def test_points_without_a_plane_may_say_nothing(silent: float) -> None:
    # Law: then they count as the others do on average, and the scale is that of the others.
    rng = np.random.default_rng(0)
    feet, normals = rng.uniform(-5, 5, (400, 3)) * [1.0, 1.0, 0.0], np.tile([0.0, 0.0, 1.0], (400, 1))
    normals[::2] = 0.0
    points = feet + np.column_stack(
        [np.zeros((400, 2)), np.where(np.arange(400) % 2, 0.01, 0.2) * rng.normal(size=400)]
    )
    T, weights, figures = np.eye(4), np.zeros(400), np.zeros(FIGURES)
    limits = np.array([0.1, 0.9, 1.0, 1e-3, 1e-3, 0.5, 5.0, 0.0, 0.0, 0.5, silent])
    none = np.zeros(400)
    step_on_planes(points, np.zeros((400, 3)), feet, normals, none, none, none, limits, 20, T, weights, figures)
    if silent:
        assert 0.005 < figures[0] < 0.015
        np.testing.assert_allclose(weights[::2], weights[1::2].mean(), rtol=0.02)
    else:
        assert figures[0] > 0.05


@pytest.mark.parametrize("free", [[0], [1], [2], [0, 2], [1, 2]])
@pytest.mark.parametrize("facing", [0, 60])
def test_what_the_noise_of_the_normals_alone_holds_stays(free: list[int], facing: int) -> None:
    # Truth: a shift along all axes, of which the planes face some; a few points more that face the others tell it.
    rng, turn = np.random.default_rng(facing), twist.exp(np.array([0.3, -0.2, 0.5, 0.0, 0.0, 0.0]))[:3, :3]
    held = [axis for axis in range(3) if axis not in free]
    towards = np.array(held)[np.arange(1200) % len(held)]
    towards[:facing] = np.array(free)[np.arange(facing) % len(free)]
    normals = np.eye(3)[towards] + 0.03 * rng.normal(size=(1200, 3))
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ turn.T
    feet, shift = rng.uniform(-5, 5, (1200, 3)), 0.05 * turn.sum(axis=1)
    heights = 0.01 * rng.normal(size=(1200, 1)) * normals
    T, figures, variances = np.eye(4), np.zeros(FIGURES), np.full(1200, 2.0 * 0.03**2)
    limits = np.array([0.3, 0.9, 2.0, 1e-3, 1e-3, 0.5, 5.0, 0.0, 1.5, 0.5, 0.0])
    none, planes = np.zeros((1200, 3)), (feet, normals, np.zeros(1200), variances, np.zeros(1200))
    step_on_planes(feet - shift + heights, none, *planes, limits, 200, T, np.zeros(1200), figures)
    found = turn.T @ T[:3, 3]
    np.testing.assert_allclose(found[held], 0.05, atol=5e-3)
    np.testing.assert_allclose(found[free], 0.05 if facing else 0.0, atol=0.01 if facing else 1e-3)
