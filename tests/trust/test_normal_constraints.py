"""What the normals of one cloud alone hold, and how many points carry a motion."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.solvers.quadratic import plane_rows
from dqreg.solvers.row_sums import NO_NORMALS, MotionSums
from dqreg.trust.normal_constraints import MIN_CONFIRMED_SHARE, carriers_of, unconfirmed
from tests.trust.shapes import box, cylinder, plane, unit

LEVER, CENTRE, FEW = 1.5, np.zeros(3), np.zeros(1, dtype=np.int64)


def denied(points: FloatArray, normals: FloatArray, own: FloatArray, least: float = 1e-3) -> FloatArray:
    """Motions that the normals of the target hold and those of the scan do not confirm, (6, k)."""
    n = len(points)
    sums = MotionSums.of(points, normals, normals, np.zeros(n), np.ones(n), CENTRE, LEVER, FEW, np.eye(6), own)
    return unconfirmed(sums, least)


def noisy(normals: FloatArray, seed: int, sigma: float = 0.03) -> FloatArray:
    return unit(normals + sigma * np.random.default_rng(seed).normal(size=normals.shape))


@pytest.mark.parametrize("shape", [plane, cylinder, box])
def test_what_both_say_is_confirmed_whatever_the_signs(shape: object) -> None:
    points, normals = shape(np.random.default_rng(0), 400)  # type: ignore[operator]
    normals, signs = noisy(normals, 1), np.random.default_rng(2).choice([-1.0, 1.0], (400, 1))
    assert denied(points, normals, normals).shape == (6, 0)
    assert denied(points, normals, signs * normals).shape == (6, 0)


@pytest.mark.parametrize(("shape", "free"), [(plane, [2, 3, 4]), (cylinder, [2, 5]), (box, [])])
def test_errors_hold_what_the_shape_leaves_free_and_are_not_confirmed(shape: object, free: list[int]) -> None:
    points, normals = shape(np.random.default_rng(0), 4_000)  # type: ignore[operator]
    found = denied(points, noisy(normals, 1), noisy(normals, 2))
    assert found.shape[1] == len(free)
    # They are these motions but for what the errors tilt them.
    axes = np.linalg.qr(found)[0]
    assert np.linalg.norm(axes[free]) ** 2 == pytest.approx(len(free), abs=0.05)
    # Bent alike on both sides, as a surface is, the normals do hold them.
    assert denied(points, noisy(normals, 1), noisy(normals, 1)).shape == (6, 0)


def test_where_the_scan_has_no_normals_nothing_is_denied() -> None:
    points, normals = plane(np.random.default_rng(0), 4_000)
    assert denied(points, noisy(normals, 1), 0.0 * normals).shape == (6, 0)


def test_what_holds_less_than_the_least_needs_no_confirmation() -> None:
    points, normals = plane(np.random.default_rng(0), 4_000)
    both = noisy(normals, 1), noisy(normals, 2)
    assert denied(points, *both, least=1e-3).shape[1] == 3
    assert denied(points, *both, least=20.0).shape[1] == 0


def test_combinations_are_of_the_unknowns_that_were_left() -> None:
    points, normals = plane(np.random.default_rng(0), 2_000)
    both, n = (noisy(normals, 1), noisy(normals, 2)), len(points)
    basis = np.eye(6)[:, [0, 3, 5]]
    sums = MotionSums.of(points, both[0], both[0], np.zeros(n), np.ones(n), CENTRE, LEVER, FEW, basis, both[1])
    found = unconfirmed(sums, 1e-3)
    assert found.shape == (3, 1)
    assert abs(found[1, 0]) > 0.99 * np.linalg.norm(found)
    one, compared = sums.of_both()
    assert found[:, 0] @ one @ found[:, 0] <= MIN_CONFIRMED_SHARE * (found[:, 0] @ compared @ found[:, 0])


def carriers(points: FloatArray, normals: FloatArray, own: FloatArray = NO_NORMALS, **of: FloatArray) -> FloatArray:
    weights = of.get("weights", np.ones(len(points)))
    return carriers_of(points, normals, own, np.eye(6), weights, of.get("counts"), CENTRE, LEVER)


def test_equal_shares_are_counted_one_by_one() -> None:
    points, normals = plane(np.random.default_rng(0), 50)
    found = carriers(points, normals)
    assert found[5] == pytest.approx(50.0)
    # Nothing carries what slides.
    np.testing.assert_array_equal(found[[2, 3, 4]], 0.0)
    # A motion of the points alone is carried by fewer than there are.
    assert (found[:2] > 1.0).all()
    assert (found[:2] < 50.0).all()


def test_a_single_point_that_resists_is_one_and_its_weight_no_matter() -> None:
    points, normals = plane(np.random.default_rng(0), 50)
    normals[7] = [1.0, 0.0, 0.0]
    for factor in (1e-3, 1.0, 1e3):
        assert carriers(points, normals, weights=np.full(50, factor))[3] == pytest.approx(1.0)
    doubled = np.where(np.arange(50) == 7, 0.0, 1.0)
    assert carriers(points, normals, weights=doubled)[3] == 0.0


def test_a_row_for_many_counts_as_all_of_them() -> None:
    points, normals = box(np.random.default_rng(0), 30)
    counts = np.random.default_rng(1).integers(1, 9, 30)
    rows = np.repeat(np.arange(30), counts)
    found = carriers(points, normals, weights=counts.astype(float), counts=counts.astype(float))
    np.testing.assert_allclose(found, carriers(points[rows], normals[rows]), rtol=1e-12)


def test_of_both_sides_it_is_what_both_say() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng, 300)
    own, weights = noisy(normals, 1, 0.3), rng.uniform(size=300)
    # Where the two differ by more than a right angle, the other way.
    signed = own * np.where((own * normals).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    rows, others = (plane_rows(points, side, CENTRE, LEVER) for side in (normals, signed))
    shares = weights * rows * others
    expected = np.maximum(shares.sum(axis=1), 0.0) ** 2 / (shares**2).sum(axis=1)
    np.testing.assert_allclose(carriers(points, normals, own, weights=weights), expected, rtol=1e-10)
    # Where they contradict each other, none does.
    points, normals = plane(rng, 300)
    normals[:, :2] = [0.3, 0.0]
    np.testing.assert_array_equal(carriers(points, unit(normals), unit(normals * [-1.0, 1.0, 1.0]))[3], 0.0)
