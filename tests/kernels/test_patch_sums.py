"""Sums over patches, beside NumPy's."""

from __future__ import annotations

import numpy as np

from dqreg.kernels.patch_sums import BESIDE, joined_sums, patch_sums


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
    joined_sums(places, sums, 1, 4, found)
    np.testing.assert_allclose(found, np.add.reduceat(sums[:, 1:4], places, axis=0), rtol=0, atol=1e-13)
