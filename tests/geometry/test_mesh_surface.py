from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.geometry import Closest, Mesh, MeshSurface
from dqreg.geometry.mesh_surface import FaceSides
from dqreg.geometry.surface import Hint
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal


class Counting(MeshSurface):
    """A surface that counts what it is asked."""

    asked = 0

    def closest(self, points: FloatArray, hint: Hint | None = None) -> Closest:
        self.asked += len(points) if hint is None else 0
        return super().closest(points, hint)


@pytest.mark.parametrize("step", [1e-9, 1e-7, 1e-5, 9e-5])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_small_step_finds_the_same_places(step: float, seed: int) -> None:
    # Asking about every point anew is the oracle. The part has no sheet thinner than the step.
    surface = Counting(PART)
    places = bracket_points(100, seed)
    before = surface.closest(places)
    rng = np.random.default_rng(seed)
    shift = rng.normal(size=places.shape)
    moved = places + step * SIZE * shift / np.linalg.norm(shift, axis=1, keepdims=True)
    expected = surface.closest(moved)
    surface.asked = 0
    found = surface.closest(moved, (places, before))
    # Most keep their face without a question.
    assert surface.asked <= 0.5 * len(places)
    np.testing.assert_allclose(found.distances, expected.distances, atol=1e-12 * SIZE)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9 * SIZE)
    same_place = np.linalg.norm(found.normals - expected.normals, axis=1) <= 1e-9
    # On an edge either face is right.
    assert same_place.mean() >= 0.999


def test_after_a_large_step_the_answer_is_that_without_a_hint() -> None:
    surface = MeshSurface(PART)
    places = bracket_points(60, seed=0)
    before = surface.closest(places)
    moved = places + 2e-4 * SIZE
    found = surface.closest(moved, (places, before))
    np.testing.assert_array_equal(found.points, surface.closest(moved).points)


def test_what_was_answered_before_stays_as_it_was() -> None:
    surface = MeshSurface(PART)
    places = bracket_points(60, seed=0)
    before = surface.closest(places)
    copies = [x.copy() for x in (before.points, before.normals, before.distances, before.elements)]
    surface.closest(places + 1e-5 * SIZE, (places, before))
    for was, copy in zip((before.points, before.normals, before.distances, before.elements), copies, strict=True):
        np.testing.assert_array_equal(was, copy)


def test_nothing_is_nothing() -> None:
    surface = MeshSurface(PART)
    none = surface.closest(np.zeros((0, 3)))
    assert len(surface.closest(np.zeros((0, 3)), (np.zeros((0, 3)), none)).points) == 0


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3))
def test_the_inset_is_the_distance_from_the_nearest_side_s_line(seed: int, size: float) -> None:
    # The oracle is the height of the small triangle over each side: twice its area by the side's length.
    rng = np.random.default_rng(seed)
    mesh = Mesh(size * rng.normal(size=(12, 3)), np.arange(12).reshape(4, 3))
    shares = rng.dirichlet(np.ones(3), size=4)
    inside = np.einsum("nk,nki->ni", shares, mesh.corners)
    heights = []
    for k in range(3):
        a, b = mesh.corners[:, k], mesh.corners[:, (k + 1) % 3]
        doubled = np.linalg.norm(np.cross(b - a, inside - a), axis=1)
        heights.append(doubled / np.linalg.norm(b - a, axis=1))
    sides = FaceSides.of(mesh.corners, mesh.face_normals)
    # Height above the face does not count.
    above = inside + rng.normal(size=(4, 1)) * size * mesh.face_normals
    np.testing.assert_allclose(sides.inset(above), np.min(heights, axis=0), atol=1e-12 * size, rtol=1e-9)


def test_outside_is_negative() -> None:
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 2], [0, 1, 2]])
    beside = np.array([[0.5, -0.25, 3.0], [-1.0, 0.5, 0.0], [1.0, 1.0, -2.0]])
    found = FaceSides.of(mesh.corners, mesh.face_normals).inset(beside)
    np.testing.assert_allclose(found, [-0.25, -1.0, -np.sqrt(0.5)], atol=1e-15)
