from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2

from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud, prepare_scan, sample_mesh
from dqreg.geometry.normals import NORMAL_NEIGHBOURS
from dqreg.synth.parts import box
from tests.strategies import FloatArray

GRID = np.stack(np.meshgrid(range(40), range(30), [0.0]), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(("step", "origin"), [(1.0, 0.0), (0.25, 1e6), (2.0**-20, 0.0), (2.0**20, 0.0), (0.5, 5e6)])
def test_the_spacing_of_a_grid_is_its_step_wherever_it_stands(step: float, origin: float) -> None:
    scan = prepare_scan(PointCloud(step * GRID + origin))
    assert (scan.spacing, scan.total, len(scan)) == (step, 1_200, 1_200)


def test_the_spacing_of_any_cloud_is_scipys_median() -> None:
    cloud = np.random.default_rng(0).normal(size=(3_000, 3))
    gaps = cKDTree(cloud).query(cloud, k=2)[0][:, 1]
    assert prepare_scan(PointCloud(cloud)).spacing == pytest.approx(np.median(gaps), rel=1e-12)


def test_the_noise_of_a_plane_is_what_its_heights_have() -> None:
    sigma, n = 1e-3, 20_000
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.0, 1.0, size=(n, 2)) * 100.0, sigma * rng.normal(size=n)])
    # Squared residuals follow chi-square with k - 3 degrees of freedom: their median lies a little below sigma^2.
    free = NORMAL_NEIGHBOURS - 3
    expected = sigma * np.sqrt(chi2.median(free) / free)
    # About n / k fits share no point; the median of that many spreads 1.25 / sqrt(2 free) / sqrt(n / k). Five sigma.
    bound = 5.0 * 1.25 / np.sqrt(2.0 * free) / np.sqrt(n / NORMAL_NEIGHBOURS)
    assert prepare_scan(PointCloud(points)).noise == pytest.approx(expected, rel=bound)


@pytest.mark.parametrize("count", [1, 3, 500, 1_199, 1_200, 5_000])
def test_a_thinned_scan_keeps_its_measures_and_the_fits_of_all_points(count: int) -> None:
    full = prepare_scan(PointCloud(GRID + 0.05 * np.random.default_rng(0).normal(size=GRID.shape)))
    scan = full.thinned(count)
    assert len(scan) == min(count, 1_200)
    assert full.fitted is scan.fitted is None
    assert (scan.total, scan.spacing, scan.noise) == (full.total, full.spacing, full.noise)
    rows = cKDTree(full.points).query(scan.points)[1]
    assert len(set(rows.tolist())) == len(scan)
    for name in ("points", "normals", "levers", "residuals"):
        np.testing.assert_array_equal(getattr(full, name)[rows], getattr(scan, name))


@pytest.mark.parametrize(("size", "fitted"), [(20_000, 2_000), (60_000, 2_000), (60_000, 40_000)])
def test_fits_at_some_points_measure_what_fits_at_all_do(size: int, fitted: int) -> None:
    # A wavy sheet with noise of a fiftieth of the waves' height, denser on one side.
    rng = np.random.default_rng(0)
    u, v = rng.uniform(size=(2, size))
    points = np.column_stack([u**1.5, v, 0.05 * np.sin(6 * u) * np.cos(5 * v) + 1e-3 * rng.normal(size=size)])
    whole, some = prepare_scan(PointCloud(points)), prepare_scan(PointCloud(points), fitted)
    np.testing.assert_array_equal(whole.points, some.points)
    assert some.spacing == pytest.approx(whole.spacing, rel=0.05)
    assert some.noise == pytest.approx(whole.noise, rel=0.05)
    assert whole.fitted is None
    assert some.fitted is not None
    assert len(some.fitted) == fitted == np.count_nonzero(some.levers)
    np.testing.assert_array_equal(np.flatnonzero(some.directed), some.fitted)
    assert np.isnan(np.delete(some.residuals, some.fitted)).all()
    # Sixteen neighbours of the noise above fix a normal to a few degrees at this density.
    cosines = np.abs(np.einsum("ij,ij->i", whole.normals[some.fitted], some.normals[some.fitted]))
    assert np.median(cosines) >= np.cos(np.deg2rad(5.0))
    # Few points are taken where planes were fitted, many wherever they are.
    assert np.isin(some.thinned(1_000).points, some.points[some.fitted]).all()
    assert len(some.thinned(fitted + 1)) == fitted + 1


def test_a_thousand_returns_at_the_origin_are_one_point() -> None:
    scan = prepare_scan(PointCloud(np.concatenate([np.zeros((1_000, 3)), GRID + 1.0])))
    assert (scan.total, len(scan), scan.spacing) == (1_201, 1_201, 1.0)


def test_normals_that_were_given_stay_with_their_points_and_make_the_scan_oriented() -> None:
    cloud = sample_mesh(Mesh(*box((3.0, 2.0, 1.0))), 2_000, np.random.default_rng(0))
    scan = prepare_scan(cloud, 700).thinned(1_000)
    assert scan.oriented
    rows = cKDTree(cloud.points).query(scan.points)[1]
    assert cloud.normals is not None
    np.testing.assert_array_equal(scan.points, cloud.points[rows])
    np.testing.assert_array_equal(scan.normals, cloud.normals[rows])


def test_a_viewpoint_orients_the_fitted_normals() -> None:
    def normals(viewpoint: list[float] | None) -> tuple[FloatArray, bool]:
        scan = prepare_scan(PointCloud(GRID, viewpoint=viewpoint))
        return scan.normals, scan.oriented

    above, oriented = normals([20.0, 15.0, 100.0])
    assert oriented
    np.testing.assert_array_equal(above, np.tile([0.0, 0, 1], (1_200, 1)))
    np.testing.assert_array_equal(normals([20.0, 15.0, -100.0])[0], -above)
    assert not normals(None)[1]


def test_a_line_of_points_has_no_normals_and_no_levers_but_is_prepared() -> None:
    scan = prepare_scan(PointCloud(np.outer(np.arange(50.0), [1.0, 2.0, 2.0])))
    assert not scan.normals.any()
    assert not scan.levers.any()
    assert (scan.spacing, scan.noise) == (3.0, 0.0)
    assert scan.diagonal == pytest.approx(147.0)


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_points_are_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"at 3 places at least.* the {count} points of this one are at {count}"):
        prepare_scan(PointCloud(GRID[:count]))


@pytest.mark.parametrize("places", [1, 2])
def test_points_that_coincide_are_refused(places: int) -> None:
    # Distinct places count, as the docstring says, not rows.
    with pytest.raises(InputError, match=f"the 50 points of this one are at {places}"):
        prepare_scan(PointCloud(np.resize(GRID[:places], (50, 3))))


@pytest.mark.parametrize("factor", [1e-3, 1e6])
def test_lengths_follow_the_unit(factor: float) -> None:
    cloud = np.random.default_rng(0).normal(size=(2_000, 3))
    plain, scaled = prepare_scan(PointCloud(cloud)), prepare_scan(PointCloud(factor * cloud))
    for name in ("spacing", "noise", "diagonal"):
        assert getattr(scaled, name) == pytest.approx(factor * getattr(plain, name), rel=1e-9)


@pytest.mark.parametrize(("count", "may_reject"), [(20, False), (2_000, True)])
def test_normals_of_twenty_points_reject_nothing(count: int, may_reject: bool) -> None:
    """Sixteen of them stand on all sides of a block: the plane through them is none of its faces."""
    points = sample_mesh(Mesh(*box((4.0, 3.0, 2.0))), count, np.random.default_rng(0)).points
    assert prepare_scan(PointCloud(points))._rejecting_normals.any() == may_reject
    given = PointCloud(points, normals=np.tile([0.0, 0.0, 1.0], (count, 1)))
    assert prepare_scan(given)._rejecting_normals.any()
