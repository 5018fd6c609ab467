from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan
from dqreg.icp import Icp, IcpSettings, InlierMixture, align_coarse_to_fine, points_and_normals, points_to_planes
from dqreg.icp.constrained_estimator import constrained
from dqreg.icp.correspondences import Correspondences
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost
from tests.icp.scenes import bracket_mesh, bracket_points, made_pairs, motion

NOISE = 0.01
ALL = Freedom.only("all")


def some_weights(pairs: Correspondences) -> np.ndarray:
    weights = np.random.default_rng(5).uniform(0.1, 1.0, len(pairs.scan))
    weights[::4] = 0.0
    return weights


def test_with_all_motions_free_it_is_the_unlocked_estimator() -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    for planes, other in ((True, points_to_planes), (False, points_and_normals)):
        expected = other(pairs, weights, NOISE)
        found = constrained(ALL, np.eye(4), planes=planes)(pairs, weights, NOISE)
        np.testing.assert_allclose(found.T_target_source, expected.T_target_source, atol=1e-11)
        assert found.cost == pytest.approx(expected.cost, rel=1e-9)


@pytest.mark.parametrize("planes", [True, False], ids=["planes", "points"])
@pytest.mark.parametrize("words", ["rz tx ty", "rz", "tx", "rx ry", "none", "t"])
def test_the_pose_differs_from_the_reference_by_allowed_motions_only(words: str, planes: bool) -> None:
    pairs = made_pairs()
    freedom = Freedom.parse(words, frame=motion(1.0, 0.5, 7))
    reference = pairs.T_target_source @ motion(0.05, 0.02, 3)
    # The pairs were found elsewhere, as an extrapolated step leaves them.
    fit = constrained(freedom, reference, planes=planes)(pairs, some_weights(pairs), NOISE)
    six = freedom.coordinates(fit.T_target_source, reference)
    np.testing.assert_allclose(six[~np.array(freedom.mask)], 0.0, atol=1e-13)
    six = np.where(freedom.mask, six, 0.0)
    # No worse than any allowed pose beside it.
    for step in 1e-3 * np.eye(6)[np.array(freedom.mask)]:
        for side in (step, -step):
            beside = dataclasses.replace(pairs, T_target_source=freedom.moved(reference, six + side))
            held = constrained(Freedom.only("none"), beside.T_target_source, planes=planes)
            assert held(beside, some_weights(pairs), NOISE).cost > fit.cost


def test_without_normals_points_are_used() -> None:
    pairs = made_pairs()
    bare = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, normals=0.0 * pairs.closest.normals))
    weights = some_weights(pairs)
    found = constrained(ALL, np.eye(4))(bare, weights, NOISE)
    expected = points_and_normals(bare, weights, NOISE)
    np.testing.assert_allclose(found.T_target_source, expected.T_target_source, atol=1e-11)


def test_no_weight_at_all_is_refused() -> None:
    pairs = made_pairs()
    with pytest.raises(DegenerateGeometryError):
        constrained(ALL, np.eye(4))(pairs, np.zeros(len(pairs.scan)), NOISE)


@pytest.mark.parametrize("noise", [NOISE, np.inf])
def test_a_strong_prior_pins_and_a_weak_one_vanishes(noise: float) -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    believed = pairs.T_target_source @ motion(0.02, 0.01, 4)
    alone = points_to_planes(pairs, weights, NOISE).T_target_source
    for size, expected in ((1e-16, believed), (1e12, alone)):
        prior = PoseCost.prior(believed, size * np.ones(6))
        found = constrained(ALL, np.eye(4), prior)(pairs, weights, noise).T_target_source
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_prior_is_weighed_against_the_noise() -> None:
    # sum w d^2 / noise^2 + prior, minimised by itself.
    pairs = made_pairs()
    weights = some_weights(pairs)
    prior = PoseCost.prior(pairs.T_target_source @ motion(0.02, 0.01, 4), 1e-4 * np.ones(6))
    planes = PoseCost.planes(pairs.scan.points, pairs.closest.points, pairs.closest.normals, weights / NOISE**2)
    found = constrained(ALL, np.eye(4), prior)(pairs, weights, NOISE).T_target_source
    expected = (planes + prior).minimise(near=pairs.T_target_source).T_target_source
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_a_levelled_scan_comes_home_with_its_level_kept() -> None:
    # Truth: the identity. The scan starts 8 degrees and 5 % of the part off, by a turn about the upright axis and
    # shifts; tilts are locked. Noise of 3e-4 of the size on some thousand points.
    part = bracket_mesh()
    surface = MeshSurface(part)
    scan = prepare_scan(PointCloud(bracket_points(60, 1)))
    freedom = Freedom.only("rz", "t")
    start = pose.exp(np.r_[0, 0, np.deg2rad(8.0), 0.05 * part.diagonal * np.array([0.6, -0.64, 0.48])])
    plan = IcpSettings(
        estimator=constrained(freedom, start, planes=False),
        fine=constrained(freedom, start),
        max_distance=0.2 * part.diagonal,
    )
    run = align_coarse_to_fine(scan, surface, start, plan)
    assert run.status == "converged"
    six = freedom.coordinates(run.T_target_source, start)
    np.testing.assert_allclose(six[:2], 0.0, atol=1e-12)
    assert pose.angle_between(run.T_target_source, np.eye(4)) < 1e-3
    assert pose.offset_between(run.T_target_source, np.eye(4)) < 1e-3 * part.diagonal


def test_a_wrong_lock_is_held_all_the_same() -> None:
    # The scan is tilted by a degree, and tilts are locked: the answer keeps the wrong tilt to the last digit.
    part = bracket_mesh()
    scan = prepare_scan(PointCloud(bracket_points(40, 2)))
    start = pose.exp(np.r_[np.deg2rad(1.0), 0, 0, 0, 0, 0.01 * part.diagonal])
    freedom = Freedom.parse("-rx -ry")
    icp = Icp(constrained(freedom, start), kernel=InlierMixture(0.02 * part.diagonal, 0.9, 0.2 * part.diagonal))
    run = icp.run(scan, MeshSurface(part), start)
    np.testing.assert_allclose(freedom.coordinates(run.T_target_source, start)[:2], 0.0, atol=1e-12)
    assert pose.angle_between(run.T_target_source, np.eye(4)) > np.deg2rad(0.99)


def test_a_prior_decides_what_the_shape_leaves_free() -> None:
    # A shaft of 64 faces, 1,500 points with noise of 0.003: they say nothing about its turn about z, and the prior,
    # good to 0.01 rad about that turn alone, says 0.2. The start is 0.6 rad away from what the prior says.
    import trimesh

    shape = trimesh.creation.cylinder(radius=1.0, height=6.0, sections=64)
    surface = MeshSurface(Mesh(shape.vertices, shape.faces))
    points = trimesh.sample.sample_surface(shape, 1_500, seed=1)[0]
    scan = prepare_scan(PointCloud(points + 0.003 * np.random.default_rng(0).normal(size=points.shape)))
    start = pose.exp([0.05, -0.04, 0.8, 0.1, 0.1, 0.2])
    about_z = PoseCost.prior(pose.exp([0, 0, 0.2, 0, 0, 0]), [np.inf, np.inf, 1e-4, np.inf, np.inf, np.inf])
    plan = IcpSettings(
        estimator=constrained(ALL, start, about_z, planes=False),
        fine=constrained(ALL, start, about_z),
        max_distance=1.2,
    )
    run = align_coarse_to_fine(scan, surface, start, plan)
    turn, shift = np.split(pose.log(run.T_target_source), 2)
    assert turn[2] == pytest.approx(0.2, abs=0.03)
    # The rest is held by the shape: 0.003 / sqrt(1500) is 1e-4, and the lever of a tilt is longer than one.
    assert np.abs([*turn[:2], *shift]).max() < 1e-3
