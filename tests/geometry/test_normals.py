from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import (
    CHUNK_POINTS,
    NORMAL_NEIGHBOURS,
    PlaneFits,
    ScanPlanes,
    fit_edge_planes,
    fit_planes,
    fit_planes_around,
    fit_wide_planes,
    orient_towards,
    sample_rows,
)
from tests.strategies import FloatArray, floats, rotations, unit_vectors


def fits_of(points: FloatArray, count: int = NORMAL_NEIGHBOURS) -> PlaneFits:
    return fit_planes(NeighbourTree(points), points, points, count)


def flat(n: int, rng: np.random.Generator) -> FloatArray:
    return np.column_stack([rng.uniform(-1.0, 1.0, size=(n, 2)), np.zeros(n)])


@settings(deadline=None, max_examples=40)
@given(rotations(), floats(-100.0, 100.0))
def test_an_exact_plane_has_its_normal_and_no_residual(R: FloatArray, height: float) -> None:
    points = (flat(60, np.random.default_rng(0)) + np.array([0.0, 0.0, height])) @ R.T
    fits = fits_of(points)
    # Coordinates are rounded to 1e-14 at 100, neighbours are about 0.3 away.
    np.testing.assert_allclose(np.abs(fits.normals @ R[:, 2]), 1.0, atol=1e-12)
    # A residual is the root of an eigenvalue that is rounding of the scatter.
    assert fits.residuals.max() < 1e-7
    assert fits.count == NORMAL_NEIGHBOURS


def test_the_axes_of_a_plane_are_exact_where_the_numbers_are() -> None:
    fits = fits_of(flat(60, np.random.default_rng(0)))
    np.testing.assert_array_equal(np.abs(fits.normals), np.tile([0.0, 0, 1], (60, 1)))
    assert not fits.residuals.any()
    assert not fits.variances.any()


def test_normals_scatter_as_much_as_their_variance_says() -> None:
    # Seven fixed places in a plane, uneven on purpose; only the heights are noise. To first order the slope is a
    # linear fit, so both slopes are normal and sigma^2 (X^T X)^-1 is exact.
    rng = np.random.default_rng(0)
    across = rng.uniform(-1.0, 1.0, size=(7, 2)) * [1.0, 0.3]
    draws, sigma = 4_000, 1e-4
    slopes = np.zeros((draws, 2))
    claimed, residuals = np.zeros(draws), np.zeros(draws)
    for draw in range(draws):
        points = np.column_stack([across, sigma * rng.normal(size=7)])
        fits = fit_planes(NeighbourTree(points), points, points[:1], 7)
        normal = fits.normals[0] * np.sign(fits.normals[0, 2])
        slopes[draw], claimed[draw], residuals[draw] = normal[:2], fits.variances[0], fits.residuals[0]
    spread = across - across.mean(axis=0)
    variances = np.linalg.eigvalsh(sigma**2 * np.linalg.inv(spread.T @ spread))
    expected = variances.sum()
    # The scatter of the squared slopes: var(sum) = 2 sum of squared variances, over the draws; five sigma.
    bound = 5.0 * np.sqrt(2.0 * (variances**2).sum() / draws)
    assert abs((slopes**2).sum(axis=1).mean() - expected) < bound
    # The claim takes sigma^2 from k - 3 degrees of freedom: right on average, with a variance of 2 / (k - 3).
    assert abs(claimed.mean() - expected) < 5.0 * expected * np.sqrt(2.0 / 4.0 / draws)
    # And its residuals follow the chi-square law with 4 degrees of freedom, not 7.
    median = chi2.median(4) / 4.0
    assert np.median(residuals**2) / sigma**2 == pytest.approx(median, rel=5.0 * 1.3 * np.sqrt(0.5 / draws))


def test_a_line_fixes_no_normal() -> None:
    fits = fits_of(np.outer(np.linspace(0.0, 1.0, 40), [1.0, -2.0, 0.5]) + np.array([5.0, 0.0, 0.0]))
    assert np.isnan(fits.normals).all()
    assert not fits.lever.any()
    assert np.isinf(fits.variances).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_fewer_than_four_points_fix_no_normal_that_could_be_checked(count: int) -> None:
    fits = fits_of(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])[:count])
    assert np.isnan(fits.normals).all()
    assert np.isnan(fits.residuals).all()
    assert not fits.lever.any()
    assert fits.count == count


def test_the_lever_is_half_the_harmonic_mean_of_the_tangential_variances() -> None:
    points = np.array([[x, y, 0.0] for x in (-3.0, 3.0) for y in (-1.0, 1.0)])
    fits = fits_of(points)
    np.testing.assert_allclose(fits.lever, 1.0 / (1.0 / 9.0 + 1.0 / 1.0), rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_lengths_scale_and_directions_do_not(scale: float) -> None:
    rng = np.random.default_rng(0)
    points = flat(200, rng) + 1e-2 * rng.normal(size=(200, 3))
    plain, scaled = fits_of(points), fits_of(scale * points)
    np.testing.assert_allclose(scaled.residuals, scale * plain.residuals, rtol=1e-9)
    np.testing.assert_allclose(scaled.lever, scale**2 * plain.lever, rtol=1e-9)
    np.testing.assert_allclose(scaled.variances, plain.variances, rtol=1e-9)
    cosines = np.einsum("ni,ni->n", scaled.normals, plain.normals)
    np.testing.assert_allclose(np.abs(cosines), 1.0, atol=1e-9)


def test_more_places_than_one_step_takes() -> None:
    cloud = flat(50, np.random.default_rng(0))
    tree = NeighbourTree(cloud)
    at = np.resize(cloud, (CHUNK_POINTS + 7, 3))
    fits = fit_planes(tree, cloud, at)
    few = fit_planes(tree, cloud, cloud)
    assert fits.normals.shape == at.shape
    np.testing.assert_array_equal(fits.lever, np.resize(few.lever, CHUNK_POINTS + 7))


@settings(deadline=None, max_examples=60)
@given(unit_vectors(), unit_vectors())
def test_oriented_normals_face_the_sensor_and_keep_their_line(normal: FloatArray, place: FloatArray) -> None:
    viewpoint = 3.0 * place + [0.1, 0.2, 0.3]
    turned = orient_towards(normal[None], np.zeros((1, 3)), viewpoint)[0]
    assert turned @ viewpoint >= 0.0
    assert min(np.abs(turned - normal).max(), np.abs(turned + normal).max()) == 0.0


def test_a_sphere_seen_from_outside_and_from_inside() -> None:
    rng = np.random.default_rng(0)
    outwards = rng.normal(size=(100, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], size=(100, 1))
    inside = orient_towards(signs * outwards, outwards, np.zeros(3))
    np.testing.assert_array_equal(inside, -outwards)
    front = outwards[:, 2] > 0.2
    seen = orient_towards((signs * outwards)[front], outwards[front], np.array([0.0, 0.0, 1e3]))
    np.testing.assert_array_equal(seen, outwards[front])


@pytest.mark.parametrize(("total", "wanted"), [(0, 5), (5, 5), (5, 9), (10, 1), (10, 9), (1_000_003, 1_000)])
def test_rows_are_spread_evenly_each_once(total: int, wanted: int) -> None:
    rows = sample_rows(total, wanted)
    assert len(rows) == min(total, wanted)
    assert len(set(rows.tolist())) == len(rows)
    if len(rows) > 1:
        gaps = np.diff(rows)
        assert (rows[0], rows[-1]) == (0, total - 1)
        assert gaps.min() >= 1
        assert gaps.max() - gaps.min() <= 1


def test_planes_from_remembered_neighbours_are_those_from_a_fresh_search() -> None:
    cloud = np.random.default_rng(4).uniform(size=(500, 3)) * [1.0, 1.0, 0.05]
    tree = NeighbourTree(cloud)
    rows = np.array([7, 3, 3, 499])
    for _ in range(2):
        found, expected = fit_planes_around(tree, cloud, rows), fit_planes(tree, cloud, cloud[rows])
        for name in ("normals", "residuals", "lever", "count"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    indices, farthest = tree.around(rows)
    expected_indices, expected_distances = tree.nearest(cloud[rows], 24)
    np.testing.assert_array_equal(indices, expected_indices)
    np.testing.assert_array_equal(farthest, expected_distances[:, -1])
    assert len(fit_planes_around(tree, cloud, rows[:0]).normals) == 0
    # From memory, and where one of the rows is not known.
    for asked in (rows, np.array([7, 8])):
        lines, table = tree.beside(asked, 8)
        np.testing.assert_array_equal(table[lines][:, :8], tree.nearest(cloud[asked], 8)[0])


def test_where_a_search_begins_changes_no_plane() -> None:
    rng = np.random.default_rng(8)
    cloud = rng.normal(size=(400, 3))
    cloud = cloud[morton_order(cloud)]
    places = cloud[::7] + rng.normal(scale=0.1, size=(58, 3))
    tree = NeighbourTree(cloud, in_order=True)
    found, expected = fit_planes(tree, cloud, places, beside=np.arange(58) * 7), fit_planes(tree, cloud, places)
    np.testing.assert_array_equal(found.normals, expected.normals)
    np.testing.assert_array_equal(found.residuals, expected.residuals)


def test_a_tree_of_few_points_remembers_all_of_them() -> None:
    tree = NeighbourTree(np.arange(9.0).reshape(3, 3))
    indices, farthest = tree.around(np.array([0]))
    assert indices.tolist() == [[0, 1, 2]]
    assert farthest.tolist() == [np.sqrt(108.0)]


@settings(deadline=None)
@given(st.integers(1, 10**7), st.integers(0, 5_000))
def test_sampled_rows_are_those_of_linspace_to_the_last_one(total: int, wanted: int) -> None:
    expected = np.linspace(0, total - 1, wanted).round() if wanted < total else np.arange(total)
    assert np.array_equal(sample_rows(total, wanted), expected)


# Of a step, whose points are 1 apart.
STEP_NOISE, BY_EDGES = 0.01, 24


def step(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A stair of one tread wide, one point to a unit of area: its riser is two points high; and the exact normals."""
    xs, ys = rng.uniform(-8.0, 8.0, (2, 160))
    lower = np.column_stack([xs, -np.abs(ys), np.zeros(160)])
    upper = np.column_stack([xs, np.abs(ys[::-1]), np.full(160, 2.0)])
    riser = np.column_stack([rng.uniform(-8.0, 8.0, 32), np.zeros(32), rng.uniform(0.0, 2.0, 32)])
    normals = np.repeat(np.eye(3)[[2, 2, 1]], [160, 160, 32], axis=0)
    points = np.concatenate([lower, upper, riser])
    return points + STEP_NOISE * rng.normal(size=(352, 1)) * normals, normals


@pytest.mark.parametrize("seed", range(3))
def test_points_of_a_narrow_face_have_its_normal(seed: int) -> None:
    points, normals = step(np.random.default_rng(seed))
    tree, riser = NeighbourTree(points), np.flatnonzero(normals[:, 1])
    riser = riser[np.abs(points[riser, 0]) < 6.0]
    across = fit_planes(tree, points, points[riser])
    planes, residuals, found = fit_edge_planes(points, tree.nearest(points[riser], BY_EDGES)[0], 3.0 * STEP_NOISE)
    right = np.abs(np.einsum("ij,ij->i", planes, normals[riser])) > np.cos(np.deg2rad(8.0))
    # Points at the very edges are as well on the tread.
    assert np.mean(found) > 0.7
    assert np.mean(right[found]) > 0.8
    assert np.all(residuals[found] < 3.0 * STEP_NOISE)
    assert np.mean(np.abs(across.normals[:, 1]) > np.cos(np.deg2rad(8.0))) < 0.3


def test_points_on_a_line_and_in_a_ball_have_none() -> None:
    rng = np.random.default_rng(0)
    line = np.column_stack([np.arange(40.0), np.zeros(40), np.zeros(40)])
    # Neighbours are 0.3 apart: six of 24 in one plane are no chance within a hundredth of that.
    for points in (line, rng.normal(size=(300, 3))):
        assert np.mean(fit_edge_planes(points, NeighbourTree(points).nearest(points, BY_EDGES)[0], 0.003)[2]) < 0.02


@pytest.mark.parametrize("wanted", [0, 7, 50, 200])
def test_planes_of_some_rows_are_theirs_however_many_are_asked_for(wanted: int) -> None:
    rng = np.random.default_rng(0)
    rows = np.sort(rng.choice(200, 50, replace=False))
    planes = ScanPlanes(rows, rng.normal(size=(50, 3)), rng.uniform(size=50), rng.uniform(size=50), 200)
    asked = np.sort(rng.choice(200, wanted, replace=False))
    found = planes.at(asked)
    np.testing.assert_array_equal(found.whole("normals"), planes.whole("normals")[asked])
    np.testing.assert_array_equal(found.whole("residuals"), planes.whole("residuals")[asked])
    np.testing.assert_array_equal(asked[found.rows], np.intersect1d(asked, rows))


def corner_of_rings(rng: np.random.Generator, noise: float) -> FloatArray:
    """A ring on a floor, z = 0, that runs round a place 1 above it, and rings on the wall x = 1.5 beyond."""
    around = np.arange(-0.8, 0.8, 0.04)
    floor = np.column_stack([np.cos(around), np.sin(around), np.zeros(len(around))])
    wide = np.arange(-1.0, 1.0, 0.04)
    wall = [np.column_stack([np.full(len(wide), 1.5), wide, np.full(len(wide), z)]) for z in (0.1, 0.3, 0.5)]
    return np.concatenate([floor, *wall]) + rng.normal(scale=noise, size=(len(floor) + 3 * len(wide), 3))


def test_the_plane_of_a_ring_by_a_wall_is_the_floor() -> None:
    noise, points = 0.003, corner_of_rings(np.random.default_rng(0), 0.003)
    tree, middle = NeighbourTree(points), np.flatnonzero(np.abs(points[:40, 1]) < 0.3)
    wide = fit_wide_planes(tree, points, middle, noise, 2.5 * noise)
    assert wide.known.all()
    # Of forty neighbours the ring bends by a tenth, thirty times the noise: a degree or two, more where they are fewer.
    assert np.median(np.abs(wide.normals[:, 2])) > np.cos(np.deg2rad(2.0))
    assert np.abs(wide.normals[:, 2]).min() > np.cos(np.deg2rad(15.0))
    assert np.median(wide.residuals) < 1.5 * noise
    # The plane of all forty lies across the wall.
    near = fit_planes(tree, points, points[middle], 40)
    assert np.median(np.abs(near.normals[:, 2])) < np.cos(np.deg2rad(8.0))


def test_what_scatters_about_a_line_has_no_wide_plane() -> None:
    rng, noise = np.random.default_rng(1), 0.01
    points = np.column_stack([np.linspace(0.0, 4.0, 120), *rng.normal(scale=noise, size=(2, 120))])
    assert not fit_wide_planes(NeighbourTree(points), points, np.arange(120), noise, 2.5 * noise).known.any()


def test_few_points_have_no_wide_plane_and_an_exact_plane_has_its_normal() -> None:
    points = flat(60, np.random.default_rng(2))
    exact = fit_wide_planes(NeighbourTree(points), points, np.arange(60), 0.0, 1e-9)
    np.testing.assert_allclose(np.abs(exact.normals), np.tile([0.0, 0.0, 1.0], (60, 1)), atol=1e-9)
    few = points[:4]
    assert not fit_wide_planes(NeighbourTree(few), few, np.arange(4), 0.01, 0.1).known.any()
    assert len(fit_wide_planes(NeighbourTree(points), points, np.arange(0), 0.01, 0.1).normals) == 0
