from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
from hypothesis import given, settings

from dqreg.geometry import CloudSurface, PointCloud
from dqreg.geometry.cells import Cells
from dqreg.geometry.voxels import RING_UNEVENNESS, VoxelCloud, cell_size, points_of


def means(cloud: PointCloud, size: float) -> PointCloud:
    return points_of(cloud, Cells.of(cloud, size))


def cloud(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-3.0, 5.0, size=(count, 3))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(1, 400), st.floats(0.05, 20.0))
def test_each_cell_gives_the_mean_of_its_points(seed: int, count: int, size: float) -> None:
    points = cloud(seed, count)
    cells: dict[tuple[int, ...], list[np.ndarray]] = {}
    for point in points:
        cells.setdefault(tuple(((point - points.min(axis=0)) * (1.0 / size)).astype(int)), []).append(point)
    expected = np.array(sorted(np.mean(members, axis=0).tolist() for members in cells.values()))
    found = np.array(sorted(means(PointCloud(points), size).points.tolist()))
    assert np.allclose(found, expected, rtol=0.0, atol=1e-12)


def test_normals_are_averaged_and_a_sheet_seen_from_both_sides_keeps_one() -> None:
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [9.0, 0, 0], [9.1, 0, 0]])
    normals = np.array([[0.0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
    thin = means(PointCloud(points, normals, viewpoint=[1.0, 2, 3], units="m"), 1.0)
    assert thin.normals is not None
    assert np.allclose(thin.normals, [[0, np.sqrt(0.5), np.sqrt(0.5)], [0, 0, 1]])
    assert thin.units == "m"
    assert thin.viewpoint is not None
    assert thin.viewpoint.tolist() == [1.0, 2.0, 3.0]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(-9.0, 9.0), st.integers(300, 3_000), st.sampled_from([0.0, 300.0, 3e3]))
def test_the_cells_are_about_as_many_as_asked_for_whatever_the_unit(
    seed: int, exponent: float, count: int, stray: float
) -> None:
    # A sphere whose points crowd at one pole, as they do near a sensor; and a point so many radii away.
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(20_000, 3)) * [0.05, 0.05, 1.0]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways[0] *= max(stray, 1.0)
    points = 10.0**exponent * ways
    size = cell_size(PointCloud(points), count)
    assert count / 1.25 <= len(means(PointCloud(points), size)) <= count * 1.25


def test_few_points_are_left_alone() -> None:
    same = PointCloud(cloud(0, 50))
    assert cell_size(same, 50) == 0.0
    assert VoxelCloud.of(same, 0.0).cloud is same


def test_copies_of_one_point_vote_once() -> None:
    points = np.vstack([np.zeros((5_000, 3)), cloud(1, 100)])
    size = cell_size(PointCloud(points), 50)
    assert len(means(PointCloud(points), size)) <= 101


def room(rings: int, along: int) -> PointCloud:
    """Walls, floor and ceiling of a hall, as a LiDAR with so many rings sees them."""
    up, turn = np.meshgrid(np.linspace(-0.4, 0.4, rings), np.linspace(0.0, 2.0 * np.pi, along, endpoint=False))
    ways = np.stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)], axis=-1).reshape(-1, 3)
    # The nearest wall ends a ray.
    far = (np.array([12.0, 7.0, 2.0]) / np.maximum(np.abs(ways), 1e-12)).min(axis=1)
    return PointCloud(ways * far[:, None] + np.random.default_rng(0).normal(scale=0.01, size=ways.shape))


def test_rings_that_stand_apart_are_thinned_until_neighbourhoods_are_no_lines() -> None:
    rings = room(8, 2_000)
    assert CloudSurface(rings)._in_lines
    even = VoxelCloud.evened(rings, 10_000)
    # The cloud is not dense: its shape alone asks for cells.
    assert len(rings) < 3 * 10_000
    assert 1_000 < len(even.cloud) < len(rings) / 3
    assert even.surface is not None
    assert not even.surface._in_lines


def test_an_even_cloud_that_is_not_dense_stays_whole_and_a_crowded_one_does_not() -> None:
    even = PointCloud(cloud(0, 9_000) * [1.0, 1.0, 0.01])
    assert Cells.of(even, cell_size(even, 3_000)).unevenness < 1.2
    assert VoxelCloud.evened(even, 10_000).cloud is even
    # Ranges as of a sensor on the ground: nearly all points lie near it.
    rng = np.random.default_rng(1)
    reach, turn = 10.0 ** rng.uniform(-2.0, 1.0, 9_000), rng.uniform(0.0, 2.0 * np.pi, 9_000)
    crowded = PointCloud(np.column_stack([reach * np.cos(turn), reach * np.sin(turn), rng.normal(size=9_000) * 0.01]))
    assert Cells.of(crowded, cell_size(crowded, 3_000)).unevenness > RING_UNEVENNESS
    assert len(VoxelCloud.evened(crowded, 10_000).cloud) < 4_000
