"""Weights that heights, distances and noise lower, beside NumPy's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.steps.lowered_weights import lower_by_distance, lower_by_height, lower_by_noise
from tests.trust.shapes import unit

COUNT = 101


def some_weights(rng: np.random.Generator) -> FloatArray:
    """Some without any."""
    return np.where(rng.uniform(size=COUNT) < 0.2, 0.0, rng.uniform(size=COUNT))


@pytest.mark.parametrize("smoothed", [0.0, 0.7])
def test_heights_over_planes_lower(smoothed: float) -> None:
    rng = np.random.default_rng(0)
    moved, feet = rng.normal(size=(2, COUNT, 3))
    normals, given = unit(rng.normal(size=(COUNT, 3))), some_weights(rng)
    weights = given.copy()
    lower_by_height(moved, feet, normals, 2.5, smoothed, weights)
    heights = np.einsum("ij,ij->i", moved - feet, normals)
    scale = 2.5 * np.hypot(np.median(np.abs(heights[given > 0.0])), smoothed)
    np.testing.assert_allclose(weights, given / (1.0 + (heights / scale) ** 2), rtol=1e-12)


@pytest.mark.parametrize("far", [0.0, 0.5, None])
def test_distances_lower_less_where_planes_are_flat_far_around(far: float | None) -> None:
    rng = np.random.default_rng(1)
    distances, given = rng.exponential(size=COUNT), some_weights(rng)
    flat = np.zeros(0, dtype=bool) if far is None else rng.uniform(size=COUNT) < far
    weights = given.copy()
    lower_by_distance(distances, flat, 3.0, weights)
    ratio = distances / (3.0 * np.median(distances[given > 0.0]))
    power = np.where(flat, 2.0, 4.0) if len(flat) else 4.0
    np.testing.assert_allclose(weights, given / (1.0 + ratio**power), rtol=1e-12)
    assert not weights[given == 0.0].any()


@pytest.mark.parametrize("least", [0.0, 100.0])
def test_noise_of_both_normals_lowers(least: float) -> None:
    rng = np.random.default_rng(2)
    standing, moving = rng.exponential(size=(2, COUNT))
    given = some_weights(rng)
    weights = given.copy()
    lower_by_noise(standing, moving, least, 0.25, weights)
    noise = standing + moving
    # What leaves half: the least, or what a share of those that count is below.
    half = max(least, float(np.quantile(noise[given > 0.0], 0.25)))
    np.testing.assert_allclose(weights, given / (1.0 + (noise / half) ** 8), rtol=1e-12)


@pytest.mark.parametrize(
    "lower",
    [
        lambda zeros, weights: lower_by_height(zeros, zeros, zeros, 2.0, 0.0, weights),
        lambda zeros, weights: lower_by_distance(zeros[:, 0].copy(), np.zeros(0, dtype=bool), 2.0, weights),
    ],
    ids=["height", "distance"],
)
def test_what_is_off_by_nothing_keeps_its_weight(lower: Callable[[FloatArray, FloatArray], None]) -> None:
    weights = np.array([0.5, 0.0, 1.0])
    lower(np.zeros((3, 3)), weights)
    np.testing.assert_array_equal(weights, [0.5, 0.0, 1.0])
    none = np.zeros(3)
    lower(np.ones((3, 3)), none)
    assert not none.any()


def test_the_unit_is_no_matter() -> None:
    rng = np.random.default_rng(3)
    moved, feet = rng.normal(size=(2, COUNT, 3))
    normals, given = unit(rng.normal(size=(COUNT, 3))), some_weights(rng)
    found = []
    for factor in (1.0, 1e3, 1e-3):
        weights = given.copy()
        lower_by_height(factor * moved, factor * feet, normals, 2.0, factor * 0.1, weights)
        lower_by_distance(factor * np.abs(moved[:, 0]), np.zeros(0, dtype=bool), 3.0, weights)
        found.append(weights)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-9)
