"""Sums over patches, beside NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.evidence.patch_sums import BESIDE, joined_sums, patch_means, patch_sums


def test_patches_hold_what_numpy_sums() -> None:
    rng = np.random.default_rng(0)
    rows, points, normals = rng.normal(size=(4, 90)), rng.normal(size=(90, 3)), rng.normal(size=(90, 3))
    residuals, weights, starts = rng.normal(size=90), rng.uniform(size=90), np.array([0, 7, 8, 60])
    sums = np.zeros((4, 4 + BESIDE))
    # In two goes, as two threads would.
    for first, last in ((0, 3), (3, 4)):
        patch_sums(first, last, rows, points, normals, residuals, weights, starts, sums)
    columns = np.vstack([rows * residuals, np.ones(90), points.T, normals.T, residuals]) * weights
    np.testing.assert_allclose(sums.T, np.add.reduceat(columns, starts, axis=1), rtol=0, atol=1e-13)


def test_patches_of_several_hold_the_sums_of_all_of_them() -> None:
    sums, places, found = np.random.default_rng(1).normal(size=(9, 5)), np.array([0, 2, 3]), np.zeros((3, 3))
    joined_sums(places, sums, np.array([4, 0, 2]), found)
    np.testing.assert_allclose(found, np.add.reduceat(sums[:, [4, 0, 2]], places, axis=0), rtol=0, atol=1e-13)


def test_means_leave_light_patches_out_and_agree_with_their_next() -> None:
    rng = np.random.default_rng(2)
    sums = rng.normal(size=(40, BESIDE))
    sums[:, 0] = np.where(np.arange(40) % 9 == 4, 1e-3, rng.uniform(0.5, 1.0, 40))
    sums[7] = 0.0
    (points, normals), (residuals, weights) = np.zeros((2, 40, 3)), np.zeros((2, 40))
    variance, agreement = patch_means(sums, 0.1, 3, points, normals, residuals, weights)
    light = sums[:, 0] < 0.1
    total = np.maximum(sums[:, 0], np.finfo(float).tiny)[:, None]
    means = np.where(light[:, None], 0.0, sums[:, 4:] / total)
    np.testing.assert_array_equal(points, sums[:, 1:4] / total)
    np.testing.assert_array_equal(np.column_stack([normals, residuals]), means)
    np.testing.assert_array_equal(weights, total[:, 0])
    assert variance == pytest.approx(float((residuals[~light] ** 2).mean()))
    apart = np.subtract.outer(np.arange(40), np.arange(40))
    cosines = np.where((apart > 0) & (apart <= 3), normals @ normals.T, 0.0)
    expected = float(residuals @ cosines @ residuals) / (variance * np.linalg.norm(cosines))
    assert agreement == pytest.approx(expected)
