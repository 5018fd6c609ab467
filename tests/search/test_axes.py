from __future__ import annotations

import itertools

import numpy as np
import pytest

import dqreg
from dqreg.geometry import Mesh, PointCloud, prepare_scan, sample_mesh
from dqreg.rigid import pose
from dqreg.search.axes import axes_of_normals, axis_hypotheses, cube_rotations, principal_axes
from dqreg.synth.parts import box, bracket
from tests.strategies import FloatArray

BRACKET = Mesh(*bracket())
# Right: the worst vertex of the part stands within this share of its size.
RIGHT = 0.02


def worst_vertex(T: FloatArray, truth: FloatArray, mesh: Mesh) -> float:
    """Largest displacement of the part's vertices between two poses, in sizes; the source frame is the moved one."""
    moved = pose.apply(pose.inverse(truth), mesh.vertices)
    return float(np.linalg.norm(pose.apply(T, moved) - mesh.vertices, axis=1).max()) / mesh.diagonal


def moved_sample(mesh: Mesh, n: int, seed: int, reach: float) -> tuple[PointCloud, FloatArray]:
    """Points of the whole surface at a drawn pose, and that pose, T_target_source."""
    rng = np.random.default_rng(seed)
    truth = pose.random(rng, reach=reach)
    return PointCloud(pose.apply(pose.inverse(truth), sample_mesh(mesh, n, rng).points)), truth


def test_the_turns_are_a_group_of_24_rotations() -> None:
    turns = cube_rotations()
    keys = {tuple(R.astype(int).ravel()) for R in turns}
    assert len(keys) == len(turns) == 24
    assert tuple(np.eye(3, dtype=int).ravel()) in keys
    for a, b in itertools.product(turns, repeat=2):
        assert tuple((a @ b).astype(int).ravel()) in keys
    for R in turns:
        np.testing.assert_array_equal(R @ R.T, np.eye(3))
        assert round(np.linalg.det(R)) == 1


def test_principal_axes_are_a_rotation_that_makes_the_covariance_diagonal() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        root = rng.normal(size=(3, 3))
        covariance = root @ root.T
        mean, axes = principal_axes(np.ones(3), covariance)
        np.testing.assert_array_equal(mean, np.ones(3))
        np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-12)
        diagonal = axes.T @ covariance @ axes
        np.testing.assert_allclose(diagonal, np.diag(np.sort(np.diag(diagonal))), atol=1e-12)


@pytest.mark.parametrize("origin", [0.0, 1e3])
def test_a_box_goes_onto_itself_exactly_by_its_own_turns(origin: float) -> None:
    # The source is the corners and face centres of a finely divided box: its moments are not those of the surface, but
    # its centre and axes are, by symmetry. The truth is the pose that moved it.
    mesh = Mesh(*box((5.0, 3.0, 1.0), divisions=4))
    target = Mesh(mesh.vertices + origin, mesh.faces)
    truth = pose.random(np.random.default_rng(3), reach=2.0)
    truth = pose.from_parts(truth[:3, :3], truth[:3, 3] + origin)
    scan = prepare_scan(PointCloud(pose.apply(pose.inverse(truth), target.vertices)))
    errors = [worst_vertex(T, truth, target) for T in axis_hypotheses(scan, target).matrices]
    assert len(errors) == 24
    # Far coordinates are rounded to 1e-13, and moments square them.
    assert min(errors) < (1e-12 if origin == 0.0 else 1e-8)
    # A box has four turns onto itself; by the axes alone four proposals fit all its corners.
    fits = [
        np.abs(
            np.sort(np.abs(pose.apply(T, scan.points) - origin), axis=0) - np.sort(np.abs(mesh.vertices), axis=0)
        ).max()
        for T in axis_hypotheses(scan, target).matrices
    ]
    assert sum(fit < 1e-7 for fit in fits) == 4


def test_the_moments_of_a_mesh_are_those_of_its_dense_sampling() -> None:
    # The proposals of a mesh and of a sample of it differ only by the sample's scatter.
    mesh, n = BRACKET, 40_000
    sampled = sample_mesh(mesh, n, np.random.default_rng(0))
    scan = prepare_scan(sampled)
    exact, empirical = axis_hypotheses(scan, mesh).matrices, axis_hypotheses(scan, PointCloud(sampled.points)).matrices
    means = [T[:3, :3] @ scan.points.mean(axis=0) + T[:3, 3] for T in (exact[0], empirical[0])]
    spread = sampled.points.std(axis=0).max()
    assert np.linalg.norm(means[0] - means[1]) < 5.0 * np.sqrt(3.0) * spread / np.sqrt(n)
    # To first order axes i and j turn into each other by their covariance over the gap of their variances, and that
    # covariance is a mean of n products. Five sigma of all three turns together.
    covariance = np.cov(sampled.points.T)
    _, axes = principal_axes(np.zeros(3), covariance)
    x = (sampled.points - sampled.points.mean(axis=0)) @ axes
    values = x.var(axis=0)
    turns = [(x[:, i] * x[:, j]).std() / np.sqrt(n) / abs(values[i] - values[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    bound = 5.0 * float(np.linalg.norm(turns))
    nearest = min(float(pose.angle_between(exact[0], T)) for T in empirical)
    assert nearest < bound
    assert bound < np.deg2rad(5.0)


def test_a_second_moment_of_a_lone_triangle_is_the_textbooks() -> None:
    # Right triangle with legs 6 and 2 in a skew frame: centroid a third along each leg, axes by tan(2 a) = 2 Ixy / (Ixx
    # - Iyy) with Ixx = a^2 / 18, Iyy = b^2 / 18, Ixy = -a b / 36.
    a, b = 6.0, 2.0
    mesh = Mesh([[0, 0, 0], [a, 0, 0], [0, b, 0]], [[0, 1, 2]])
    scan = prepare_scan(PointCloud([[5.0, 0, 0], [-5, 0, 0], [0, 2, 0], [0, -2, 0], [0, 0, 1], [0, 0, -1]]))
    angle = 0.5 * np.arctan2(-2.0 * a * b / 36.0, (a * a - b * b) / 18.0)
    longest = np.array([np.cos(angle), np.sin(angle), 0.0])
    # Of the source the longest axis is x: in each proposal an axis of the source goes there, in four of them this one.
    images = np.array([T[:3, 0] for T in axis_hypotheses(scan, mesh).matrices])
    assert int((np.abs(images @ longest) > 1.0 - 1e-12).sum()) == 8
    for T in axis_hypotheses(scan, mesh).matrices:
        np.testing.assert_allclose(T[:3, 3], [a / 3.0, b / 3.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_one_of_the_hypotheses_of_a_full_scan_is_near_the_truth(seed: int) -> None:
    cloud, truth = moved_sample(BRACKET, 20_000, seed, reach=500.0)
    errors = [worst_vertex(T, truth, BRACKET) for T in axis_hypotheses(prepare_scan(cloud), BRACKET).matrices]
    assert min(errors) < RIGHT


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_without_an_initial_pose_a_full_scan_is_registered(seed: int) -> None:
    cloud, truth = moved_sample(BRACKET, 20_000, 100 + seed, reach=500.0)
    result = dqreg.register(cloud, BRACKET, effort="fast")
    assert result.verdict.level == "accepted"
    assert worst_vertex(result.T_target_source, truth, BRACKET) < 1e-6


def test_axes_of_two_normals_are_right_handed_and_keep_the_first_and_the_plane_of_both():
    rng = np.random.default_rng(1)
    for one, other in rng.normal(size=(20, 2, 3)):
        one /= np.linalg.norm(one)
        axes = axes_of_normals(one, other)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(axes) > 0.0
        np.testing.assert_array_equal(axes[0], one)
        np.testing.assert_allclose(axes[2] @ other, 0.0, atol=1e-14)
        assert axes[1] @ other > 0.0
