"""Faces of a part: which shape a tessellated face is of."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh
from dqreg.inspection import part_faces


def tube(radii: list[float], heights: list[float], around: int, step: float) -> Mesh:
    """A closed body of revolution with corners rounded to a step as coarse files have them, caps at its ends."""
    turns = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    rims = [np.column_stack([r * ring, np.full(around, z)]) for r, z in zip(radii, heights, strict=True)]
    corners = np.vstack([*rims, [[0.0, 0.0, heights[0]]], [[0.0, 0.0, heights[-1]]]])
    corners = step * np.round(corners / step)
    here, ahead = np.arange(around), (np.arange(around) + 1) % around
    faces = []
    for k in range(len(radii) - 1):
        a, b = k * around, (k + 1) * around
        faces += [np.column_stack([a + here, a + ahead, b + ahead]), np.column_stack([a + here, b + ahead, b + here])]
    low, high, last = len(corners) - 2, len(corners) - 1, (len(radii) - 1) * around
    faces += [np.column_stack([np.full(around, low), ahead, here])]
    faces += [np.column_stack([np.full(around, high), last + here, last + ahead])]
    return Mesh(corners, np.vstack(faces))


@pytest.mark.parametrize("size", [1.0, 25.4])
def test_rounded_corners_of_a_coarse_file_still_are_a_cylinder(size: float) -> None:
    # Rounded to 0.003 the corners lie 0.0021 off at most; the middles of the chords lie 0.0047 off.
    part = tube([3.4, 3.4], [0.0, 9.0], 60, 0.003)
    (wall,) = (face for face in part_faces(Mesh(size * part.vertices, part.faces)) if face.kind != "plane")
    assert wall.kind == "cylinder"
    assert wall.feature is not None
    assert wall.feature.diameter == pytest.approx(6.8 * size, abs=0.002 * size)
    assert wall.feature.form > 1e-4 * wall.extent


def test_a_barrel_is_no_cylinder_and_a_funnel_is_a_cone() -> None:
    # It bulges by twice of what its sides cut their chords: 3.4 (1 - cos 3 degrees) = 0.0047.
    barrel = tube([3.4, 3.405, 3.41, 3.405, 3.4], [0.0, 2.0, 4.0, 6.0, 8.0], 60, 1e-6)
    assert [face.kind for face in part_faces(barrel) if face.kind != "plane"] == ["free"]
    funnel = tube([3.4, 4.4], [0.0, 3.0], 60, 0.003)
    assert [face.kind for face in part_faces(funnel) if face.kind != "plane"] == ["cone"]
