from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import CloudSurface, PointCloud, prepare_scan
from dqreg.icp import ESTIMATORS, Pairs, correspond, points_and_normals, points_only, points_to_planes, svd_points
from dqreg.icp.estimators import Estimator
from dqreg.rigid import pose, twist
from dqreg.solvers import horn, solve
from tests.icp.scenes import made_pairs

EACH = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
CLOSED_FORMS = [name for name in ESTIMATORS if name not in ("plane", "generalised")]
EACH_CLOSED_FORM = pytest.mark.parametrize("estimator", [ESTIMATORS[n] for n in CLOSED_FORMS], ids=CLOSED_FORMS)
NOISE = 0.01


def some_weights(pairs: Pairs) -> np.ndarray:
    weights = np.random.default_rng(5).uniform(0.1, 1.0, len(pairs.scan))
    weights[::4] = 0.0
    return weights


def with_parts(pairs: Pairs, scan: dict[str, np.ndarray], closest: dict[str, np.ndarray]) -> Pairs:
    return dataclasses.replace(
        pairs, scan=dataclasses.replace(pairs.scan, **scan), closest=dataclasses.replace(pairs.closest, **closest)
    )


def test_points_alone_are_arun_and_horn() -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    dq = points_only(pairs, weights, NOISE).T_target_source
    np.testing.assert_allclose(dq, svd_points(pairs, weights, NOISE).T_target_source, atol=1e-10)
    kept = weights > 0.0
    other = horn(pairs.scan.points[kept], pairs.closest.points[kept], point_weights=weights[kept])
    np.testing.assert_allclose(dq, other.T_target_source, atol=1e-10)


@pytest.mark.parametrize("noise", [NOISE, 1e-6, np.inf])
def test_points_and_normals_are_solve_with_the_weights_written_out(noise: float) -> None:
    pairs = made_pairs()
    scan, beta = pairs.scan, some_weights(pairs)
    # alpha / beta = lever noise^2 / sigma_r^2, the ratio of the variances held at one.
    alpha = beta * scan.levers * np.minimum(noise**2 / scan.residuals**2, 1.0)
    moved = pose.rotate(pairs.T_target_source, scan.normals)
    sign = np.where(np.sum(moved * pairs.closest.normals, axis=1) < 0.0, -1.0, 1.0)[:, None]
    expected = solve(scan.points, pairs.closest.points, sign * scan.normals, pairs.closest.normals, beta, alpha)
    found = points_and_normals(pairs, beta, noise).T_target_source
    np.testing.assert_allclose(found, expected.T_target_source, atol=1e-12)
    if noise == np.inf:
        assert np.abs(found - points_only(pairs, beta, noise).T_target_source).max() > 1e-5


def test_without_normals_both_closed_forms_are_one() -> None:
    pairs = made_pairs()
    beta, nothing = some_weights(pairs), np.zeros_like(pairs.scan.normals)
    expected = points_only(pairs, beta, NOISE).T_target_source
    unknown_here = with_parts(pairs, {"levers": np.zeros(len(pairs.scan)), "normals": nothing}, {})
    unknown_there = with_parts(pairs, {}, {"normals": nothing})
    for bare in (unknown_here, unknown_there):
        np.testing.assert_array_equal(points_and_normals(bare, beta, NOISE).T_target_source, expected)


@EACH
def test_pairs_of_weight_zero_have_no_say(estimator: Estimator) -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    out = weights == 0.0
    spoilt = {name: getattr(pairs.scan, name).copy() for name in ("points", "normals", "levers", "residuals")}
    there = {name: getattr(pairs.closest, name).copy() for name in ("points", "normals")}
    for array in (*spoilt.values(), *there.values()):
        array[out] = 1e3
    expected = estimator(pairs, weights, NOISE).T_target_source
    found = estimator(with_parts(pairs, spoilt, there), weights, NOISE).T_target_source
    np.testing.assert_array_equal(found, expected)


@EACH
def test_the_scale_of_the_weights_has_no_say(estimator: Estimator) -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    expected = estimator(pairs, weights, NOISE).T_target_source
    np.testing.assert_allclose(estimator(pairs, 1e-6 * weights, NOISE).T_target_source, expected, atol=1e-12)


@EACH
def test_exact_pairs_give_the_exact_pose(estimator: Estimator) -> None:
    pairs = made_pairs()
    T = pairs.T_target_source
    exact = {"points": pose.apply(T, pairs.scan.points), "normals": pose.rotate(T, pairs.scan.normals)}
    found = estimator(with_parts(pairs, {}, exact), some_weights(pairs), NOISE).T_target_source
    np.testing.assert_allclose(found, T, atol=1e-13)


@EACH_CLOSED_FORM
def test_the_pose_is_absolute_and_forgets_where_the_pairs_were_found(estimator: Estimator) -> None:
    pairs = made_pairs(same_sign=True)
    elsewhere = dataclasses.replace(pairs, T_target_source=np.eye(4))
    weights = some_weights(pairs)
    expected = estimator(pairs, weights, NOISE).T_target_source
    np.testing.assert_array_equal(estimator(elsewhere, weights, NOISE).T_target_source, expected)


@EACH
@pytest.mark.parametrize("shape", ["line", "place"])
def test_degenerate_pairs_are_refused(estimator: Estimator, shape: str) -> None:
    along = np.linspace(0.0, 1.0, 30)[:, None] * [1.0, 2.0, -0.5]
    scan = prepare_scan(PointCloud(along))
    pairs = correspond(scan, CloudSurface(PointCloud(along)), np.eye(4))
    if shape == "place":
        same = np.tile(pairs.closest.points[:1], (len(scan), 1))
        pairs = with_parts(pairs, {"points": same}, {"points": same})
    with pytest.raises(DegenerateGeometryError):
        estimator(pairs, np.ones(len(scan)), NOISE)


@EACH
def test_no_weight_at_all_is_refused(estimator: Estimator) -> None:
    pairs = made_pairs()
    with pytest.raises((DegenerateGeometryError, ValueError)):
        estimator(pairs, np.zeros(len(pairs.scan)), NOISE)


def test_points_to_planes_end_where_the_planes_feel_no_force() -> None:
    pairs = made_pairs()
    weights, normals = some_weights(pairs), pairs.closest.normals
    T = points_to_planes(pairs, weights, NOISE).T_target_source
    moved = pose.apply(T, pairs.scan.points)
    gaps = np.sum((moved - pairs.closest.points) * normals, axis=1)
    # The gradient over turns about the origin and shifts, against what the same forces would add up to at worst.
    arms = np.column_stack([np.cross(moved, normals), normals])
    force = (weights * gaps) @ arms
    assert np.linalg.norm(force) <= 1e-10 * np.sum(weights * np.abs(gaps) * np.linalg.norm(arms, axis=1))
    before = pose.apply(pairs.T_target_source, pairs.scan.points)
    assert weights @ gaps**2 < weights @ np.sum((before - pairs.closest.points) * normals, axis=1) ** 2


def test_what_no_plane_feels_stays_as_it_was() -> None:
    # All normals up: shifts along the plane and turns about the normal are free.
    pairs = made_pairs(same_sign=True)
    up = np.tile([0.0, 0.0, 1.0], (len(pairs.scan), 1))
    flat = with_parts(pairs, {}, {"normals": up})
    T = points_to_planes(flat, np.ones(len(pairs.scan)), NOISE).T_target_source
    step = T @ pose.inverse(pairs.T_target_source)
    turn, shift = np.split(twist.log(step), 2)
    assert abs(turn[2]) <= 1e-3 * np.linalg.norm(turn)
    gap = pose.apply(T, pairs.scan.points)[:, 2] - pairs.closest.points[:, 2]
    assert abs(gap.mean()) <= 1e-12
    assert np.linalg.norm(shift[:2]) <= 0.1
