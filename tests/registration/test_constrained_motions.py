"""Which motions the shape holds, and what errors grow by where it does not."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import Correspondences, find_correspondences
from dqreg.registration.constrained_motions import MIN_FOLLOWED_SHARE, followed_by, held_by_shape, own_normals
from dqreg.registration.fit.fit import Fit
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket, cylinder
from tests.icp.scenes import bumpy_cloud
from tests.registration.scenes import fit_of, problem_of


def centred(part: Mesh) -> Mesh:
    return Mesh(part.vertices - part.centre, part.faces)


SHAFT, BRACKET = centred(Mesh(*cylinder(diameter=20.0, height=60.0))), centred(Mesh(*bracket()))


def side_of_shaft(unit: float = 1.0) -> FloatArray:
    found = sample_mesh(SHAFT, 2_000, np.random.default_rng(0))
    assert found.normals is not None
    return unit * found.points[np.abs(found.normals[:, 2]) < 0.5]


def on(part: Mesh, points: FloatArray) -> Correspondences:
    return find_correspondences(prepare_scan(PointCloud(points)), MeshSurface(part), np.eye(4))


def held(part: Mesh, points: FloatArray) -> FloatArray | None:
    pairs = on(part, points)
    return held_by_shape(pairs, np.ones(len(pairs.scan)))


def test_a_shape_that_holds_all_six_leaves_nothing_to_say() -> None:
    assert held(BRACKET, sample_mesh(BRACKET, 2_000, np.random.default_rng(0)).points) is None


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_of_a_shaft_the_rotation_and_the_shift_along_its_axis_are_taken_out(unit: float) -> None:
    part = Mesh(unit * SHAFT.vertices, SHAFT.faces)
    found = held(part, side_of_shaft(unit))
    assert found is not None
    # A projection: what it leaves it leaves again.
    scale = np.repeat([unit, 1.0], 3)
    scaled = scale[:, None] * found / scale
    np.testing.assert_allclose(scaled @ scaled, scaled, atol=1e-6)
    assert np.trace(found) == pytest.approx(4.0, abs=1e-6)
    along = np.zeros((6, 2))
    along[2, 0] = along[5, 1] = 1.0
    assert np.abs(scaled @ along).max() < 0.01
    across = np.eye(6)[:, [0, 1, 3, 4]]
    np.testing.assert_allclose((scaled @ across)[[0, 1, 3, 4]], np.eye(4), atol=0.02)


def test_without_normals_or_without_a_surface_nothing_is_said() -> None:
    pairs = on(SHAFT, side_of_shaft())
    weights = np.ones(len(pairs.scan))
    bare = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, normals=0.0 * pairs.closest.normals))
    assert held_by_shape(bare, weights) is None
    assert held_by_shape(dataclasses.replace(pairs, surface=None), weights) is None


def test_own_normals_are_those_of_the_scan_in_the_targets_frame_and_of_clouds_alone() -> None:
    T = twist.exp(np.array([0.1, -0.2, 0.05, 0.0, 0.0, 0.02]))
    surface, scan = CloudSurface(PointCloud(bumpy_cloud(500, 1))), prepare_scan(PointCloud(bumpy_cloud(300, 2)))
    pairs = find_correspondences(scan, surface, T)
    found = own_normals(surface, pairs)
    assert found is not None
    np.testing.assert_allclose(found, scan.normals @ T[:3, :3].T, atol=1e-12)
    assert own_normals(MeshSurface(BRACKET), on(BRACKET, 0.5 * BRACKET.vertices)) is None


@functools.cache
def between_sheets(noise: float) -> Fit:
    # One sheet, drawn twice; points stand 0.02 apart.
    rng = np.random.default_rng(3)
    clouds = [bumpy_cloud(2_500, seed) for seed in (1, 2)]
    clouds = [cloud + noise * rng.normal(size=cloud.shape) for cloud in clouds]
    return fit_of(problem_of(*clouds, np.eye(4), effort="fast"))


def test_residuals_follow_a_displacement_less_where_noise_is_as_wide_as_points_stand_apart() -> None:
    shares = [followed_by(between_sheets(noise).run, between_sheets(noise).prepared.surface) for noise in (1e-4, 0.03)]
    assert 1.0 >= shares[0] > 0.9 > shares[1] >= MIN_FOLLOWED_SHARE
    # A mesh has a face everywhere.
    part = fit_of(problem_of(sample_mesh(BRACKET, 500, np.random.default_rng(1)).points, BRACKET, np.eye(4)))
    assert followed_by(part.run, part.prepared.surface) == 1.0


def test_no_weight_leaves_nothing_that_could_follow() -> None:
    fit = between_sheets(1e-4)
    none = dataclasses.replace(fit.run, weights=np.zeros_like(fit.run.weights))
    assert followed_by(none, fit.prepared.surface) == 1.0


def test_a_frame_turns_what_is_held_with_it() -> None:
    R = pose.exp(np.array([0.4, -0.7, 0.2, 0.0, 0.0, 0.0]))
    turned = Mesh(pose.apply(R, SHAFT.vertices), SHAFT.faces)
    one, other = held(SHAFT, side_of_shaft()), held(turned, pose.apply(R, side_of_shaft()))
    assert one is not None
    assert other is not None
    A = pose.adjoint(R)
    np.testing.assert_allclose(np.linalg.inv(A) @ other @ A, one, atol=0.02 * SHAFT.diagonal)
