from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh, PointCloud, sample_mesh
from dqreg.geometry.neighbours import KdTree
from dqreg.rigid import twist
from dqreg.synth.parts import bracket
from tests.strategies import floats

PART = Mesh(*bracket(segments=8))
CLOUD = PointCloud(sample_mesh(PART, 4_000, np.random.default_rng(0)).points)


class Counted(KdTree):
    """A tree that counts what it is asked."""

    asked = 0

    def nearest(self, queries, count):
        self.asked += len(queries)
        return super().nearest(queries, count)


def turned(points: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
    """Points after a random motion of about that size."""
    T = twist.exp(np.r_[rng.normal(size=3) * step / PART.diagonal, rng.normal(size=3) * step])
    return points @ T[:3, :3].T + T[:3, 3]


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), floats(-6.0, 0.0), st.integers(1, 6))
def test_a_skipped_search_finds_exactly_what_a_full_search_finds(seed: int, size: float, steps: int) -> None:
    rng = np.random.default_rng(seed)
    surface = CloudSurface(CLOUD)
    places = CLOUD.points[::7] + rng.normal(size=(572, 3)) * 0.02 * PART.diagonal
    found = surface.closest(places)
    for _ in range(steps):
        moved = turned(places, 10.0**size * 0.1 * PART.diagonal, rng)
        found = surface.closest(moved, (places, found))
        full = surface.closest(moved)
        np.testing.assert_array_equal(found.elements, full.elements)
        np.testing.assert_array_equal(found.points, full.points)
        np.testing.assert_array_equal(found.normals, full.normals)
        np.testing.assert_allclose(found.distances, full.distances, rtol=1e-12, atol=1e-15 * PART.diagonal)
        # The bound stays below the truth however many steps are taken.
        assert (found.others <= full.others * (1.0 + 1e-12)).all()
        places = moved


def test_a_small_motion_is_hardly_searched_and_a_large_one_is() -> None:
    surface = CloudSurface(CLOUD)
    surface._search = tree = Counted(CLOUD.points[surface.order])
    places = CLOUD.points + 1e-3 * PART.diagonal
    found = surface.closest(places)
    _ = surface.normals
    for step, least, most in [(1e-5, 0, 100), (0.2, 3_000, 4_000)]:
        tree.asked = 0
        surface.closest(places + step * PART.diagonal, (places, found))
        assert least <= tree.asked <= most


def test_copies_ties_and_a_single_point_are_searched_as_before() -> None:
    # Equally far points leave no room to move, so the tree decides as it always does.
    grid = PointCloud(np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3).repeat(2, axis=0))
    surface = CloudSurface(grid)
    places = np.random.default_rng(0).integers(0, 7, size=(200, 3)) / 2.0
    for cloud in (surface, CloudSurface(PointCloud([[1.0, 2.0, 3.0]]))):
        found = cloud.closest(places)
        again = cloud.closest(places + 0.5, (places, found))
        np.testing.assert_array_equal(again.elements, cloud.closest(places + 0.5).elements)


def test_normals_fitted_where_they_are_asked_for_are_those_of_the_whole_cloud() -> None:
    whole, piecewise = CloudSurface(CLOUD), CloudSurface(CLOUD)
    expected = whole.normals
    for start in (5, 0, 3):
        queries = CLOUD.points[start::11]
        found = piecewise.closest(queries)
        np.testing.assert_array_equal(found.normals, whole.closest(queries).normals)
    np.testing.assert_array_equal(piecewise.normals, expected)


def test_fitted_normals_are_taken_over_and_others_refused() -> None:
    surface = CloudSurface(CLOUD)
    again = CloudSurface(CLOUD, surface.fitted)
    assert not again.oriented
    found, expected = (s.closest(CLOUD.points[:50]) for s in (again, surface))
    for field in dataclasses.fields(found):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name))
    with pytest.raises(InputError, match="one row per distinct point"):
        CloudSurface(CLOUD, surface.fitted[:-1])
