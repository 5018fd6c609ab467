from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.patch_pairs import binned_agreements, covariance_rows, nearest_others


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
def test_the_covariance_is_the_spherical_model(reach: float) -> None:
    rng = np.random.default_rng(0)
    points, normals = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    h = np.minimum(np.linalg.norm(points[:, None] - points, axis=2) / reach, 1.0)
    expected = 2.0 * (1.0 - 1.5 * h + 0.5 * h**3)
    np.fill_diagonal(expected, 0.0)
    covariances, along = np.full((2, 12, 30), np.nan)
    for k in (0, 12, 24):
        rows = slice(k, min(k + 12, 30))
        covariance_rows(k, rows.stop, points, normals, 2.0, reach, covariances, along)
        np.testing.assert_allclose(covariances[: rows.stop - k], expected[rows], atol=1e-14)
        np.testing.assert_allclose(along[: rows.stop - k], (expected * (normals @ normals.T))[rows], atol=1e-13)
