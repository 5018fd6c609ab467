"""Sums of the rows of the six motions, and of the shares of motions, beside NumPy's of rows that are kept."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.evidence.both_sides import motion_shares
from dqreg.kernels.evidence.motion_sums import COLUMNS, OVER, SMOOTH, TOTALS, motion_sums
from dqreg.kernels.evidence.patch_sums import BESIDE, patch_sums
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.row_sums import MotionSums, Patches, RowSums

LEVER, COUNT = 1.7, 90
CENTRE = np.array([0.2, -0.1, 0.4])


def correspondences(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points, normals, residuals, weights; some without weight."""
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, COUNT, 3))
    weights = np.where(rng.uniform(size=COUNT) < 0.1, 0.0, rng.uniform(size=COUNT))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.normal(size=COUNT), weights


def test_sums_over_patches_are_those_of_rows_that_are_kept() -> None:
    points, normals, residuals, weights = correspondences(0)
    rng = np.random.default_rng(1)
    bent = normals + np.where(rng.uniform(size=(COUNT, 1)) < 0.3, 0.1, 0.0) * rng.normal(size=(COUNT, 3))
    fine, coarse = np.array([0, 7, 8, 20, 60]), np.array([0, 8, 60])
    basis = rng.normal(size=(6, 4))
    found = MotionSums.of(points, normals, bent, residuals, weights, CENTRE, LEVER, fine, basis)
    rows = basis.T @ plane_rows(points, normals, CENTRE, LEVER)
    kept = RowSums(rows, points, normals, residuals, weights)
    np.testing.assert_allclose(found.information(), kept.information(), rtol=0, atol=1e-12)
    smooth = basis.T @ plane_rows(points, bent, CENTRE, LEVER)
    np.testing.assert_allclose(found.of_smooth(), (smooth * weights) @ smooth.T, rtol=0, atol=1e-12)
    assert found.squares() == pytest.approx(float(weights @ residuals**2))
    for patches in (Patches(fine, np.arange(5)), Patches(coarse, np.array([0, 2, 4]))):
        for sums, others in ((found.over(patches), kept.over(patches)), (found.pulls(patches), kept.pulls(patches))):
            for one, other in zip(sums, others, strict=True):
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_threads_of_patches_add_up_to_the_same_bits() -> None:
    points, normals, residuals, weights = correspondences(2)
    starts = np.array([0, 7, 8, 60])
    given = points, normals, normals, normals[::-1].copy(), residuals, weights, CENTRE, LEVER, starts
    whole, parts = np.zeros((2, 4, COLUMNS))
    together, apart = np.zeros((1, TOTALS)), np.zeros((2, TOTALS))
    motion_sums(0, 4, *given, 4, whole, together)
    for first, last in ((3, 4), (0, 3)):
        motion_sums(first, last, *given, 3, parts, apart)
    np.testing.assert_array_equal(whole, parts)
    np.testing.assert_allclose(together[0], apart.sum(axis=0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(together[0, :COLUMNS], whole.sum(axis=0), rtol=0, atol=1e-12)
    # Of the same rows the plain kernel says the same of what it sums too.
    plain = np.zeros((4, 6 + BESIDE))
    patch_sums(0, 4, plane_rows(points, normals, CENTRE, LEVER), points, normals, residuals, weights, starts, plain)
    np.testing.assert_allclose(whole[:, OVER], plain, rtol=0, atol=1e-13)
    assert not whole[:, SMOOTH:].any()


@pytest.mark.parametrize("counted", [False, True])
@pytest.mark.parametrize("both", [False, True])
def test_shares_of_motions_add_up(counted: bool, both: bool) -> None:
    points, normals, _, weights = correspondences(3)
    rng = np.random.default_rng(4)
    vectors, counts = rng.normal(size=(5, 6)), rng.integers(1, 9, COUNT).astype(float) if counted else np.zeros(0)
    # Of either sign, and none here and there.
    own = normals[rng.permutation(COUNT)] * (rng.uniform(size=(COUNT, 1)) > 0.2)
    sums = np.zeros((5, 2, 5))
    for first in range(0, COUNT, 20):
        given = points, normals, own if both else own[:0], vectors, weights, counts, CENTRE, LEVER, 20, sums
        motion_shares(first, min(first + 20, COUNT), *given)
    along = vectors @ plane_rows(points, normals, CENTRE, LEVER)
    signed = own * np.where((own * normals).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    shares = weights * along * (vectors @ plane_rows(points, signed, CENTRE, LEVER) if both else along)
    found = sums.sum(axis=0)
    np.testing.assert_allclose(found[0], shares.sum(axis=1), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[1], (shares**2 / (counts if counted else 1.0)).sum(axis=1), rtol=1e-13)


def test_products_of_both_sides_add_up() -> None:
    points, normals, residuals, weights = correspondences(5)
    rng = np.random.default_rng(6)
    own = normals[rng.permutation(COUNT)] * (rng.uniform(size=(COUNT, 1)) > 0.2)
    basis, given = rng.normal(size=(6, 4)), (points, normals, normals, residuals, weights, CENTRE, LEVER)
    both, compared = MotionSums.of(*given, np.array([0, 7, 8, 20, 60]), basis, own).of_both()
    signed = own * np.where((own * normals).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    rows, others = (basis.T @ plane_rows(points, side, CENTRE, LEVER) for side in (normals, signed))
    product = (rows * weights) @ others.T
    np.testing.assert_allclose(both, 0.5 * (product + product.T), rtol=0, atol=1e-12)
    np.testing.assert_allclose(compared, (rows * weights * own.any(axis=1)) @ rows.T, rtol=0, atol=1e-12)
