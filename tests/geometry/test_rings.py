"""Rings of a LiDAR are told from other clouds: from sweeps, spheres, grids and heaps that are generated here."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.geometry.boundary import NEIGHBOUR_COUNT, lie_in_rings
from dqreg.geometry.cells import LINED_PRODUCTS, TOLD_POINTS, Cells
from dqreg.geometry.voxels import DENSE_RATIO, ONE_RING_SHARE, VoxelCloud, cell_size
from dqreg.rigid import pose
from dqreg.synth.many_views import room_stops
from tests.strategies import FloatArray


def are_rings(points: FloatArray) -> bool:
    return lie_in_rings(points, Cells.of(cloud := PointCloud(points), cell_size(cloud, len(points) // 3)).order)


def sweep(rings: int) -> FloatArray:
    return np.asarray(room_stops(1, rings=rings, rng=np.random.default_rng(rings)).scans[0])


def sphere(count: int) -> FloatArray:
    ways = np.random.default_rng(0).normal(size=(count, 3))
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


@pytest.mark.parametrize("rings", [16, 32, 64])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_sweeps_lie_in_rings_in_any_order_unit_and_place(rings: int, unit: float) -> None:
    points = np.random.default_rng(1).permutation(sweep(rings))
    T = pose.exp([0.3, -0.2, 1.0, 4.0, 5.0, 6.0])
    assert are_rings(unit * points)
    assert are_rings(unit * pose.apply(T, points))


@pytest.mark.parametrize("stretch", [1.0, 1.5])
def test_spheres_and_images_do_not(stretch: float) -> None:
    across = np.stack(np.meshgrid(np.arange(120.0), stretch * np.arange(100.0)), axis=-1).reshape(-1, 2)
    image = np.c_[across, 0.02 * np.random.default_rng(2).normal(size=len(across))]
    assert not are_rings(image)
    assert not are_rings(sphere(10_000) * [1.0, stretch, 1.0])


def hall(rings: int, columns: int, noise: float) -> FloatArray:
    """Sweep within 15 degrees from 1.2 above the floor of a hall of 10 by 8 by 3, with noise along the beams."""
    up, around = np.meshgrid(
        np.deg2rad(np.linspace(-15.0, 15.0, rings)), np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)
    )
    ways = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        ranges = np.maximum(np.array([-5.0, -4.0, -1.2]) / ways, np.array([5.0, 4.0, 1.8]) / ways).min(axis=1)
    return np.asarray(ways * (ranges + noise * np.random.default_rng(3).normal(size=len(ways)))[:, None])


@pytest.mark.parametrize(("rings", "columns"), [(32, 900), (16, 600)])
def test_a_floor_that_lines_alone_show_tells_rings(rings: int, columns: int) -> None:
    # On the walls rings are as near each other as points on one: nineteen of twenty neighbourhoods are planes.
    sweep = hall(rings, columns, 0.015)
    assert are_rings(sweep)
    on_walls = np.abs(sweep[:, 2] + 1.2) > 0.1
    assert not are_rings(sweep[on_walls & (sweep[:, 2] < 1.7)])


@pytest.mark.parametrize("columns", [1_800, 3_600])
@pytest.mark.parametrize("count", [3_000, 6_000])
def test_cells_of_a_dense_sweep_of_few_rings_are_wide_enough_for_two_of_them(columns: int, count: int) -> None:
    # The denser the points on each ring, the smaller are cells of so many: each held points of one ring.
    points = hall(16, columns, 0.015)
    assert len(points) > DENSE_RATIO * count
    cloud = PointCloud(points)
    found, narrow = VoxelCloud.evened(cloud, count), Cells.of(cloud, cell_size(cloud, count))
    assert found.of_few_rings
    assert found.surface is not None
    assert found.surface.cells.lined_share <= ONE_RING_SHARE < narrow.lined_share


def test_cells_of_a_dense_sweep_of_many_rings_stay_as_small_as_asked() -> None:
    points = hall(64, 1_800, 0.015)
    found = VoxelCloud.evened(PointCloud(points), 6_000)
    assert not found.of_few_rings
    assert found.size == cell_size(PointCloud(points), 6_000)


def test_lined_cells_are_those_whose_second_variance_is_a_small_part_of_the_first() -> None:
    cells = Cells.of(PointCloud(hall(16, 1_800, 0.015)), 0.3)
    told = cells.counts >= TOLD_POINTS
    matrices = cells.scatters[told][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    least, small, large = np.linalg.eigvalsh(matrices).T
    lined = small * large + least * (small + large) <= LINED_PRODUCTS * (least + small + large) ** 2
    assert cells.lined_share == pytest.approx(lined.mean(), abs=1.5 / len(lined))
    flat = least <= 1e-3 * large
    np.testing.assert_array_equal(lined[flat], (small <= 0.38 * large)[flat])
    assert 0.2 < cells.lined_share < 0.8
    assert Cells.of(PointCloud(sphere(10)), 10.0).lined_share == 0.0


def test_where_hardly_a_sure_plane_holds_a_direction_planes_are_sought_among_more_neighbours() -> None:
    # Cells hold points of several rings on the walls; three that graze the floor make hardly a plane that is sure.
    surface = VoxelCloud.evened(PointCloud(hall(32, 900, 0.015)), 6_000).surface
    assert surface is not None
    assert not surface.of_few_rings
    on_floor = np.abs(surface._points[:, 2] + 1.2) < 0.03
    by_next, sought = surface.cells.planes().fits.normals[on_floor, 2], surface.normals[on_floor, 2]
    assert (np.abs(by_next) > 0.98).mean() < 0.7
    # Some cells, by a wall or a column, have none.
    held = sought != 0.0
    assert held.mean() > 0.8
    assert (np.abs(sought[held]) > 0.98).mean() > 0.9
    assert surface.wide[on_floor].any()


def test_planes_sought_in_rings_leave_those_of_the_cells_to_other_threads() -> None:
    surface = VoxelCloud.evened(PointCloud(hall(32, 900, 0.015)), 6_000).surface
    assert surface is not None
    assert surface._cell_planes is not None
    before = surface._cell_planes.fits.normals.copy()
    assert surface.normals.any()
    assert surface.has_wide
    np.testing.assert_array_equal(surface._cell_planes.fits.normals, before)


@pytest.mark.parametrize(
    "points",
    [hall(64, 1_800, 0.015), np.c_[np.random.default_rng(5).uniform(size=(20_000, 2)), np.zeros(20_000)]],
    ids=["floor", "plate"],
)
def test_where_they_hold_all_directions_or_no_rings_are_seen_the_next_ones_decide(points: FloatArray) -> None:
    surface = VoxelCloud.evened(
        PointCloud(points + 1e-3 * np.random.default_rng(6).normal(size=points.shape)), 6_000
    ).surface
    assert surface is not None
    assert len(surface.normals)
    assert not surface.wide.any()


@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_planes_at_a_slant_do_not(noise: float) -> None:
    across = np.stack(np.meshgrid(np.linspace(0.0, 1.0, 130), np.linspace(0.0, 0.8, 80)), axis=-1).reshape(-1, 2)
    assert not are_rings(
        np.c_[across, noise * np.random.default_rng(2).normal(size=len(across))]
        @ pose.exp([0.4, 0.3, 0, 0, 0, 0])[:3, :3].T
    )


def test_a_narrow_strip_is_a_line_only_where_noise_is_as_wide() -> None:
    # One neighbourhood in eleven is on a strip that lies across the rest, eight times as long as wide.
    front = np.stack(np.meshgrid(np.arange(100.0), np.arange(100.0)), axis=-1).reshape(-1, 2)
    steps = np.arange(1_000)
    strip = np.c_[0.1 * steps, np.full(1_000, 120.0), 0.05 * (-1.0) ** steps]
    points, across = np.r_[np.c_[front, np.zeros(10_000)], strip], np.repeat([2, 1], [10_000, 1_000])
    noise = np.random.default_rng(4).normal(size=(11_000, 1)) * np.eye(3)[across]
    assert not are_rings(points + 0.01 * noise)
    assert are_rings(points + 0.05 * noise)


def test_cells_of_rings_have_no_rims() -> None:
    found = VoxelCloud.evened(PointCloud(sweep(32)), 10_000)
    assert found.surface is not None
    closest = found.surface.closest(found.cloud.points)
    assert found.surface._of_cells[1].any()
    assert not found.surface.on_rim(closest).any()


def test_copies_of_a_point_are_no_line() -> None:
    assert not lie_in_rings(np.ones((500, 3)), np.arange(500))
    points = np.repeat(sphere(2_000), NEIGHBOUR_COUNT + 1, axis=0)
    assert not are_rings(points)


@pytest.mark.parametrize("count", [0, 1, NEIGHBOUR_COUNT])
def test_a_few_points_lie_in_none(count: int) -> None:
    assert not lie_in_rings(np.arange(3.0 * count).reshape(-1, 3), np.arange(count))


def test_a_sweep_is_downsampled_where_a_cloud_of_as_many_points_is_not() -> None:
    rings, other = sweep(32), sphere(12_288)
    assert len(rings) == len(other)
    found = VoxelCloud.evened(PointCloud(rings), 10_000)
    assert found.surface is not None
    assert found.surface.in_rings
    assert VoxelCloud.evened(PointCloud(other), 10_000).surface is None
