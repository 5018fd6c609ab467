from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.visibility import VisibleSurface, blocked, visible_faces
from dqreg.synth.parts import box, bracket

BOX = Mesh(*box((3.0, 2.0, 1.0)))


def test_of_a_convex_body_the_faces_that_look_at_the_eye_are_seen() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        eye = rng.normal(size=3)
        eye *= 12.0 / np.linalg.norm(eye)
        facing = np.einsum("ij,ij->i", eye - BOX.corners[:, 0], BOX.face_normals) / 12.0
        seen = visible_faces(BOX, eye[None])
        # Within the margin of two degrees either will do.
        sure = np.abs(facing) > 0.1
        np.testing.assert_array_equal(seen[sure], facing[sure] > 0.0)


@pytest.mark.parametrize("far", [3.0, 1e3, 1e7])
def test_what_lies_behind_a_wall_is_hidden_however_thin_the_wall_and_far_the_eye(far: float) -> None:
    inner = box((3.0 - 2e-3, 2.0 - 2e-3, 1.0 - 2e-3))
    shells = Mesh(
        np.concatenate([BOX.vertices, inner[0]]), np.concatenate([BOX.faces, inner[1][:, ::-1] + len(BOX.vertices)])
    )
    seen = visible_faces(shells, far * np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]]))
    assert seen[: len(BOX.faces)].all()
    assert not seen[len(BOX.faces) :].any()
    # From within, the inner shell alone.
    within = visible_faces(shells, np.zeros((1, 3)))
    assert not within[: len(BOX.faces)].any()
    assert within[len(BOX.faces) :].all()


def test_seen_faces_do_not_depend_on_unit_and_place() -> None:
    part = Mesh(*bracket())
    eye = np.array([[300.0, 200.0, 400.0]])
    expected = visible_faces(part, eye)
    assert 0.2 < expected.mean() < 0.9
    other = Mesh(1e-3 * part.vertices + [50.0, 0.0, 0.0], part.faces)
    assert (visible_faces(other, 1e-3 * eye + [50.0, 0.0, 0.0]) != expected).mean() < 0.005


def test_a_visible_surface_answers_like_a_mesh_of_those_faces_in_the_numbers_of_the_whole() -> None:
    part = Mesh(*bracket())
    seen = visible_faces(part, np.array([[300.0, 200.0, 400.0]]))
    surface, alone = VisibleSurface(part, seen), MeshSurface(Mesh(part.vertices, part.faces[seen]))
    points = np.random.default_rng(1).uniform(*part.bounds, size=(500, 3))
    found, expected = surface.closest(points), alone.closest(points)
    np.testing.assert_allclose(found.distances, expected.distances, atol=1e-9 * part.diagonal)
    assert seen[found.elements].all()
    np.testing.assert_array_equal(part.face_normals[found.elements], found.normals)
    assert surface.diagonal == part.diagonal


def test_a_line_of_sight_through_a_part_is_blocked() -> None:
    part = Mesh(*box((2.0, 2.0, 2.0)))
    points = part.centre + np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [3.0, 0.0, -1.0]])
    above, below = part.centre + np.array([0.0, 0.0, 9.0]), part.centre - np.array([0.0, 0.0, 9.0])
    assert blocked(part, points, above[None], 0.05).tolist() == [False, True, False]
    # What one of several eyes sees is seen.
    assert blocked(part, points, np.stack([above, below]), 0.05).tolist() == [False, False, False]
