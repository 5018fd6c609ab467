"""Steps along those motions alone that the shape of a part holds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import Correspondences, find_correspondences, points_to_planes
from dqreg.icp.constrained_steps import motions_of_shape, motions_of_smooth_surface, planes_along
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by
from dqreg.synth.parts import bracket, cylinder
from tests.icp.scenes import made_pairs, motion

NOISE = 0.01


def centred(part: Mesh) -> Mesh:
    return Mesh(part.vertices - part.centre, part.faces)


SHAFT, BRACKET = centred(Mesh(*cylinder(diameter=20.0, height=60.0))), centred(Mesh(*bracket()))


def pairs_on(part: Mesh, T: FloatArray, *, side_only: bool = False, count: int = 1_500) -> Correspondences:
    """Points of a part, as they lie under the inverse of a pose, matched at that of none."""
    found = sample_mesh(part, count, np.random.default_rng(0))
    points = found.points
    if side_only:
        points = points[np.abs(found.normals[:, 2]) < 0.5]
    scan = prepare_scan(PointCloud(pose.apply(pose.inverse(T), points)))
    return find_correspondences(scan, MeshSurface(part), np.eye(4))


def test_a_shaft_is_held_along_its_axis_by_its_ends_alone() -> None:
    for side_only, free in ((True, [2, 5]), (False, [2])):
        pairs = pairs_on(SHAFT, np.eye(4), side_only=side_only)
        weights = np.ones(len(pairs.scan))
        axes = motions_of_shape(pairs, weights)
        assert axes is not None
        assert axes.shape == (6, 6 - len(free))
        np.testing.assert_allclose(axes.T @ axes, np.eye(axes.shape[1]), atol=1e-12)
        # What is left are the rotation about the axis, and the shift along it, to the slope of a facet's normal.
        left = np.eye(6) - axes @ axes.T
        assert np.linalg.norm(left[free][:, free]) ** 2 == pytest.approx(len(free), abs=1e-2)


def test_all_six_are_held_on_a_bracket_and_nothing_is_said_without_a_part() -> None:
    pairs = pairs_on(BRACKET, np.eye(4))
    weights = np.ones(len(pairs.scan))
    assert motions_of_shape(pairs, weights) is None
    assert motions_of_smooth_surface(pairs, MeshSurface(BRACKET), weights).shape == (6, 6)
    assert motions_of_shape(made_pairs(), np.ones(40)) is None


def test_points_without_weight_hold_nothing() -> None:
    pairs = pairs_on(SHAFT, np.eye(4))
    # Those of the ends, by where they are.
    weights = np.where(np.abs(pairs.closest.normals[:, 2]) < 0.5, 1.0, 0.0)
    axes = motions_of_shape(pairs, weights)
    assert axes is not None
    assert axes.shape == (6, 4)


@pytest.mark.parametrize("side_only", [True, False])
def test_a_step_does_not_go_where_nothing_holds(side_only: bool) -> None:
    T = motion(0.01, 0.1, 3)
    pairs = pairs_on(SHAFT, T, side_only=side_only)
    weights = np.ones(len(pairs.scan))
    axes = motions_of_shape(pairs, weights)
    assert axes is not None
    fit = planes_along(axes)(pairs, weights, NOISE)
    step = pose.log(fit.T_target_source @ pose.inverse(pairs.T_target_source)) * scaling_by(0.5 * SHAFT.diagonal)
    off = step - axes @ (axes.T @ step)
    assert np.linalg.norm(off) < 1e-9 * np.linalg.norm(step)
    # It halves what is left, at least, and says what is left after it.
    assert fit.cost < 0.25 * float(weights @ pairs.point_to_plane**2)
    assert fit.rms == pytest.approx(np.sqrt(fit.cost / weights.sum()))


def test_along_all_six_it_is_a_step_of_gauss_newton() -> None:
    pairs = pairs_on(BRACKET, motion(1e-4, 1e-2, 5))
    weights = np.random.default_rng(1).uniform(0.1, 1.0, len(pairs.scan))
    found = planes_along(np.eye(6))(pairs, weights, NOISE).T_target_source
    expected = points_to_planes(pairs, weights, NOISE).T_target_source
    # They differ by the square of the rotation.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * BRACKET.diagonal)
    # Any other basis of the same motions leads to the same pose, and the scale of the weights is no matter.
    axes = np.linalg.qr(np.random.default_rng(2).normal(size=(6, 6)))[0]
    for basis, factor in ((axes, 1.0), (np.eye(6), 1e3)):
        other = planes_along(basis)(pairs, factor * weights, NOISE).T_target_source
        np.testing.assert_allclose(other, found, rtol=0, atol=1e-12 * BRACKET.diagonal)


def test_where_everything_lies_on_its_planes_nothing_moves() -> None:
    pairs = pairs_on(BRACKET, np.eye(4))
    still = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, points=pairs.moved.copy()))
    fit = planes_along(np.eye(6))(still, np.ones(len(pairs.scan)), NOISE)
    np.testing.assert_allclose(fit.T_target_source, np.eye(4), atol=1e-14)
    assert fit.cost == pytest.approx(0.0, abs=1e-20)
