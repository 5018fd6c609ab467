from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.rigid import pose, twist
from dqreg.trust import Information, covariance_of, information_of
from dqreg.trust.limits import MIN_CARRIERS_OF_BOTH
from tests.strategies import rotations
from tests.trust.shapes import FloatArray, box, cylinder, judged, plane, sphere

SHAPES = {"plane": (plane, 3), "sphere": (sphere, 3), "cylinder": (cylinder, 2), "box": (box, 0)}


@pytest.mark.parametrize("shape", SHAPES)
@settings(deadline=None, max_examples=15)
@given(R=rotations(), place=st.sampled_from([[0.0, 0, 0], [0.4, -0.2, 0.3]]), size=st.sampled_from([1e-6, 1.0, 1e6]))
def test_a_shape_leaves_free_what_maps_it_onto_itself(
    shape: str, R: FloatArray, place: list[float], size: float
) -> None:
    make, free = SHAPES[shape]
    points, normals = make(np.random.default_rng(0))
    information = judged(size * (points @ R.T + place), normals @ R.T, lever=1.5 * size)
    assert int(information.free.sum()) == free
    # What is held is held well by all four shapes: nothing is near the limit.
    assert information.values[information.free].max(initial=0.0) < 1e-12
    assert information.values[~information.free].min() > 1e-2


def test_the_hessian_of_the_cost_is_the_information() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    weights, lever, centre = rng.uniform(0.0, 1.0, len(points)), 1.7, np.array([0.2, -0.1, 0.4])
    information = information_of(points, normals, np.zeros(len(points)), weights, lever, centre)
    unscale = np.r_[[lever] * 3, [1.0] * 3]
    matrix = (information.vectors * information.values) @ information.vectors.T * information.weight
    matrix *= unscale[:, None] * unscale

    def cost(step: FloatArray) -> float:
        moved = pose.apply(pose.about(twist.exp(step), centre), points)
        return float(weights @ np.einsum("ni,ni->n", moved - points, normals) ** 2)

    h, axes = 1e-3, np.eye(6)
    for i in range(6):
        for j in range(6):
            a, b = h * axes[i], h * axes[j]
            second = (cost(a + b) - cost(a - b) - cost(b - a) + cost(-a - b)) / (4.0 * h * h)
            # The cost is twice the quadratic form's half; the differences err by h^2 of the fourth derivative.
            assert 0.5 * second == pytest.approx(matrix[i, j], abs=20.0 * h**2 * information.weight)


def test_estimates_scatter_as_the_covariance_says() -> None:
    # The linear problem itself: distances along the normals are noise, and the pose is their least-squares fit.
    rng = np.random.default_rng(0)
    points, normals = box(rng, 200)
    sigma, draws = 1e-3, 4_000
    rows = np.hstack([np.cross(points, normals), normals])
    noise = sigma * rng.normal(size=(draws, len(points)))
    fits = noise @ np.linalg.pinv(rows).T
    residuals = noise - fits @ rows.T
    claims = np.array([covariance_of(judged(points, normals, r)) for r in residuals[:400]])
    claim = claims.mean(axis=0)
    # Averaged over draws the claim is exact but for its own scatter: sigma^2 from 194 degrees, 400 times.
    exact = sigma**2 * np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(claim, exact, rtol=0, atol=5.0 * np.sqrt(2 / 194 / 400) * np.abs(exact).max())
    # Whitened, the sample covariance of m draws is the identity within about (sqrt(6) + 5) / sqrt(m) twice (Wishart).
    whiten = np.linalg.inv(np.linalg.cholesky(claim))
    ratios = np.linalg.eigvalsh(whiten @ (fits.T @ fits / draws) @ whiten.T)
    edge = 2.0 * (np.sqrt(6.0) + 5.0) / np.sqrt(draws)
    assert 1.0 - edge < ratios.min()
    assert ratios.max() < 1.0 + edge
    # One by one: six degrees of freedom, a mean squared Mahalanobis length of 6 with a variance of 12 (and a little
    # more, because sigma is estimated from 194).
    nees = np.einsum("ni,nij,nj->n", fits[:400], np.linalg.inv(claims), fits[:400])
    assert nees.mean() == pytest.approx(6.0 * 194 / 192, abs=5.0 * np.sqrt(13.0 / 400))


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_lengths_scale_with_the_unit_and_angles_do_not(factor: float) -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    residuals = 1e-3 * rng.normal(size=len(points))
    plain = covariance_of(judged(points, normals, residuals))
    scaled = covariance_of(judged(factor * points, normals, factor * residuals, lever=1.5 * factor))
    units = np.r_[[1.0] * 3, [factor] * 3]
    np.testing.assert_allclose(scaled, plain * units[:, None] * units, rtol=1e-9, atol=0)


def test_the_lever_is_a_matter_of_units_only() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    residuals = 1e-3 * rng.normal(size=len(points))
    one, other = (covariance_of(judged(points, normals, residuals, lever=lever)) for lever in (0.7, 3.0))
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(
    ("shape", "unknown"), [("plane", [2, 3, 4]), ("sphere", [0, 1, 2]), ("cylinder", [2, 5]), ("box", [])]
)
def test_a_free_motion_has_no_covariance_and_the_rest_has(shape: str, unknown: list[int]) -> None:
    make, _ = SHAPES[shape]
    points, normals = make(np.random.default_rng(0))
    covariance = covariance_of(judged(points, normals, 1e-3))
    known = [k for k in range(6) if k not in unknown]
    assert np.isnan(covariance[unknown]).all()
    assert np.isnan(covariance[:, unknown]).all()
    block = covariance[np.ix_(known, known)]
    np.testing.assert_allclose(block, block.T, rtol=1e-12, atol=1e-20)
    assert np.linalg.eigvalsh(block).min() > 0.0


def test_weights_count_like_copies_and_zero_like_absence() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    residuals, weights = 1e-3 * rng.normal(size=len(points)), np.resize([1.0, 2.0, 0.0], len(points))
    weighted = information_of(points, normals, residuals, weights, 1.5, np.zeros(3))
    copied = judged(*(np.repeat(a, weights.astype(int), axis=0) for a in (points, normals, residuals)))
    np.testing.assert_allclose(weighted.values, copied.values, rtol=1e-12)
    np.testing.assert_allclose(covariance_of(weighted), covariance_of(copied), rtol=1e-9, atol=1e-18)


def test_zero_normals_say_nothing_and_no_pairs_leave_everything_free() -> None:
    nothing: Any = judged(np.ones((10, 3)), np.zeros((10, 3)))
    unweighted = dataclasses.replace(nothing, weight=0.0)
    none = information_of(np.ones((5, 3)), np.eye(5, 3), np.zeros(5), np.zeros(5), 1.0, np.zeros(3))
    for information in (nothing, unweighted, none):
        assert isinstance(information, Information)
        assert information.free.all()
        assert np.isnan(covariance_of(information)).all()


def test_the_noise_is_estimated_without_bias() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng, 60)
    rows = np.hstack([np.cross(points, normals), normals])
    noise = rng.normal(size=(2_000, 60))
    residuals = noise - noise @ np.linalg.pinv(rows).T @ rows.T
    variances = [judged(points, normals, r).sigma ** 2 for r in residuals]
    assert np.mean(variances) == pytest.approx(1.0, abs=5.0 * np.sqrt(2 / 54 / 2_000))


@pytest.mark.parametrize(("slot", "held"), [(0, False), (200, True)])
def test_between_two_scans_only_what_both_say_constrains_a_motion(slot: int, held: bool) -> None:
    # A round shaft with a keyway, or none, whose normals two scans measured with errors of their own.
    rng = np.random.default_rng(3)
    points, exact = cylinder(rng)
    exact = exact.copy()
    exact[:slot] = np.cross([0.0, 0.0, 1.0], exact[:slot]) + 0.2 * exact[:slot]

    def measured() -> FloatArray:
        normals = exact + 0.05 * rng.normal(size=exact.shape)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    target, scan = measured(), measured() * rng.choice([-1.0, 1.0], (len(points), 1))
    plain = np.zeros(len(points)), np.ones(len(points)), 1.5, np.zeros(3)
    alone, both = (information_of(points, target, *plain, own=own) for own in (None, scan))
    about = int(np.abs(alone.vectors[2]).argmax())
    # Errors alone look like a constraint of hundreds of points.
    assert not alone.free.any()
    assert alone.carriers[about] > 100.0
    assert (both.carriers[about] >= MIN_CARRIERS_OF_BOTH) == held
    assert (np.delete(both.carriers, about)[-3:] > 100.0).all()


@pytest.mark.parametrize("column", [0, 40])
def test_errors_of_normals_hold_no_mixture_with_a_motion_that_is_hardly_held(column: int) -> None:
    # A corridor, dense at the scanner and seen far along: the yaw of so long a scene is held by as little as errors say
    # of the shift along it, and the eigenvectors of the information are any mixtures of the two.
    mixed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        count = 4_000
        along = 1.7 * rng.normal(size=count)
        side, sign = rng.integers(1, 3, count), rng.choice([-1.0, 1.0], count)
        points = np.column_stack([along, rng.uniform(-1.5, 1.5, count), rng.uniform(-1.2, 1.2, count)])
        points[np.arange(count), side] = sign * np.where(side == 1, 1.5, 1.2)
        exact = np.eye(3)[side] * sign[:, None]
        # Faces across it.
        exact[:column] = [1.0, 0.0, 0.0]

        def measured(exact: FloatArray = exact, rng: np.random.Generator = rng) -> FloatArray:
            normals = exact + 0.06 * rng.normal(size=exact.shape)
            return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

        target, scan = measured(), measured()
        plain = np.zeros(count), np.ones(count), 20.0, np.zeros(3)
        mixed += np.abs(information_of(points, target, *plain).vectors[3]).max() < 0.9
        both = information_of(points, target, *plain, own=scan)
        assert both.free.sum() == (0 if column else 1)
        if not column:
            # Tilted by the errors of 4,000 pairs alone, in two held motions.
            assert np.abs(both.vectors[3, both.free]).min() > np.cos(4.0 / np.sqrt(count))
    assert column or mixed > 5


def table_and_walls(rng: np.random.Generator, few: int) -> tuple[FloatArray, FloatArray]:
    """Points on a table seen from above and few on each of two walls of it, and their normals."""
    floor = np.column_stack([rng.uniform(-1.0, 1.0, (2000, 2)), np.zeros(2000)])
    wall = np.column_stack([np.ones(few), rng.uniform(-1.0, 1.0, (few, 2))])
    points = np.concatenate([floor, wall, wall[:, [1, 0, 2]] * [1.0, -1.0, 1.0]])
    return points, np.repeat(np.eye(3)[[2, 0, 1]], [2000, few, few], axis=0)


def test_squared_errors_are_the_variance_where_few_points_hold_a_motion() -> None:
    # A fit of least squares, so that the truth is known.
    few, squares = 8, []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        points, normals = table_and_walls(rng, few)
        order = np.argsort(points[:, 0])
        points, normals = points[order], normals[order]
        rows = np.hstack([np.cross(points, normals), normals])
        noise = 1e-3 * rng.normal(size=len(points))
        error = np.linalg.lstsq(rows, noise, rcond=None)[0]
        residuals, weights = noise - rows @ error, np.ones(len(points))
        found = information_of(points, normals, residuals, weights, 1.0, np.zeros(3), patchwise=True)
        squares.append(error @ np.linalg.solve(found.spread, error) / 6.0)
    # Standard error of the mean 0.06.
    assert 0.8 < np.mean(squares) < 1.3


def test_where_few_points_hold_a_motion_as_much_is_known_as_was_beforehand() -> None:
    least = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points, normals = table_and_walls(rng, 8)
        residuals = 1e-3 * rng.normal(size=len(points))
        # Sure of some mixtures, as the walls are about, and unsure of others.
        mixed = rng.normal(size=(6, 6)) * 3e-4 * np.geomspace(0.3, 3.0, 6)
        prior = np.asarray(np.linalg.inv(mixed @ mixed.T), dtype=np.float64)
        given = points, normals, residuals, np.ones(len(points)), 1.0, np.zeros(3)
        found = information_of(*given, patchwise=True, prior=prior)
        gained = np.linalg.eigvalsh(mixed.T @ np.linalg.inv(found.spread) @ mixed)
        assert gained[0] > 1.0 - 1e-6
        least.append(gained[0])
        assert gained[-1] > 2.0
    # In most of them some mixture is known by the prior alone.
    assert np.median(least) < 1.01
