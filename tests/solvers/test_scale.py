from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import pose, twist
from dqreg.solvers.scale import SurfaceMatches, scale_step

FloatArray = NDArray[np.float64]


def planes(rng: np.random.Generator, n: int = 300) -> tuple[FloatArray, FloatArray]:
    normals = rng.normal(size=(n, 3))
    return rng.normal(size=(n, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("factor", [0.97, 1.0, 1.001, 1.04])
def test_one_step_undoes_a_small_scale_and_motion_to_first_order(factor: float) -> None:
    rng = np.random.default_rng(3)
    q, n = planes(rng)
    T = twist.exp(1e-3 * rng.normal(size=6))
    source = rng.normal(size=(len(q), 3))
    # The truth: q = T (factor p). The step begins at the unit pose and the scale 1.
    target = pose.apply(T, factor * source)
    weights = rng.uniform(0.5, 1.0, size=len(q))
    step = scale_step(SurfaceMatches(source, target, n, weights))
    small = 2.0 * ((factor - 1.0) ** 2 + 1e-5)
    assert step.factor == pytest.approx(factor, abs=small)
    found = step.moved(np.eye(4))
    assert np.abs(pose.apply(found, step.factor * source) - target).max() <= 10.0 * small
    again = scale_step(SurfaceMatches(pose.apply(found, step.factor * source), target, n, weights))
    last = again.moved(found)
    assert again.factor * step.factor == pytest.approx(factor, abs=20.0 * small**2 + 1e-12)
    assert np.abs(last - T).max() <= 100.0 * small**2 + 1e-12


def test_the_pose_follows_the_scale_along_the_valley() -> None:
    # Oracle: the pose solved for at a scale held a little to the side.
    rng = np.random.default_rng(5)
    source, n = planes(rng)
    T = pose.random(rng, reach=3.0)
    target = pose.apply(T, source)
    step = scale_step(SurfaceMatches(target, target, n, np.ones(len(n))))
    centre, small = np.array([0.3, -2.0, 1.0]), 1e-5
    aside = pose.apply(T, (1.0 + small) * source)
    moved = scale_step(SurfaceMatches(aside, target, n, np.ones(len(n))), hold=True).moved(T)
    about = pose.from_parts(np.eye(3), centre)
    change = twist.log(pose.inverse(about) @ moved @ pose.inverse(T) @ about) / small
    np.testing.assert_allclose(change, step.follow(T, centre), atol=1e-3)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e5])
def test_the_step_and_its_sigma_do_not_depend_on_the_unit_and_sigma_is_what_repeats_scatter(size: float) -> None:
    factors, sigmas = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        q, n = planes(rng)
        noisy = q + 1e-3 * rng.normal(size=(len(q), 1)) * n
        step = scale_step(SurfaceMatches(size * noisy, size * q, n, np.ones(len(q))))
        factors.append(np.log(step.factor))
        sigmas.append(step.sigma)
    # 60 repeats know a standard deviation to 9 %, and of two estimates the larger is taken.
    assert np.std(factors) == pytest.approx(np.mean(sigmas), rel=0.35)


def test_what_leaves_the_scale_free_is_refused_but_for_a_scale_that_is_held() -> None:
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.normal(size=(100, 2)), np.zeros(100)])
    up = np.tile([0.0, 0, 1], (100, 1))
    with pytest.raises(DegenerateGeometryError, match="scale free"):
        scale_step(SurfaceMatches(flat, flat, up, np.ones(100)))
    with pytest.raises(DegenerateGeometryError, match="too few"):
        scale_step(SurfaceMatches(flat[:5], flat[:5], up[:5], np.ones(5)))
    step = scale_step(SurfaceMatches(flat + np.array([0.0, 0.0, 0.1]), flat, up, np.ones(100)), hold=True)
    assert step.factor == 1.0
    assert step.shift[2] == pytest.approx(-0.1)


def test_noise_makes_no_source_smaller() -> None:
    # The law: at the true scale the step is zero in the mean. Where the places of the points themselves told what the
    # scale moves, each square of their noise asked for less of it: four standard deviations here.
    steps = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        q, n = planes(rng, 2000)
        step = scale_step(SurfaceMatches(q + 0.1 * rng.normal(size=(len(q), 1)) * n, q, n, np.ones(len(q))))
        steps.append(np.log(step.factor) / step.sigma)
    # Standard error of the mean 0.16.
    assert abs(np.mean(steps)) < 0.6
