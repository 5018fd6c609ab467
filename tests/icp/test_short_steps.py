from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.icp import Correspondences, estimators
from dqreg.icp.estimators import MAX_STEP_RAD, points_to_planes, short_step, tangent_planes
from dqreg.rigid import pose
from dqreg.solvers.newton import least_cost
from tests.icp.scenes import made_pairs, motion

COUNT = 2_000


@pytest.fixture(autouse=True)
def _of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "GAUSS_NEWTON_PAIRS", COUNT)
    monkeypatch.setattr(estimators, "CHUNK_PAIRS", 300)


def near(turn_rad: float, seed: int = 0, shift: float = 0.0) -> tuple[Correspondences, np.ndarray]:
    """Pairs whose pose of least cost is a turn and a shift away, and weights, some of them zero."""
    pairs = made_pairs(COUNT, seed)
    weights = np.random.default_rng(seed).uniform(0.1, 1.0, COUNT)
    weights[::4] = 0.0
    form = tangent_planes(pairs, weights)
    assert form is not None
    best = least_cost(form, pairs.T_target_source)[0]
    away = motion(turn_rad, turn_rad, seed + 7) @ best
    away[:3, 3] += shift
    closest = dataclasses.replace(pairs.closest, points=pairs.closest.points + shift)
    return Correspondences(pairs.scan, away, closest, pairs.same_sign), weights


@pytest.mark.parametrize("turn_rad", [1e-4, 4e-4])
@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_it_leads_to_the_exact_least_cost_but_for_the_second_order(turn_rad: float, shift: float) -> None:
    pairs, weights = near(turn_rad, shift=shift)
    form = tangent_planes(pairs, weights)
    found = short_step(pairs, weights)
    assert form is not None
    assert found is not None
    exact, cost = least_cost(form, pairs.T_target_source)
    points = pairs.scan.points
    off = np.linalg.norm(pose.apply(found[0], points) - pose.apply(exact, points), axis=1)
    # On a sheet one unit across the first order leaves out the square of the turn, and its product with the noise of
    # the heights, 0.01; beside it the digits of the shift.
    assert off.max() <= turn_rad * (turn_rad + 0.01) + 1e-13 * shift
    np.testing.assert_allclose(found[1], cost, rtol=1e-5, atol=1e-12 * shift)
    np.testing.assert_array_equal(points_to_planes(pairs, weights, 1.0).T_target_source, found[0])


def test_it_solves_the_normal_equations_of_numpy() -> None:
    pairs, weights = near(2e-4)
    found = short_step(pairs, weights)
    assert found is not None
    x, q, n = pairs.moved, pairs.closest.points, pairs.closest.normals
    rows = np.hstack([np.cross(x, n), n]) * np.sqrt(weights)[:, None]
    heights = np.einsum("ij,ij->i", x - q, n) * np.sqrt(weights)
    step, cost = np.linalg.lstsq(rows, -heights, rcond=None)[:2]
    D = found[0] @ pose.inverse(pairs.T_target_source)
    turned = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    np.testing.assert_allclose(turned, step[:3], atol=1e-12)
    np.testing.assert_allclose(found[1], cost[0], rtol=1e-9)


def test_a_long_turn_a_free_motion_and_few_pairs_are_for_the_exact_cost() -> None:
    pairs, weights = near(3.0 * MAX_STEP_RAD)
    assert short_step(pairs, weights) is None
    pairs, weights = near(1e-4)
    up = dataclasses.replace(pairs.closest, normals=np.tile([0.0, 0.0, 1.0], (COUNT, 1)))
    assert short_step(dataclasses.replace(pairs, closest=up), weights) is None
    assert short_step(pairs, np.zeros(COUNT)) is None
    few = pairs.taken(np.arange(COUNT - 1))
    assert short_step(few, weights[:-1]) is None


@pytest.mark.parametrize("threads", ["1", "2", "8"])
def test_the_bits_are_the_same_for_any_number_of_threads(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pairs, weights = near(1e-4)
    alone = short_step(pairs, weights)
    assert alone is not None
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    again = short_step(pairs, weights)
    assert again is not None
    np.testing.assert_array_equal(again[0], alone[0])
    assert again[1] == alone[1]
