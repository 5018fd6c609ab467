"""Sums over patches and of the shares of motions, beside NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.kernels.patch_sums import BESIDE, carrier_sums, patch_sums


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


@pytest.mark.parametrize("counted", [False, True])
def test_shares_of_motions_add_up(counted: bool) -> None:
    rng = np.random.default_rng(1)
    rows, vectors, weights = rng.normal(size=(6, 50)), rng.normal(size=(6, 5)), rng.uniform(size=50)
    counts = rng.integers(1, 9, 50).astype(float) if counted else np.zeros(0)
    sums = np.zeros((3, 2, 5))
    for first in (0, 20, 40):
        carrier_sums(first, min(first + 20, 50), rows, vectors, weights, counts, 20, sums)
    shares = weights * (vectors.T @ rows) ** 2
    found = sums.sum(axis=0)
    np.testing.assert_allclose(found[0], shares.sum(axis=1), rtol=1e-13)
    np.testing.assert_allclose(found[1], (shares**2 / (counts if counted else 1.0)).sum(axis=1), rtol=1e-13)
