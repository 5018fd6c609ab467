from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import MeshSurface
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal


@pytest.mark.parametrize("step", [1e-9, 1e-5, 1e-2, 1.0])
def test_with_a_hint_the_same_places_are_found(step: float) -> None:
    # Asking about every point anew is the oracle, after steps of any size.
    surface = MeshSurface(PART)
    places = bracket_points(100, 0)
    before = surface.closest(places)
    moved = places + step * SIZE * np.random.default_rng(0).normal(size=places.shape)
    expected, found = surface.closest(moved), surface.closest(moved, (places, before))
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.elements, expected.elements)
    # Nor does it matter what is asked beside it.
    np.testing.assert_array_equal(surface.closest(moved[::-7]).elements, expected.elements[::-7])


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
