"""Correspondences at another pose, beside NumPy's; their weights stand in tests/icp/test_weighing.py."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.kernels.steps.weighing import SUMS, move_rows, place_rows, slide_rows, weigh_rows
from dqreg.rigid import pose
from tests.trust.shapes import unit

COUNT = 37
NOTHING = np.zeros(0)


def drawn(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points, a pose, where the feet were found, the feet and their normals."""
    rng = np.random.default_rng(seed)
    points, before, feet = rng.normal(size=(3, COUNT, 3))
    return points, pose.random(rng, reach=2.0), before, feet, unit(rng.normal(size=(COUNT, 3)))


def test_points_are_moved_and_placed_over_feet_that_stay() -> None:
    points, T, _, feet, normals = drawn(0)
    moved, placed, heights = np.zeros((COUNT, 3)), np.zeros((COUNT, 3)), np.zeros(COUNT)
    for first, last in ((20, COUNT), (0, 20)):
        move_rows(first, last, points, T, moved)
        place_rows(first, last, points, T, feet, normals, placed, heights)
    np.testing.assert_allclose(moved, pose.apply(T, points), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(placed, moved)
    np.testing.assert_allclose(heights, np.einsum("ij,ij->i", moved - feet, normals), rtol=0, atol=1e-14)


@pytest.mark.parametrize("chosen", [np.zeros(0, dtype=np.int64), np.array([3, 0, 36, 3])], ids=["all", "some"])
@pytest.mark.parametrize("told", [True, False])
def test_feet_slide_along_their_planes_as_far_as_the_points_went(chosen: np.ndarray, told: bool) -> None:
    points, T, before, feet, normals = drawn(1)
    count = len(chosen) or COUNT
    moved, slid, distances = np.zeros((count * told, 3)), np.zeros((count * told, 3)), np.zeros(count)
    slide_rows(0, count, points, T, before, feet, normals, chosen, moved, slid, distances)
    rows = chosen if len(chosen) else np.arange(COUNT)
    place = pose.apply(T, points[rows])
    way = place - before[rows]
    along = way - np.einsum("ij,ij->i", way, normals[rows])[:, None] * normals[rows]
    expected = feet[rows] + along
    np.testing.assert_allclose(distances, np.linalg.norm(place - expected, axis=1), rtol=1e-13)
    # A foot stays in its plane, and a point that has not moved leaves it where it was.
    np.testing.assert_allclose(np.einsum("ij,ij->i", along, normals[rows]), 0.0, atol=1e-13)
    if told:
        np.testing.assert_allclose(moved, place, rtol=0, atol=1e-14)
        np.testing.assert_allclose(slid, expected, rtol=0, atol=1e-14)
        slide_rows(0, count, points, T, pose.apply(T, points), feet, normals, chosen, moved, slid, distances)
        np.testing.assert_allclose(slid, feet[rows], rtol=0, atol=1e-14)


def test_rows_that_fail_cost_as_much_as_one_at_the_largest_distance() -> None:
    farthest, scale, odds = 2.0, 0.5, 0.3
    distances, normals = np.array([0.1, 3.0, 0.2, 0.4]), np.tile([0.0, 0.0, 1.0], (4, 1))
    own = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    weights, found = np.zeros(4), {}
    for signed in (0.0, 1.0):
        sums = np.zeros((1, SUMS))
        limits = np.array([farthest, 0.5, signed, scale, odds])
        weigh_rows(0, 4, distances, normals, own, np.eye(3), *(NOTHING,) * 3, limits, 4, weights, sums)
        found[signed] = weights.copy(), sums[0].copy()
    density = np.exp(-0.5 * (distances / scale) ** 2)
    beyond = np.log(np.exp(-0.5 * (farthest / scale) ** 2) + odds)
    # Too far; square to the plane; and where signs count, of its other side. Without a normal it passes.
    for signed, passes in ((0.0, [True, False, False, True]), (1.0, [False, False, False, True])):
        weights, (represented, energy, total, squares, used) = found[signed]
        expected = np.where(passes, density / (density + odds), 0.0)
        np.testing.assert_allclose(weights, expected, rtol=1e-13)
        assert energy == pytest.approx(np.where(passes, np.log(density + odds), beyond).sum(), rel=1e-12)
        assert (represented, used) == (4.0, float(np.count_nonzero(passes)))
        assert total == pytest.approx(expected.sum(), rel=1e-13)
        assert squares == pytest.approx(expected @ distances**2, rel=1e-13)
