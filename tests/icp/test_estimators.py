from __future__ import annotations

import dataclasses

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import Closest, CloudSurface, PointCloud, Scan, prepare_scan
from dqreg.geometry.cells import Cells, CellSurface
from dqreg.geometry.normals import NORMAL_NEIGHBOURS
from dqreg.icp import (
    ESTIMATORS,
    Correspondences,
    Icp,
    find_correspondences,
    points_and_normals,
    points_only,
    points_to_planes,
    svd_points,
)
from dqreg.icp.estimators import (
    BEND_VARIANCE,
    BEND_VARIANCE_SHARE,
    MIN_BEND_VARIANCE,
    Estimator,
    both_planes,
    cells_to_cells,
    pair_sums,
    plane_to_plane_form,
    surfaces_to_surfaces,
)
from dqreg.icp.lowered_weights import (
    HALF_WEIGHT_DISTANCES,
    HALF_WEIGHT_HEIGHTS,
    HALF_WEIGHT_VARIANCE,
    lowered_weights,
)
from dqreg.rigid import pose, twist
from dqreg.solvers import horn, solve
from dqreg.solvers.quadratic import QuadraticForm, derivatives
from tests.icp.scenes import made_pairs
from tests.strategies import FloatArray

EACH = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
CLOSED_FORMS = [name for name in ESTIMATORS if name not in ("plane", "generalised")]
EACH_CLOSED_FORM = pytest.mark.parametrize("estimator", [ESTIMATORS[n] for n in CLOSED_FORMS], ids=CLOSED_FORMS)
NOISE = 0.01


def some_weights(pairs: Correspondences) -> np.ndarray:
    weights = np.random.default_rng(5).uniform(0.1, 1.0, len(pairs.scan))
    weights[::4] = 0.0
    return weights


def with_parts(pairs: Correspondences, scan: dict[str, np.ndarray], closest: dict[str, np.ndarray]) -> Correspondences:
    return dataclasses.replace(
        pairs, scan=dataclasses.replace(pairs.scan, **scan), closest=dataclasses.replace(pairs.closest, **closest)
    )


def test_points_alone_are_arun_and_horn() -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    dq = points_only(pairs, weights, NOISE).T_target_source
    np.testing.assert_allclose(dq, svd_points(pairs, weights, NOISE).T_target_source, atol=1e-10)
    kept = weights > 0.0
    other = horn(pairs.scan.points[kept], pairs.closest.points[kept], point_weights=weights[kept])
    np.testing.assert_allclose(dq, other.T_target_source, atol=1e-10)


@pytest.mark.parametrize("noise", [NOISE, 1e-6, np.inf])
def test_points_and_normals_are_solve_with_the_weights_written_out(noise: float) -> None:
    pairs = made_pairs()
    scan, beta = pairs.scan, some_weights(pairs)
    # alpha / beta = lever noise^2 / sigma_r^2, the ratio of the variances held at one.
    alpha = beta * scan.levers * np.minimum(noise**2 / scan.residuals**2, 1.0)
    moved = pose.rotate(pairs.T_target_source, scan.normals)
    sign = np.where(np.sum(moved * pairs.closest.normals, axis=1) < 0.0, -1.0, 1.0)[:, None]
    expected = solve(scan.points, pairs.closest.points, sign * scan.normals, pairs.closest.normals, beta, alpha)
    found = points_and_normals(pairs, beta, noise).T_target_source
    np.testing.assert_allclose(found, expected.T_target_source, atol=1e-12)
    if noise == np.inf:
        assert np.abs(found - points_only(pairs, beta, noise).T_target_source).max() > 1e-5


def test_without_normals_both_closed_forms_are_one() -> None:
    pairs = made_pairs()
    beta, nothing = some_weights(pairs), np.zeros_like(pairs.scan.normals)
    expected = points_only(pairs, beta, NOISE).T_target_source
    unknown_here = with_parts(pairs, {"levers": np.zeros(len(pairs.scan)), "normals": nothing}, {})
    unknown_there = with_parts(pairs, {}, {"normals": nothing})
    for bare in (unknown_here, unknown_there):
        np.testing.assert_array_equal(points_and_normals(bare, beta, NOISE).T_target_source, expected)


@EACH
def test_pairs_of_weight_zero_have_no_say(estimator: Estimator) -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    out = weights == 0.0
    spoilt = {name: getattr(pairs.scan, name).copy() for name in ("points", "normals", "levers", "residuals")}
    there = {name: getattr(pairs.closest, name).copy() for name in ("points", "normals")}
    for array in (*spoilt.values(), *there.values()):
        array[out] = 1e3
    expected = estimator(pairs, weights, NOISE).T_target_source
    found = estimator(with_parts(pairs, spoilt, there), weights, NOISE).T_target_source
    np.testing.assert_array_equal(found, expected)


@EACH
def test_the_scale_of_the_weights_has_no_say(estimator: Estimator) -> None:
    pairs = made_pairs()
    weights = some_weights(pairs)
    expected = estimator(pairs, weights, NOISE).T_target_source
    np.testing.assert_allclose(estimator(pairs, 1e-6 * weights, NOISE).T_target_source, expected, atol=1e-12)


@EACH
def test_exact_pairs_give_the_exact_pose(estimator: Estimator) -> None:
    pairs = made_pairs()
    T = pairs.T_target_source
    exact = {"points": pose.apply(T, pairs.scan.points), "normals": pose.rotate(T, pairs.scan.normals)}
    found = estimator(with_parts(pairs, {}, exact), some_weights(pairs), NOISE).T_target_source
    np.testing.assert_allclose(found, T, atol=1e-13)


@EACH_CLOSED_FORM
def test_the_pose_is_absolute_and_forgets_where_the_pairs_were_found(estimator: Estimator) -> None:
    pairs = made_pairs(same_sign=True)
    elsewhere = dataclasses.replace(pairs, T_target_source=np.eye(4))
    weights = some_weights(pairs)
    expected = estimator(pairs, weights, NOISE).T_target_source
    np.testing.assert_array_equal(estimator(elsewhere, weights, NOISE).T_target_source, expected)


@EACH
@pytest.mark.parametrize("shape", ["line", "place"])
def test_degenerate_pairs_are_refused(estimator: Estimator, shape: str) -> None:
    along = np.linspace(0.0, 1.0, 30)[:, None] * [1.0, 2.0, -0.5]
    scan = prepare_scan(PointCloud(along))
    pairs = find_correspondences(scan, CloudSurface(PointCloud(along)), np.eye(4))
    if shape == "place":
        same = np.tile(pairs.closest.points[:1], (len(scan), 1))
        pairs = with_parts(pairs, {"points": same}, {"points": same})
    with pytest.raises(DegenerateGeometryError):
        estimator(pairs, np.ones(len(scan)), NOISE)


@EACH
def test_no_weight_at_all_is_refused(estimator: Estimator) -> None:
    pairs = made_pairs()
    with pytest.raises((DegenerateGeometryError, ValueError)):
        estimator(pairs, np.zeros(len(pairs.scan)), NOISE)


def test_points_to_planes_end_where_the_planes_feel_no_force() -> None:
    pairs = made_pairs()
    weights, normals = some_weights(pairs), pairs.closest.normals
    T = points_to_planes(pairs, weights, NOISE).T_target_source
    moved = pose.apply(T, pairs.scan.points)
    gaps = np.sum((moved - pairs.closest.points) * normals, axis=1)
    # The gradient over turns about the origin and shifts, against what the same forces would add up to at worst.
    arms = np.column_stack([np.cross(moved, normals), normals])
    force = (weights * gaps) @ arms
    assert np.linalg.norm(force) <= 1e-10 * np.sum(weights * np.abs(gaps) * np.linalg.norm(arms, axis=1))
    before = pose.apply(pairs.T_target_source, pairs.scan.points)
    assert weights @ gaps**2 < weights @ np.sum((before - pairs.closest.points) * normals, axis=1) ** 2


def test_what_no_plane_feels_stays_as_it_was() -> None:
    # All normals up: shifts along the plane and turns about the normal are free.
    pairs = made_pairs(same_sign=True)
    up = np.tile([0.0, 0.0, 1.0], (len(pairs.scan), 1))
    flat = with_parts(pairs, {}, {"normals": up})
    T = points_to_planes(flat, np.ones(len(pairs.scan)), NOISE).T_target_source
    step = T @ pose.inverse(pairs.T_target_source)
    turn, shift = np.split(twist.log(step), 2)
    assert abs(turn[2]) <= 1e-3 * np.linalg.norm(turn)
    gap = pose.apply(T, pairs.scan.points)[:, 2] - pairs.closest.points[:, 2]
    assert abs(gap.mean()) <= 1e-12
    assert np.linalg.norm(shift[:2]) <= 0.1


variances = st.floats(1e-3, 1.5)
COUNT = 7


def unit(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    rows = rng.normal(size=(count, 3))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def mahalanobis(
    T: np.ndarray, p: np.ndarray, q: np.ndarray, directions: tuple, spreads: tuple, weights: np.ndarray
) -> float:
    """The cost as its definition says it, pair by pair, with matrices inverted."""
    total = 0.0
    for i in range(len(p)):
        C = np.zeros((3, 3))
        for normal, spread in zip(directions, spreads, strict=True):
            C += np.eye(3) - (1.0 - min(spread[i], 1.0)) * np.outer(normal[i], normal[i])
        d = T[:3, :3] @ p[i] + T[:3, 3] - q[i]
        total += weights[i] * d @ np.linalg.inv(C) @ d
    return total


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10_000), variances, variances, st.sampled_from(["any", "same", "opposite", "square", "no source"])
)
def test_the_form_is_the_brute_force_mahalanobis_cost(seed: int, e_n: float, e_m: float, how: str) -> None:
    rng = np.random.default_rng(seed)
    p, q, n = rng.normal(size=(COUNT, 3)), rng.normal(size=(COUNT, 3)), unit(rng)
    m = {"any": unit(rng), "same": n, "opposite": -n, "no source": np.zeros_like(n)}.get(how)
    if m is None:
        m = np.cross(n, unit(rng))
        m /= np.linalg.norm(m, axis=1, keepdims=True)
    spreads = np.full(COUNT, e_n) * rng.uniform(0.5, 1.0, COUNT), np.full(COUNT, e_m)
    weights, origins = rng.uniform(0.0, 2.0, COUNT), (rng.normal(size=3), rng.normal(size=3))
    form = QuadraticForm(plane_to_plane_form(p, q, (n, m), spreads, weights, origins), *origins)
    T = pose.random(rng, reach=2.0)
    expected = mahalanobis(T, p, q, (n, m), spreads, weights)
    assert form.value(T) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_its_slope_is_that_of_the_brute_force_cost() -> None:
    # Central differences, step 1e-5 of sizes about one: good to 1e-9.
    rng = np.random.default_rng(3)
    p, q, n, m = rng.normal(size=(COUNT, 3)), rng.normal(size=(COUNT, 3)), unit(rng), unit(rng)
    spreads, weights = (rng.uniform(0.02, 0.5, COUNT), rng.uniform(0.02, 0.5, COUNT)), rng.uniform(0.1, 2.0, COUNT)
    origins = (np.zeros(3), np.zeros(3))
    form = QuadraticForm(plane_to_plane_form(p, q, (n, m), spreads, weights, origins), *origins)
    T = pose.random(rng, reach=1.0)
    slope = derivatives(form, T)[0]
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        ahead, behind = (mahalanobis(twist.exp(s) @ T, p, q, (n, m), spreads, weights) for s in (step, -step))
        assert slope[k] == pytest.approx((ahead - behind) / 2e-5, abs=1e-7 * np.linalg.norm(slope))


def test_the_pairs_bring_their_own_normals_and_variances() -> None:
    pairs = made_pairs()
    stands = np.random.default_rng(1).uniform(0.0, 0.3, len(pairs.scan))
    pairs = dataclasses.replace(pairs, closest=dataclasses.replace(pairs.closest, variances=stands))
    weights = np.random.default_rng(2).uniform(0.0, 1.0, len(pairs.scan))
    weights[::3] = 0.0
    scan, T = pairs.scan, pairs.T_target_source
    moves = np.where(scan.levers > 0.0, scan.residuals**2 / (NORMAL_NEIGHBOURS * np.maximum(scan.levers, 1e-300)), 0.0)
    # Far pairs show nothing finer than the usual bend.
    aside, squares = weights @ pairs.point_to_plane**2, weights @ pairs.distances**2
    assert BEND_VARIANCE_SHARE * (aside / (squares - aside)) ** 2 > BEND_VARIANCE
    expected = mahalanobis(
        T,
        scan.points,
        pairs.closest.points,
        (pairs.closest.normals, scan.normals @ T[:3, :3].T),
        (BEND_VARIANCE + stands, BEND_VARIANCE + moves),
        2.0 * BEND_VARIANCE * weights,
    )
    assert both_planes(pairs, weights, pair_sums(pairs, weights)).value(T) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("aside", "bend"), [(1.0, BEND_VARIANCE), (0.3, BEND_VARIANCE_SHARE * 0.045**2), (1e-3, MIN_BEND_VARIANCE)]
)
def test_pairs_that_lie_close_to_the_planes_count_on_them(aside: float, bend: float) -> None:
    # Every pair one aside along the normal, z, and one beside in x and y: the ratio of both variances is known.
    count = 50
    scan = prepare_scan(PointCloud(np.random.default_rng(0).uniform(size=(count, 3)) * [1.0, 1.0, 0.0]))
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    gaps = np.tile([1.0, -1.0, aside], (count, 1))
    closest = Closest(scan.points - gaps, up, np.linalg.norm(gaps, axis=1), np.arange(count))
    pairs, weights = Correspondences(scan, np.eye(4), closest, False), np.ones(count)
    form = both_planes(pairs, weights, pair_sums(pairs, weights))
    # The plane counts once for the pair, whatever the bend; a direction in the plane by the bend.
    assert form.value(np.eye(4)) == pytest.approx(count * (aside**2 + 2.0 * bend), rel=1e-9)


def test_cells_far_off_the_planes_for_most_count_less_and_points_do_not() -> None:
    rng = np.random.default_rng(0)
    means = PointCloud(np.column_stack([rng.uniform(size=(200, 2)), np.zeros(200)]))
    heights = np.where(np.arange(200) < 20, 1.0, 0.01) * rng.choice([-1.0, 1.0], 200)
    up = np.tile([0.0, 0.0, 1.0], (200, 1))
    scan = prepare_scan(means)
    closest = Closest(scan.points - heights[:, None] * up, up, np.abs(heights), np.arange(200))
    weights = rng.uniform(size=200)
    cells = CellSurface(means, Cells.of(means, 1e-9))
    found = lowered_weights(Correspondences(scan, np.eye(4), closest, False, cells), weights, is_last=False) / weights
    # By hand: most are 0.01 off, whose normal standard deviation is 0.01 / 0.6745.
    size = HALF_WEIGHT_HEIGHTS * 0.01 / 0.67448975
    np.testing.assert_allclose(found, 1.0 / (1.0 + (heights / size) ** 2), rtol=1e-5)
    assert found[:20].max() < 0.1 < 0.9 < found[20:].min()
    of_points = Correspondences(scan, np.eye(4), closest, False, CloudSurface(means))
    np.testing.assert_array_equal(lowered_weights(of_points, weights, is_last=False), weights)


def test_cells_that_stand_far_apart_count_by_how_far_a_bend_would_lift_them() -> None:
    rng = np.random.default_rng(1)
    means = PointCloud(np.column_stack([rng.uniform(size=(201, 2)), np.zeros(201)]))
    ways, scan = np.geomspace(0.1, 10.0, 201)[:, None] * [1.0, 0.0, 0.0], prepare_scan(means)
    up = np.tile([0.0, 0.0, 1.0], (201, 1))
    closest = Closest(scan.points - ways, up, ways[:, 0], np.arange(201))
    cells = CellSurface(means, Cells.of(means, 1e-9))
    weights = rng.uniform(size=201)
    found = lowered_weights(Correspondences(scan, np.eye(4), closest, False, cells), weights, is_last=True) / weights
    # By hand: the middle one is at 1. A bend lifts by the square of the way, its variance adds to that of noise, and
    # both are equal at the scale.
    np.testing.assert_allclose(1.0 / found, 1.0 + (ways[:, 0] / HALF_WEIGHT_DISTANCES) ** 4, rtol=1e-12)
    # A plane that was found flat far around leans, by the way.
    cells.wide[::2] = cells.has_wide = True
    found = lowered_weights(Correspondences(scan, np.eye(4), closest, False, cells), weights, is_last=True) / weights
    np.testing.assert_allclose(
        1.0 / found, 1.0 + (ways[:, 0] / HALF_WEIGHT_DISTANCES) ** np.where(cells.wide, 2, 4), rtol=1e-12
    )
    of_points = Correspondences(scan, np.eye(4), closest, False, CloudSurface(means))
    np.testing.assert_array_equal(lowered_weights(of_points, weights, is_last=True), weights)


def test_points_whose_neighbourhoods_are_noise_count_next_to_nothing_where_a_stand_sees_them() -> None:
    rng = np.random.default_rng(2)
    # From dense, near the sensor, to sparse: the spacing grows by a factor of five.
    places = np.geomspace(1.0, 5.0, 200)
    means = PointCloud(np.column_stack([places * rng.uniform(-1.0, 1.0, 200), places, np.zeros(200)]))
    scan, up = prepare_scan(means), np.tile([0.0, 0.0, 1.0], (200, 1))
    variances = np.where(np.arange(200) < 150, 10.0 * HALF_WEIGHT_VARIANCE, HALF_WEIGHT_VARIANCE) - scan._variances

    def weighed(variances: FloatArray, scan: Scan, surface: CloudSurface) -> FloatArray:
        closest = Closest(scan.points, up, np.zeros(200), np.arange(200), None, variances)
        return lowered_weights(Correspondences(scan, np.eye(4), closest, False, surface), np.ones(200), is_last=True)

    # By hand: at ten times the variance of a half, one in 1 + 10^8.
    expected = np.where(np.arange(200) < 150, 1.0 / (1.0 + 1e8), 0.5)
    np.testing.assert_allclose(weighed(variances, scan, CloudSurface(means)), expected, rtol=1e-9)
    # Cells are rid of noise; where all are noisy alike none counts less than another; and an even scan is of a part.
    np.testing.assert_array_equal(weighed(variances, scan, CellSurface(means, Cells.of(means, 1e-9))), 1.0)
    np.testing.assert_allclose(weighed(1.0 - scan._variances, scan, CloudSurface(means)), 0.5, rtol=1e-9)
    even = prepare_scan(PointCloud(np.column_stack([rng.uniform(size=(200, 2)), np.zeros(200)])))
    np.testing.assert_array_equal(weighed(variances, even, CloudSurface(means)), 1.0)


def test_a_bend_below_rings_that_stand_far_apart_does_not_tilt_the_pose() -> None:
    # Rows of cells 0.2 apart near a sensor and 2 apart far off, on a plane; those of the target stand beside them, and
    # lower by as much as the ground bends on the way. The truth is the identity, by construction.
    rng, up = np.random.default_rng(0), np.array([0.0, 0.0, 1.0])
    x = np.r_[np.arange(1.0, 12.0, 0.2), np.arange(14.0, 60.0, 2.0)]
    grid = np.stack(np.meshgrid(x, np.linspace(-5.0, 5.0, 21), indexing="ij"), axis=-1).reshape(-1, 2)
    means, normals = PointCloud(np.column_stack([grid, np.zeros(len(grid))])), np.tile(up, (len(grid), 1))
    scan = prepare_scan(dataclasses.replace(means, normals=normals))
    apart = np.where(scan.points[:, 0] < 13.0, 0.1, 1.0) * rng.choice([-1.0, 1.0], len(grid))
    ways = np.column_stack([apart, np.zeros(len(grid)), 0.02 * apart**2])
    closest = Closest(scan.points - ways, normals, np.linalg.norm(ways, axis=1), np.arange(len(grid)))
    pairs = Correspondences(scan, np.eye(4), closest, False, CellSurface(means, Cells.of(means, 1e-9)))
    weights = np.ones(len(grid))
    tilts = [abs(fit(pairs, weights, 0.0).T_target_source[0, 2]) for fit in (surfaces_to_surfaces, cells_to_cells)]
    # By hand: the far rows are 0.02 too high, at levers of up to 60.
    assert 2e-4 < tilts[0] < 1e-3
    assert tilts[1] < 0.05 * tilts[0]


def test_faces_that_agree_are_planes_and_faces_that_differ_fade() -> None:
    up, aside = np.array([[0.0, 0, 1]]), np.array([[1.0, 0, 0]])
    flat, point, zero = np.array([BEND_VARIANCE]), np.zeros((1, 3)), (np.zeros(3), np.zeros(3))

    def cost(offset: list[float], m: np.ndarray) -> float:
        form = plane_to_plane_form(point, point - offset, (up, m), (flat, flat), np.array([2.0 * BEND_VARIANCE]), zero)
        return QuadraticForm(form, *zero).value(np.eye(4))

    assert cost([0.0, 0, 1], up) == pytest.approx(1.0)
    assert cost([0.0, 1, 0], up) == pytest.approx(BEND_VARIANCE)
    assert cost([0.0, 0, 1], aside) < 0.1


def test_the_loop_with_it_meets_the_pose_of_exact_clouds() -> None:
    rng = np.random.default_rng(0)
    cloud = rng.uniform(-1.0, 1.0, size=(3_000, 3))
    cloud[np.arange(3_000), np.arange(3_000) % 3] = np.sign(cloud[np.arange(3_000), np.arange(3_000) % 3])
    T = twist.exp(np.array([0.01, -0.02, 0.015, 0.01, 0.02, -0.01]))
    scan = prepare_scan(PointCloud(pose.apply(pose.inverse(T), cloud)))
    run = Icp(ESTIMATORS["generalised"]).run(scan, CloudSurface(PointCloud(cloud)), np.eye(4))
    np.testing.assert_allclose(run.T_target_source, T, atol=1e-12)
    assert find_correspondences(scan, CloudSurface(PointCloud(cloud)), T).closest.variances is not None
