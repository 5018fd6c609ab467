from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud, prepare_scan
from dqreg.geometry.normals import sample_rows
from dqreg.trust.patch_tests import PATCH_POINTS, isolated, patches_off, share_displaced, share_together

WIDTH, NOISE = 0.01, 1e-3


def strips(*heights: float, length: float = 1.0) -> np.ndarray:
    """Squares of 320 points each, one beside the other, at the heights given; ten patches a square."""
    rng = np.random.default_rng(0)
    squares = [rng.uniform(size=(320, 3)) * [length, 1, 0] + [i * length, 0, z] for i, z in enumerate(heights)]
    ordered = [square[np.argsort(square[:, 0])] for square in squares]
    return np.concatenate(ordered) + rng.normal(0.0, 0.2 * WIDTH, size=(320 * len(heights), 3)) * [0, 0, 1]


def looked_at(points: np.ndarray, reach: float) -> tuple[int, float]:
    # The target is the plane z = 0 from x = 0 to x = 1.
    beside = np.maximum(points[:, 0] - 1.0, 0.0)
    apart = np.hypot(beside, points[:, 2])
    counted, off = patches_off(points, apart, points[:, 2], apart <= reach, WIDTH)
    return int(np.count_nonzero(counted)), np.count_nonzero(off) / max(np.count_nonzero(counted), 1)


def test_a_face_in_the_wrong_place_is_off() -> None:
    assert looked_at(strips(0.0), 0.2) == (10, 0.0)
    assert looked_at(strips(0.05), 0.2) == (10, 1.0)


def test_a_table_that_goes_on_beyond_the_part_is_not_the_parts() -> None:
    # Five squares of table at the height of the part; a fifth of the first one is near it.
    count, share = looked_at(strips(0.0, 0.05, 0.05, 0.05, 0.05, 0.05), 0.2)
    assert (count, share) == (10, 0.0)


def test_a_shifted_part_on_a_table_is_still_off() -> None:
    # Table at 0.15, which goes on; the part's own face 0.05 off, which does not.
    points = strips(0.05, 0.15, 0.15, 0.15, 0.15)
    count, share = looked_at(points, 0.2)
    assert count >= 9
    assert share >= 0.8


@pytest.mark.parametrize("count", [0, PATCH_POINTS - 1])
def test_too_few_points_are_no_patch(count: int) -> None:
    none = np.zeros(count)
    counted, off = patches_off(np.zeros((count, 3)), none, none, np.ones(count, dtype=bool), WIDTH)
    assert (len(counted), len(off)) == (0, 0)


def test_points_of_one_feature_are_off_together_and_outliers_are_not() -> None:
    # A sheet in the order of its rows, with a boss of 3 % of the points.
    x, y = (place.ravel() for place in np.meshgrid(np.arange(100.0), np.arange(20.0)))
    points, counted = np.column_stack([x, y, np.zeros_like(x)]), np.ones(len(x), dtype=bool)
    boss = (np.abs(x - 50.0) <= 4.0) & (np.abs(y - 10.0) <= 3.0)
    assert share_together(points, boss, counted) == pytest.approx(np.mean(boss))
    # What stands elsewhere is asked for by nobody.
    assert share_together(points, boss, ~boss) == 0.0
    rng = np.random.default_rng(0)
    outliers = rng.uniform(size=(200, len(x))) < 0.03
    shares = [share_together(points, row, counted) for row in outliers]
    assert np.mean(np.array(shares) > 0.0) <= 0.01
    assert share_together(points, boss | outliers[0], counted) >= np.mean(boss)


@pytest.mark.parametrize("strays", [0, 3, 60])
@pytest.mark.parametrize("noise", [1e-4, 0.02])
def test_isolated_points_are_those_with_neighbours_far_beyond_the_usual(strays: int, noise: float) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(size=(3_000, 2)), noise * rng.normal(size=3_000)])
    points[:strays, 2] = rng.uniform(0.3, 1.0, strays)
    scan = prepare_scan(PointCloud(points))
    on = np.abs(scan.points[:, 2]) <= 3.0 * noise
    gaps = cKDTree(scan.points).query(scan.points, 6)[0][:, -1]
    usual = np.median(gaps[np.flatnonzero(on)[sample_rows(int(on.sum()), 250)]])
    alone = isolated(scan, on)
    np.testing.assert_array_equal(alone, ~on & (gaps > 2.5 * usual))
    assert alone.any() == (strays > 0)


def sides_of_a_cube(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Points on three sides of a unit cube, and their normals."""
    points, sides = rng.uniform(size=(count, 3)), rng.integers(3, size=count)
    points[np.arange(count), sides] = 0.0
    return points + NOISE * rng.normal(size=points.shape), -np.eye(3)[sides]


@pytest.mark.parametrize("seed", range(5))
def test_a_face_beside_its_place_is_told_from_outliers_by_its_heights(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = sides_of_a_cube(rng, 900)
    off = np.zeros(900, dtype=bool)
    off[:60] = True
    # Any height within the same reach is an outlier; one height is a face.
    scattered = points - np.where(off, rng.uniform(0.01, 0.05, 900), 0.0)[:, None] * normals
    displaced = points - np.where(off & (normals[:, 0] != 0.0), 0.04, 0.0)[:, None] * normals
    assert share_displaced(scattered, normals, off, NOISE) == 0.0
    expected = np.count_nonzero(off & (normals[:, 0] != 0.0)) / 900
    assert share_displaced(displaced, normals, off & (normals[:, 0] != 0.0), NOISE) == pytest.approx(expected, rel=0.1)


def test_a_turn_of_all_changes_nothing_and_few_points_tell_nothing() -> None:
    rng = np.random.default_rng(7)
    points, normals = sides_of_a_cube(rng, 600)
    off = np.arange(600) < 90
    points = np.where((off & (normals[:, 2] != 0.0))[:, None], points + np.array([0.0, 0.0, 0.03]), points)
    off &= normals[:, 2] != 0.0
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = share_displaced(points, normals, off, NOISE)
    assert found > 0.03
    assert share_displaced(points @ turn.T, normals @ turn.T, off, NOISE) == pytest.approx(found, abs=0.005)
    assert share_displaced(points, normals, off & (np.cumsum(off) <= 11), NOISE) == 0.0
