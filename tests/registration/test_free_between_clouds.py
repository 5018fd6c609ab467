"""Motions that map a scene onto itself are free between two clouds too, whatever the errors of their normals feign."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from tests.strategies import FloatArray

NOISE, POINTS = 0.005, 6_000
HALF, WIDE, HIGH = 12.0, 1.5, 1.2
Scene = Callable[[np.random.Generator], FloatArray]


def corridor(rng: np.random.Generator, ends: float = 0.0) -> FloatArray:
    """Walls, floor and ceiling along x; a share of the points on a wall across it."""
    x, y, z = (rng.uniform(-half, half, POINTS) for half in (HALF, WIDE, HIGH))
    wall = rng.integers(4, size=POINTS)
    y[wall < 2] = WIDE * np.where(wall[wall < 2], 1.0, -1.0)
    z[wall >= 2] = HIGH * np.where(wall[wall >= 2] == 2, 1.0, -1.0)
    across = int(ends * POINTS)
    x[:across] = HALF
    y[:across] = rng.uniform(-WIDE, WIDE, across)
    z[:across] = rng.uniform(-HIGH, HIGH, across)
    return np.column_stack([x, y, z]) + NOISE * rng.normal(size=(POINTS, 3))


def tube(rng: np.random.Generator) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi, POINTS)
    points = np.column_stack([rng.uniform(-5.0, 5.0, POINTS), np.cos(angle), np.sin(angle)])
    return np.asarray(points + NOISE * rng.normal(size=points.shape))


def ball(rng: np.random.Generator) -> FloatArray:
    points = rng.normal(size=(POINTS, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1)[:, None] + NOISE * rng.normal(size=points.shape))


def floor(rng: np.random.Generator) -> FloatArray:
    return np.column_stack([rng.uniform(-2.0, 2.0, (POINTS, 2)), NOISE * rng.normal(size=POINTS)])


# The scene, the motions that map it onto itself, and the kinds of these.
SCENES: dict[str, tuple[Scene, tuple[int, ...]]] = {
    "corridor": (corridor, (3,)),
    "tube": (tube, (0, 3)),
    "ball": (ball, (0, 1, 2)),
    "floor": (floor, (2, 3, 4)),
}


@cache
def registered(name: str) -> dqreg.Registration:
    make, free = SCENES[name]
    rng = np.random.default_rng(0)
    twist = np.zeros(6)
    twist[list(free)] = 0.1
    return dqreg.register(make(rng), make(rng), pose.exp(twist), verdict=False)


@pytest.mark.parametrize("name", SCENES)
def test_what_maps_a_scene_onto_itself_is_free(name: str) -> None:
    result, free = registered(name), SCENES[name][1]
    kinds = sorted(motion.kind or "" for motion in result.observability if motion.is_free)
    assert kinds == sorted("rotation" if k < 3 else "translation" for k in free)
    is_known = np.isfinite(np.diag(result.covariance))
    assert not is_known[list(free)].any()
    # Errors of the normals tilt the free motions: they take no part in the others for that, as on a part.
    assert np.flatnonzero(is_known).tolist() == np.setdiff1d(np.arange(6), free).tolist()
    assert all(np.isnan(motion.sigma) == motion.is_free for motion in result.observability)


def test_errors_of_what_is_held_are_as_large_as_the_covariance_says() -> None:
    make, free = SCENES["tube"]
    held, chi2 = np.setdiff1d(np.arange(6), free), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        result = dqreg.register(make(rng), make(rng), "identity", verdict=False)
        error, covariance = np.asarray(pose.log(result.T_target_source))[held], result.covariance[np.ix_(held, held)]
        chi2.append(error @ np.linalg.solve(covariance, error))
    # Its mean is 4; errors of half or twice the size would be 1 or 16.
    assert 1.5 < np.mean(chi2) < 9.0


@pytest.mark.parametrize("name", SCENES)
def test_a_graph_is_told_nothing_of_free_motions_and_much_of_the_others(name: str) -> None:
    result, free = registered(name), SCENES[name][1]
    information = result.information_in("centre")
    held = np.setdiff1d(np.arange(6), free)
    # The free motions are found to the errors of the normals: their share of what else is known.
    assert np.diag(information)[list(free)].max() < 1e-3 * np.diag(information)[held].min()
    assert np.sqrt(1.0 / np.diag(information)[held]).max() < NOISE
    values = np.linalg.eigvalsh(information)
    np.testing.assert_allclose(values[: len(free)], 0.0, atol=1e-9 * values[-1])


def test_a_file_keeps_what_is_free(tmp_path_factory: pytest.TempPathFactory) -> None:
    result, path = registered("corridor"), tmp_path_factory.mktemp("free") / "result.json"
    result.save(path)
    again = dqreg.Registration.load(path)
    np.testing.assert_array_equal(again.covariance, result.covariance)
    np.testing.assert_array_equal(again.information_in("source"), result.information_in("source"))
    assert [motion.is_free for motion in again.observability] == [motion.is_free for motion in result.observability]


def test_the_verdict_names_the_motion_and_the_pose_keeps_the_start_along_it() -> None:
    rng = np.random.default_rng(1)
    scan, target = corridor(rng), corridor(rng)
    start = pose.from_parts(np.eye(3), [0.1, 0.02, -0.02])
    result = dqreg.register(scan, target, start)
    assert result.verdict.level == "suspect"
    assert "unconstrained" in result.verdict.codes
    assert "weakly_constrained" not in result.verdict.codes
    np.testing.assert_allclose(result.T_target_source[:3, 3], [0.1, 0.0, 0.0], atol=2e-3)


def test_a_wall_across_the_corridor_holds_it() -> None:
    rng = np.random.default_rng(2)
    start = pose.from_parts(np.eye(3), [0.05, 0.0, 0.0])
    result = dqreg.register(corridor(rng, 0.05), corridor(rng, 0.05), start)
    assert np.isfinite(result.covariance).all()
    assert np.sqrt(result.covariance[3, 3]) < 2.0 * NOISE
    assert abs(result.T_target_source[0, 3]) < 3.0 * np.sqrt(result.covariance[3, 3])


def test_what_was_known_beforehand_is_all_that_is_known_of_a_free_motion() -> None:
    rng = np.random.default_rng(3)
    scan, target, sigma = corridor(rng), corridor(rng), 0.01
    known = np.diag(np.r_[[1e2] * 3, sigma**2, 1e4, 1e4])
    result = dqreg.register(scan, target, prior=(np.eye(4), known), verdict=False)
    assert not any(motion.is_free for motion in result.observability)
    assert np.sqrt(result.covariance[3, 3]) == pytest.approx(sigma, rel=0.02)
    assert np.sqrt(np.diag(result.covariance)[[4, 5]]).max() < NOISE
