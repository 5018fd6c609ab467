from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, MeshSurface, PointCloud, prepare_scan
from dqreg.icp import Correspondences, find_correspondences, propagate
from dqreg.icp.correspondences import moved_points, placed, slid_distances
from dqreg.rigid import pose
from tests.icp.scenes import bracket_mesh, bracket_points, bumpy_cloud, made_pairs, motion


def test_correspond_asks_for_the_moved_points_and_leaves_the_scan_alone() -> None:
    source, target = bumpy_cloud(200, seed=1), bumpy_cloud(300, seed=2)
    scan, T = prepare_scan(PointCloud(source)), motion(0.2, 0.1)
    before = scan.points.copy()
    pairs = find_correspondences(scan, CloudSurface(PointCloud(target)), T)
    # Brute force over all 60,000 distances.
    gaps = np.linalg.norm(pose.apply(T, scan.points)[:, None] - target[None], axis=2)
    np.testing.assert_allclose(pairs.distances, gaps.min(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(pairs.closest.points, target[gaps.argmin(axis=1)])
    np.testing.assert_array_equal(scan.points, before)
    assert pairs.scan is scan


def test_cosines_compare_moved_source_normals() -> None:
    pairs = made_pairs()
    expected = np.sum(pose.rotate(pairs.T_target_source, pairs.scan.normals) * pairs.closest.normals, axis=1)
    np.testing.assert_allclose(pairs.normal_cosines, expected, atol=1e-14)


def test_source_directions_agree_with_the_target_unless_signs_are_known() -> None:
    free, known = made_pairs(same_sign=False), made_pairs(same_sign=True)
    assert (free.normal_cosines < 0.0).any()
    turned = np.sum(pose.rotate(free.T_target_source, free.source_directions) * free.closest.normals, axis=1)
    np.testing.assert_allclose(turned, np.abs(free.normal_cosines), atol=1e-14)
    np.testing.assert_array_equal(known.source_directions, known.scan.normals)


@pytest.mark.parametrize("source", [False, True])
@pytest.mark.parametrize("target", [False, True])
def test_signs_count_only_if_both_sides_know_theirs(source: bool, target: bool) -> None:
    points = bumpy_cloud(50)
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    scan = prepare_scan(PointCloud(points, up if source else None))
    surface = CloudSurface(PointCloud(points, up if target else None))
    assert find_correspondences(scan, surface, np.eye(4)).same_sign is (source and target)


def tracked(step: float) -> tuple[Correspondences, np.ndarray, MeshSurface]:
    """Pairs of a scan at its true pose, which is the identity, and a pose a step of the size away."""
    part = bracket_mesh()
    scan = prepare_scan(PointCloud(bracket_points(60, seed=0)))
    return (
        find_correspondences(scan, MeshSurface(part), np.eye(4)),
        motion(step, step * part.diagonal),
        MeshSurface(part),
    )


@pytest.mark.parametrize("step", [1e-5, 1e-4])
def test_carried_pairs_are_those_that_the_surface_would_name(step: float) -> None:
    pairs, T, surface = tracked(step)
    there, asked = propagate(pairs, T), find_correspondences(pairs.scan, surface, T)
    gone = np.linalg.norm(there.moved - pairs.moved, axis=1)
    off = np.abs(there.distances - asked.distances)
    # Exact inside the faces; and over an edge no point is wrong by more than it has moved.
    assert (off <= 1e-12 * surface.diagonal).mean() >= 0.9
    assert (off <= gone).all()
    np.testing.assert_allclose(there.distances, np.linalg.norm(there.moved - there.closest.points, axis=1), rtol=1e-12)
    # The answer is of the new pose, not of the old one.
    assert np.median(np.abs(pairs.distances - asked.distances)) > 100.0 * np.median(off)


def test_carried_pairs_of_a_cloud_keep_the_gaps_between_its_points() -> None:
    points = bumpy_cloud(400, seed=3)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    pairs = find_correspondences(
        prepare_scan(PointCloud(points + np.array([0.01, 0.0, 0.02]))),
        CloudSurface(PointCloud(points, normals)),
        np.eye(4),
    )
    aside, up = (
        propagate(pairs, pose.from_parts(np.eye(3), shift)) for shift in ([0.005, 0.0, 0.0], [0.0, 0.0, 0.003])
    )
    np.testing.assert_allclose(aside.distances, pairs.distances, rtol=1e-12)
    np.testing.assert_allclose(up.point_to_plane, pairs.point_to_plane + 0.003, atol=1e-14)
    np.testing.assert_allclose(
        up.distances**2 - up.point_to_plane**2, pairs.distances**2 - pairs.point_to_plane**2, atol=1e-14
    )


def test_carried_pairs_are_those_of_numpy() -> None:
    pairs, T = made_pairs(), motion(0.1, 0.3)
    moved = pose.apply(T, pairs.scan.points)
    across = np.sum((moved - pairs.moved) * pairs.closest.normals, axis=1)
    points = pairs.closest.points + moved - pairs.moved - across[:, None] * pairs.closest.normals
    found = propagate(pairs, T)
    np.testing.assert_allclose(found.moved, moved, atol=1e-14)
    np.testing.assert_allclose(found.closest.points, points, atol=1e-14)
    np.testing.assert_allclose(found.distances, np.linalg.norm(moved - points, axis=1), atol=1e-14)
    rows = np.arange(1, len(moved), 3)
    np.testing.assert_array_equal(slid_distances(pairs, T), found.distances)
    np.testing.assert_array_equal(slid_distances(pairs, T, rows), found.distances[rows])


def test_points_placed_at_a_pose_stand_as_high_over_their_planes_as_numpy_says() -> None:
    rng = np.random.default_rng(5)
    scan = prepare_scan(PointCloud(rng.normal(size=(300, 3))))
    pairs, T = find_correspondences(scan, MeshSurface(bracket_mesh()), np.eye(4)), motion(0.2, 0.1)
    moved, heights = placed(pairs, T)
    np.testing.assert_allclose(moved, pose.apply(T, scan.points), rtol=0, atol=1e-14)
    gaps = moved - pairs.closest.points
    np.testing.assert_allclose(heights, np.einsum("ij,ij->i", gaps, pairs.closest.normals), rtol=0, atol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 40_000])
def test_moved_points_are_those_of_numpy(count: int) -> None:
    points, T = np.random.default_rng(count).normal(size=(count, 3)), motion(0.2, 0.1)
    np.testing.assert_allclose(moved_points(T, points), pose.apply(T, points), rtol=0, atol=1e-14)
