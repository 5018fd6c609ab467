from __future__ import annotations

import dataclasses

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.geometry import CloudSurface, PointCloud, prepare_scan
from dqreg.geometry.normals import NEIGHBOURS
from dqreg.icp import ESTIMATORS, Icp, correspond
from dqreg.icp.plane_to_plane import BEND, form_of_pairs, surface_form
from dqreg.rigid import pose, twist
from dqreg.solvers.quadratic import QuadraticForm, derivatives
from tests.icp.scenes import made_pairs

variances = st.floats(1e-3, 1.5)
COUNT = 7


def unit(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    rows = rng.normal(size=(count, 3))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def mahalanobis(
    T: np.ndarray, p: np.ndarray, q: np.ndarray, directions: tuple, spreads: tuple, weights: np.ndarray
) -> float:
    """The cost as its definition says it, pair by pair, with matrices inverted."""
    total = 0.0
    for i in range(len(p)):
        C = np.zeros((3, 3))
        for normal, spread in zip(directions, spreads, strict=True):
            C += np.eye(3) - (1.0 - min(spread[i], 1.0)) * np.outer(normal[i], normal[i])
        d = T[:3, :3] @ p[i] + T[:3, 3] - q[i]
        total += weights[i] * d @ np.linalg.inv(C) @ d
    return total


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10_000), variances, variances, st.sampled_from(["any", "same", "opposite", "square", "no source"])
)
def test_the_form_is_the_brute_force_mahalanobis_cost(seed: int, e_n: float, e_m: float, how: str) -> None:
    rng = np.random.default_rng(seed)
    p, q, n = rng.normal(size=(COUNT, 3)), rng.normal(size=(COUNT, 3)), unit(rng)
    m = {"any": unit(rng), "same": n, "opposite": -n, "no source": np.zeros_like(n)}.get(how)
    if m is None:
        m = np.cross(n, unit(rng))
        m /= np.linalg.norm(m, axis=1, keepdims=True)
    spreads = np.full(COUNT, e_n) * rng.uniform(0.5, 1.0, COUNT), np.full(COUNT, e_m)
    weights, origins = rng.uniform(0.0, 2.0, COUNT), (rng.normal(size=3), rng.normal(size=3))
    form = QuadraticForm(surface_form(p, q, (n, m), spreads, weights, origins), *origins)
    T = pose.random(rng, reach=2.0)
    expected = mahalanobis(T, p, q, (n, m), spreads, weights)
    assert form.value(T) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_its_slope_is_that_of_the_brute_force_cost() -> None:
    # Central differences, step 1e-5 of sizes about one: good to 1e-9.
    rng = np.random.default_rng(3)
    p, q, n, m = rng.normal(size=(COUNT, 3)), rng.normal(size=(COUNT, 3)), unit(rng), unit(rng)
    spreads, weights = (rng.uniform(0.02, 0.5, COUNT), rng.uniform(0.02, 0.5, COUNT)), rng.uniform(0.1, 2.0, COUNT)
    origins = (np.zeros(3), np.zeros(3))
    form = QuadraticForm(surface_form(p, q, (n, m), spreads, weights, origins), *origins)
    T = pose.random(rng, reach=1.0)
    slope = derivatives(form, T)[0]
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        ahead, behind = (mahalanobis(twist.exp(s) @ T, p, q, (n, m), spreads, weights) for s in (step, -step))
        assert slope[k] == pytest.approx((ahead - behind) / 2e-5, abs=1e-7 * np.linalg.norm(slope))


def test_the_pairs_bring_their_own_normals_and_variances() -> None:
    pairs = made_pairs()
    stands = np.random.default_rng(1).uniform(0.0, 0.3, len(pairs.scan))
    pairs = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, variances=stands))
    weights = np.random.default_rng(2).uniform(0.0, 1.0, len(pairs.scan))
    weights[::3] = 0.0
    scan, T = pairs.scan, pairs.T_target_source
    moves = np.where(scan.levers > 0.0, scan.residuals**2 / (NEIGHBOURS * np.maximum(scan.levers, 1e-300)), 0.0)
    expected = mahalanobis(
        T,
        scan.points,
        pairs.closest.points,
        (pairs.closest.normals, scan.normals @ T[:3, :3].T),
        (BEND + stands, BEND + moves),
        2.0 * BEND * weights,
    )
    assert form_of_pairs(pairs, weights).value(T) == pytest.approx(expected, rel=1e-9)


def test_faces_that_agree_are_planes_and_faces_that_differ_fade() -> None:
    up, aside = np.array([[0.0, 0, 1]]), np.array([[1.0, 0, 0]])
    flat, point, zero = np.array([BEND]), np.zeros((1, 3)), (np.zeros(3), np.zeros(3))

    def cost(offset: list[float], m: np.ndarray) -> float:
        form = surface_form(point, point - offset, (up, m), (flat, flat), np.array([2.0 * BEND]), zero)
        return QuadraticForm(form, *zero).value(np.eye(4))

    assert cost([0.0, 0, 1], up) == pytest.approx(1.0)
    assert cost([0.0, 1, 0], up) == pytest.approx(BEND)
    assert cost([0.0, 0, 1], aside) < 0.1


def test_the_loop_with_it_meets_the_pose_of_exact_clouds() -> None:
    rng = np.random.default_rng(0)
    cloud = rng.uniform(-1.0, 1.0, size=(3_000, 3))
    cloud[np.arange(3_000), np.arange(3_000) % 3] = np.sign(cloud[np.arange(3_000), np.arange(3_000) % 3])
    T = twist.exp(np.array([0.01, -0.02, 0.015, 0.01, 0.02, -0.01]))
    scan = prepare_scan(PointCloud(pose.apply(pose.inverse(T), cloud)))
    run = Icp(ESTIMATORS["generalised"]).run(scan, CloudSurface(PointCloud(cloud)), np.eye(4))
    np.testing.assert_allclose(run.T_target_source, T, atol=1e-12)
    assert correspond(scan, CloudSurface(PointCloud(cloud)), T).closest.variances is not None
