from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.evidence.patch_pairs import BLOCK, best_range, binned_agreements, covariance_sums, nearest_others


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40), st.sampled_from([0.0, 0.5, 1.0]))
def test_the_sums_are_those_of_all_pairs(seed: int, count: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    points, normals, residuals = rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), rng.normal(size=count)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    nearest = np.zeros(count)
    far = nearest_others(points, nearest)
    np.testing.assert_allclose(far, apart.max(), rtol=1e-14)
    np.testing.assert_allclose(nearest, (apart + np.diag(np.full(count, np.inf))).min(axis=1), rtol=1e-14)
    far = max(share * far, 1e-3)
    one, other = np.triu_indices(count, 1)
    bins = (apart[one, other] * (8 / far)).astype(int)
    same = np.einsum("ij,ij->i", normals[one], normals[other])
    products, squared = np.zeros(8), np.zeros(8)
    binned_agreements(points, normals, residuals, far, products, squared)
    expected = np.bincount(bins, residuals[one] * residuals[other] * same, max(bins.max() + 1, 8))[:8]
    np.testing.assert_allclose(products, expected, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(squared, np.bincount(bins, same**2, max(bins.max() + 1, 8))[:8], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("reach", [0.1, 1.3, 100.0])
@pytest.mark.parametrize("count", [1, 30, 2 * BLOCK + 7])
def test_the_covariance_is_the_spherical_model(reach: float, count: int) -> None:
    rng = np.random.default_rng(0)
    points, normals = rng.normal(size=(2, count, 3))
    h = np.minimum(np.linalg.norm(points[:, None] - points, axis=2) / reach, 1.0)
    covariance = 2.0 * (1.0 - 1.5 * h + 0.5 * h**3)
    np.fill_diagonal(covariance, 0.0)
    along = covariance * (normals @ normals.T)
    columns, others = rng.normal(size=(count, 5)), rng.normal(size=(count, 3))
    earlier, all_others = np.zeros((count, 5)), np.zeros((count, 3))
    squares = covariance_sums(points, normals, 2.0, reach, columns, others, earlier, all_others)
    np.testing.assert_allclose(earlier, np.tril(covariance) @ columns, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(all_others, along @ others, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(squares, (along**2).sum(), rtol=1e-12)


def test_the_range_that_explains_the_agreements_best_is_found() -> None:
    rng = np.random.default_rng(3)
    ranges, squared = np.array([0.0, 0.2, 0.4, 0.8, 1.6, 3.2]), rng.uniform(1.0, 2.0, 64)
    h = (np.arange(64) + 0.5) * (2.0 / 64) / np.maximum(ranges, 1e-9)[:, None]
    models = np.where(h < 1.0, 1.0 - 1.5 * h + 0.5 * h**3, 0.0)
    products = 0.3 * models[3] * squared + 0.01 * rng.normal(size=64)
    sill, reach, excess = best_range(ranges, products, squared, 2.0, 0.5)
    agreements, norms = models @ products, models**2 @ squared
    assert reach == 0.8
    assert sill == pytest.approx(agreements[3] / norms[3])
    assert excess == pytest.approx(agreements[3] / (0.5 * np.sqrt(norms[3])))
    # Neither beyond the farthest, nor where chance explains it all.
    assert best_range(ranges, products, squared, 0.5, 0.5)[1] <= 0.5
    assert best_range(ranges, -products, squared, 2.0, 0.5) == (0.0, 0.0, 0.0)
