from __future__ import annotations

import mmap
import os
import warnings

import numpy as np
import pytest

from dqreg.kernels.maps.voxel_planes import LONGEST
from dqreg.odometry import map_surface
from dqreg.odometry.map_surface import KEPT_MATCH_VOXELS, MapSurface
from dqreg.rigid import pose

SIZE, MOST, REACH = 0.5, 12, 2.0


def points(count: int) -> np.ndarray:
    """A rough floor, with some places that points share, on both sides of zero."""
    rng = np.random.default_rng(1)
    found = rng.random((count, 3)) * [20.0, 20.0, 0.3] - [10.0, 10.0, 0.1]
    found[: count // 4] = found[: count // 4].round(1)
    return found


def surface_of(cloud: np.ndarray, most: int = MOST) -> MapSurface:
    return MapSurface(SIZE, most, REACH, cloud)


@pytest.mark.parametrize("size", [1, 2, 3, 4_000])
def test_a_hint_finds_no_farther_than_its_tolerance(size: int) -> None:
    surface, queries = surface_of(points(size)), points(700) + np.array([0.05, 0.0, 0.1])
    hint = None
    for step in (0.0, 1e-3, 1e-3, 0.02, 0.3, 5.0, 1e-4):
        queries = pose.apply(pose.exp(np.array([0.0, 0.0, 0.01 * step, step, 0.3 * step, 0.0])), queries)
        found, expected = surface.closest(queries, hint), surface.closest(queries)
        assert (found.distances >= expected.distances - 1e-9).all()
        assert (found.distances <= expected.distances + KEPT_MATCH_VOXELS * SIZE + 1e-6).all()
        near = found.elements >= 0
        assert np.array_equal(found.points[near], surface.points[found.elements[near]])
        hint = queries, found


@pytest.mark.parametrize("most", [1, 12, pytest.param(40, marks=pytest.mark.soak)])
def test_what_is_found_is_nearest_among_the_points_so_far(most: int) -> None:
    cloud, queries = points(4_000), points(300) + np.array([0.02, 0.03, 0.0])
    queries[:40] += [0.0, 0.0, 1.5]
    queries[40:50] += [50.0, 0.0, 0.0]
    surface = surface_of(cloud[:10], most)
    for first, last in ((10, 1_000), (1_000, 1_900), (1_900, 4_000)):
        surface.add(cloud[first:last])
        found = surface.closest(queries)
        apart = np.linalg.norm(queries[:, None] - surface.points, axis=2).min(axis=1)
        near = apart < REACH
        np.testing.assert_allclose(found.distances, np.minimum(apart, REACH), rtol=1e-6)
        np.testing.assert_allclose(surface.distances(queries), found.distances, rtol=1e-6)
        assert np.array_equal(found.elements >= 0, near)
        assert not found.normals[~near].any()
        # What no other is nearer than is a bound.
        others = np.sort(np.linalg.norm(queries[:, None] - surface.points, axis=2), axis=1)[:, 1]
        assert (found.others <= others + 1e-9).all()


def test_planes_are_those_of_all_points_that_were_given() -> None:
    rng, R = np.random.default_rng(2), pose.exp(np.array([0.3, -0.4, 0.0, 0.0, 0.0, 0.0]))[:3, :3]
    flat = np.column_stack([rng.uniform(-3, 3, (20_000, 2)), 0.02 * rng.normal(size=20_000)]) @ R.T
    surface, queries = surface_of(flat[:4_000]), flat[:300]
    few = surface.closest(queries)
    for k in range(4_000, 20_000, 1_000):
        surface.add(flat[k : k + 1_000])
    many = surface.closest(queries)
    # All of them, though the map takes hardly any more points.
    off = [np.arccos(np.minimum(np.abs(found.normals @ R[:, 2]), 1.0)) for found in (few, many)]
    assert np.median(off[1]) < 0.7 * np.median(off[0])
    # And as good as they are said to be: two axes.
    assert 0.5 < np.median(off[1] ** 2 / many.variances) < 2.0


def test_a_plane_outlasts_some_frames_and_no_more_than_it_may() -> None:
    rng = np.random.default_rng(5)
    flat = np.column_stack([rng.uniform(-3, 3, (20_000, 2)), np.zeros(20_000)])
    surface, queries = surface_of(flat), flat[:300]
    before = surface.planes_at(queries).normals
    for k in range(int(LONGEST) + 1):
        np.testing.assert_array_equal(surface.planes_at(queries).normals, before, err_msg=f"after {k} frames")
        surface.add(rng.uniform(-3, 3, (2_000, 3)) * [1.0, 1.0, 0.1] + [0.0, 0.0, 0.2])
    # All were asked for at once, and are fitted anew at once.
    assert (surface.planes_at(queries).normals != before).any(axis=1).all()


def test_a_line_has_no_plane_and_a_sparse_sweep_has() -> None:
    along = np.linspace(-3.0, 3.0, 400)
    line = surface_of(np.column_stack([along, 0.2 * along, np.zeros(400)]))
    assert not line.closest(line.points).normals.any()
    # Two points a voxel: too few in the cells at hand.
    x, y = np.meshgrid(np.arange(-5, 5, 0.35), np.arange(-5, 5, 0.35))
    sparse = surface_of(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    np.testing.assert_allclose(np.abs(sparse.closest(sparse.points).normals[:, 2]), 1.0, rtol=1e-9)


def test_planes_of_cells_are_near_and_those_of_their_points() -> None:
    rng, R = np.random.default_rng(2), pose.exp(np.array([0.3, -0.4, 0.0, 0.0, 0.0, 0.0]))[:3, :3]
    flat = np.column_stack([rng.uniform(-3, 3, (20_000, 2)), 0.02 * rng.normal(size=20_000)])
    surface, asked = surface_of(flat @ R.T), np.column_stack([rng.uniform(-2, 2, (300, 2)), np.full(300, 0.1)])
    found = surface.planes_at(asked @ R.T)
    assert (found.elements >= 0).all()
    np.testing.assert_allclose(np.abs(found.normals @ R[:, 2]), 1.0, atol=2e-3)
    # A twentieth of the noise of the points: a plane has some hundreds.
    np.testing.assert_allclose(found.distances, 0.1, atol=0.015)
    assert (np.linalg.norm(found.points - asked @ R.T, axis=1) < 1.5 * SIZE).all()
    np.testing.assert_allclose(np.sqrt(found.roughness), 0.02, rtol=0.25)
    far = surface.planes_at(np.array([[40.0, 0.0, 0.0]]))
    assert (far.elements[0], far.distances[0], far.normals.any()) == (-1, REACH, False)


def test_what_was_asked_before_stays_in_its_cell() -> None:
    surface, queries = surface_of(points(4_000)), points(700) + np.array([0.05, 0.0, 0.1])
    before = surface.planes_at(queries)
    moved = queries + 0.3
    found, expected = surface.planes_at(moved, before), surface.planes_at(moved)
    # Law: within the same cell the same plane; in another one that of the other.
    same = (np.floor(queries / (0.5 * SIZE)) == np.floor(moved / (0.5 * SIZE))).all(axis=1)
    for name in ("points", "normals", "distances", "elements", "variances", "roughness"):
        assert np.array_equal(getattr(found, name)[~same], getattr(expected, name)[~same]), name
    assert np.array_equal(found.normals[same], before.normals[same])
    assert not np.array_equal(before.distances, found.distances)


def test_the_bits_are_the_same_for_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for threads in ("1", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        surface = surface_of(points(4_000))
        found.append((surface.closest(points(3_000) + 0.05), surface.planes_at(points(3_000) + 0.05)))
    for name in ("points", "normals", "distances", "elements", "others", "variances"):
        for one, other in zip(*found, strict=True):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_pages_of_its_own_change_no_bit_of_a_map(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for large in (1, 2**62):
        monkeypatch.setattr(map_surface, "MIN_HUGE_PAGE_BYTES", large)
        surface = surface_of(points(2_000))
        for part in np.array_split(points(40_000), 4):
            surface.add(part)
        found.append((surface.points.copy(), surface.closest(points(3_000) + 0.05)))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    for name in ("points", "normals", "distances", "elements"):
        assert np.array_equal(getattr(found[0][1], name), getattr(found[1][1], name)), name


@pytest.mark.skipif(not hasattr(mmap, "MADV_HUGEPAGE"), reason="pages of another size: Linux")
def test_room_is_zeros_that_can_be_written_and_that_a_fork_does_not_share() -> None:
    room = map_surface._zeros((map_surface.MIN_HUGE_PAGE_BYTES, 3), np.dtype(np.float32))
    assert room.flags.carray
    assert not room.any()
    with warnings.catch_warnings():
        # Later Pythons warn of threads: the child calls none.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        room[:] = 1.0
        os._exit(0)
    os.waitpid(child, 0)
    assert not room.any()
    room[-1] = 2.0
    assert room.sum() == 6.0
