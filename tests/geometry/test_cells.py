from __future__ import annotations

import threading
import time

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.geometry import CloudSurface, PointCloud
from dqreg.geometry.cells import (
    EDGE_LEVELS,
    MAX_COUNTED_POINTS,
    MIN_PLANE_POINTS,
    MIN_PLANE_VARIANCE_RATIO,
    REACH_EDGES,
    SHAPE_RESIDUAL_RATIO,
    Cells,
)
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import PlaneFits, fit_planes_around
from dqreg.geometry.voxels import VoxelCloud
from dqreg.kernels.cells.cell_planes import MIN_CELLS


def sheet(seed: int, count: int) -> np.ndarray:
    """Points strewn over a bowl, more of them in the middle."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, count))
    return np.column_stack([x, y, 0.1 * (x**2 + y**2) + rng.normal(scale=0.01, size=count)])


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.integers(1, 400), st.floats(0.05, 20.0))
def test_cells_hold_the_moments_of_their_points(seed: int, count: int, size: float) -> None:
    points = sheet(seed, count)
    cells = Cells.of(PointCloud(points), size)
    assert np.all(np.diff(cells.codes.astype(np.int64)) > 0)
    for k, rows in enumerate(np.split(cells.order, cells.starts[1:])):
        off = points[rows] - points[rows].mean(axis=0)
        assert cells.counts[k] == len(rows)
        assert np.allclose(cells.points[k], points[rows].mean(axis=0), rtol=0.0, atol=1e-12)
        expected = (off.T @ off)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        assert np.allclose(cells.scatters[k], expected, rtol=0.0, atol=1e-10 * size**2 * len(rows))


def plane_around(cells: Cells, blocks: np.ndarray, k: int) -> tuple[np.ndarray, float, float, np.ndarray] | None:
    """Normal, residual, lever and axes of the plane through the cells around one of them, by plain sums."""
    near = np.linalg.norm(cells.points - cells.points[k], axis=1) <= REACH_EDGES * cells.size
    near &= np.abs(blocks - blocks[k]).max(axis=1) <= 1
    weights = np.minimum(cells.counts, MAX_COUNTED_POINTS)
    w, middles = weights[near], cells.points[near]
    mean = w @ middles / w.sum()
    off = middles - mean
    inner = cells.scatters[near] * (w / cells.counts[near])[:, None]
    scatter = np.einsum("i,ij,ik->jk", w, off, off) + inner.sum(axis=0)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    values, vectors = np.linalg.eigh(scatter)
    if w.sum() < MIN_PLANE_POINTS or near.sum() <= MIN_CELLS or values[1] <= MIN_PLANE_VARIANCE_RATIO * values[2]:
        return None
    return vectors[:, 0], np.sqrt(values[0] / (w.sum() - 3.0)), 1.0 / (w.sum() / values[1:]).sum(), vectors[:, 1:].T


def test_planes_are_those_of_all_cells_within_reach_and_of_wider_ones_where_these_make_none() -> None:
    points = sheet(0, 20_000)
    cells = [Cells.of(PointCloud(points), 0.15 * 2.0**level) for level in range(EDGE_LEVELS)]
    fits = cells[0].planes().fits
    low, levels = points.min(axis=0), []
    blocks = [np.floor((points[one.order[one.starts]] - low) / one.size).astype(int) // 2 for one in cells]
    for k in range(0, len(cells[0].codes), 7):
        found, row, level = None, k, 0
        while found is None and level < EDGE_LEVELS:
            row = int(np.searchsorted(cells[level].codes, cells[0].codes[k] >> np.uint64(3 * level)))
            found = plane_around(cells[level], blocks[level], row)
            level += 1
        levels.append(level if found is not None else 0)
        assert fits.known[k] == (found is not None)
        if found is not None:
            assert abs(found[0] @ fits.normals[k]) > 1.0 - 1e-9
            assert np.isclose(fits.residuals[k], found[1], rtol=1e-6)
            assert np.isclose(fits.lever[k], found[2], rtol=1e-6)
    assert set(levels) == set(range(EDGE_LEVELS + 1))


def height_around(cells: Cells, blocks: np.ndarray, k: int, normal: np.ndarray, axes: np.ndarray) -> float:
    """Height over the mean of a cell of a plane and a mean bend through those around, by plain least squares.

    Along the axes of the scatter of their points these are independent of each other.
    """
    near = np.linalg.norm(cells.points - cells.points[k], axis=1) <= REACH_EDGES * cells.size
    near &= np.abs(blocks - blocks[k]).max(axis=1) <= 1
    w, off = np.minimum(cells.counts, MAX_COUNTED_POINTS)[near], cells.points[near] - cells.points[k]
    mean, q = w @ off / w.sum(), (off**2).sum(axis=1)
    product = (w * (q - w @ q / w.sum())) @ off
    inner = (cells.scatters[near] * (w / cells.counts[near])[:, None]).sum(axis=0)
    scatter = (off - mean).T @ (w[:, None] * (off - mean)) + inner[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    along = axes @ product
    slopes = along / np.array([axis @ scatter @ axis for axis in axes])
    bend = (normal @ product) / (w @ (q - w @ q / w.sum()) ** 2 - slopes @ along)
    return float(normal @ mean - bend * (w @ q / w.sum() - slopes @ (axes @ mean)))


def test_heights_are_those_of_a_plane_and_a_mean_bend_through_the_neighbours() -> None:
    points = sheet(1, 20_000)
    cells = Cells.of(PointCloud(points), 0.15)
    planes, low = cells.planes(), points.min(axis=0)
    blocks = np.floor((points[cells.order[cells.starts]] - low) / cells.size).astype(int) // 2
    compared = 0
    for k in range(0, len(cells.codes), 7):
        found = plane_around(cells, blocks, k)
        if found is None:
            # One of wider cells is no surface that this mean could be moved to.
            assert planes.heights[k] == 0.0
            continue
        normal, axes = planes.fits.normals[k], found[3]
        assert np.isclose(planes.heights[k], height_around(cells, blocks, k, normal, axes), rtol=1e-6, atol=1e-9)
        compared += 1
    assert compared > 50


def test_smoothing_takes_noise_away_and_leaves_the_shape() -> None:
    # A paraboloid, curved by one in three widths of what a plane is fitted to: its means would sink by 0.006.
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-1.0, 1.0, size=(2, 60_000))
    for noise in (0.0, 0.01):
        points = np.column_stack([x, y, 0.4 * (x**2 + y**2) + rng.normal(scale=noise, size=len(x))])
        cells = Cells.of(PointCloud(points), 0.05)
        moved = cells.smoothed(cells.planes())
        inside = np.abs(cells.points[:, :2]).max(axis=1) < 0.8
        raw, smooth = (
            np.abs(one.points[inside, 2] - 0.4 * (one.points[inside, :2] ** 2).sum(axis=1)) for one in (cells, moved)
        )
        if noise:
            assert np.sqrt((smooth**2).mean()) < 0.5 * np.sqrt((raw**2).mean())
        else:
            assert smooth.max() < 1e-3


def test_an_edge_is_not_rounded_by_more_than_its_residual_allows() -> None:
    # Two faces that meet at a right angle: what stands off their common plane is no noise.
    rng = np.random.default_rng(3)
    flat, wall = rng.uniform(size=(2, 30_000, 2))
    floor = np.column_stack([flat, np.zeros(len(flat))])
    upright = np.column_stack([wall[:, 0], np.zeros(len(wall)), wall[:, 1]])
    cells = Cells.of(PointCloud(np.vstack([floor, upright]) + rng.normal(scale=0.003, size=(60_000, 3))), 0.05)
    planes = cells.planes()
    known, usual = planes.fits.known, np.median(planes.fits.residuals[planes.fits.known])
    shifts = np.linalg.norm(cells.smoothed(planes).points - cells.points, axis=1)
    at_edge = known & (planes.fits.residuals > 2.0 * SHAPE_RESIDUAL_RATIO * usual)
    assert np.count_nonzero(at_edge) > 20
    assert np.all(shifts[at_edge] <= 0.25 * np.abs(planes.heights[at_edge]) + 1e-12)
    assert np.allclose(
        shifts[known & (planes.fits.residuals < usual)], np.abs(planes.heights)[known & (planes.fits.residuals < usual)]
    )


def test_a_cell_of_a_thousand_copies_turns_no_plane() -> None:
    flat = np.random.default_rng(0).uniform(-1.0, 1.0, size=(4_000, 3)) * [1.0, 1.0, 0.0]
    stray = np.tile([0.05, 0.05, 0.12], (1_000, 1))
    fits = Cells.of(PointCloud(np.vstack([flat, stray])), 0.1).planes().fits
    assert np.abs(fits.normals[fits.known, 2]).min() > 0.9


def test_rims_lie_round_a_sheet_and_not_within_it() -> None:
    flat = np.random.default_rng(0).uniform(-1.0, 1.0, size=(40_000, 3)) * [1.0, 1.0, 0.0]
    cells = Cells.of(PointCloud(flat), 0.05)
    rims = cells.planes().rims
    inside = np.abs(cells.points).max(axis=1)
    assert rims[inside > 0.97].mean() > 0.9
    assert rims[inside < 0.85].mean() < 0.02


def test_where_cells_make_no_plane_their_nearest_ones_do() -> None:
    # Some points far apart beside a wall that is dense.
    rng = np.random.default_rng(0)
    wall = rng.uniform(-1.0, 1.0, size=(20_000, 3)) * [1.0, 1.0, 0.0]
    few = rng.uniform([2.0, -2.5, -0.1], [12.0, 2.5, 0.1], size=(40, 3))
    even = VoxelCloud.of(PointCloud(np.vstack([wall, few])), 0.1)
    assert even.surface is not None
    by_cells = Cells.of(PointCloud(np.vstack([wall, few])), 0.1).planes().fits.known
    beside = even.cloud.points[:, 0] > 1.5
    assert by_cells[~beside].mean() > 0.98
    assert not by_cells[beside].any()
    searched = CloudSurface(even.cloud).closest(even.cloud.points[beside]).normals
    assert np.allclose(np.abs(even.surface.normals[beside]), np.abs(searched), atol=1e-9)
    assert np.abs(even.surface.normals[~beside, 2]).min() > 1.0 - 1e-9


def test_planes_that_are_fitted_ahead_have_the_bits_of_those_fitted_where_they_are_met() -> None:
    # Points far apart off the sheet, where cells make no plane.
    few = np.random.default_rng(0).uniform([4.0, -2.5, -2.5], [9.0, 2.5, 2.5], size=(80, 3))
    cloud = PointCloud(np.vstack([sheet(3, 8_000), few]))
    ahead, met = (VoxelCloud.of(cloud, 0.25).surface for _ in range(2))
    assert ahead is not None
    assert met is not None
    ahead.fit_cells()
    assert 0 < np.count_nonzero(ahead._known) < len(ahead._known)
    ahead.begin_rest()
    asked = ahead._points + 0.01
    one, other = ahead.closest(asked), met.closest(asked)
    assert ahead._known.all()
    np.testing.assert_array_equal(one.normals, other.normals)
    np.testing.assert_array_equal(one.variances, other.variances)


def test_planes_that_are_being_fitted_beside_are_waited_for_and_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    few = np.random.default_rng(0).uniform([4.0, -2.5, -2.5], [9.0, 2.5, 2.5], size=(80, 3))
    surface = VoxelCloud.of(PointCloud(np.vstack([sheet(3, 8_000), few])), 0.25).surface
    assert surface is not None
    surface.fit_cells()
    missing, fitted, is_asked = np.count_nonzero(~surface._known), [], threading.Event()

    def slow(tree: NeighbourTree, points: np.ndarray, rows: np.ndarray) -> PlaneFits:
        fitted.append(len(rows))
        is_asked.wait(10.0)
        return fit_planes_around(tree, points, rows)

    monkeypatch.setattr("dqreg.kernels.threads.thread_count", lambda: 2)
    monkeypatch.setattr("dqreg.geometry.cells.fit_planes_around", slow)
    surface.begin_rest()
    while not fitted:
        time.sleep(1e-3)
    threading.Timer(0.1, is_asked.set).start()
    surface.closest(surface._points + 0.01)
    assert fitted == [missing]
