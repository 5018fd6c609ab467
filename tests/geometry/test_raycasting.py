from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry.raycasting import RayScene
from dqreg.synth.parts import box


@pytest.mark.parametrize(("size", "away"), [(1.0, 0.0), (1e-3, 1e4), (1e6, -1e8)])
def test_a_ray_meets_the_face_before_it_whatever_the_size_and_the_place(size: float, away: float) -> None:
    # A cube: of the ways along the axes, the one towards the middle meets the side it comes from.
    vertices, faces = box((size, size, size))
    centre = vertices.mean(axis=0) + away
    scene = RayScene(vertices + away, faces, centre, size)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    met, distances = scene.first_faces(np.column_stack([-2.0 * ways + [0.01, 0.02, 0.03], ways]))
    np.testing.assert_allclose(distances, 1.5 - ways @ [0.01, 0.02, 0.03], atol=1e-5)
    toward = np.einsum("ij,ij->i", normals[met] / np.linalg.norm(normals[met], axis=1, keepdims=True), ways)
    np.testing.assert_allclose(toward, -1.0, atol=1e-6)


def test_what_meets_nothing_is_said() -> None:
    scene = RayScene(*box((1.0, 1.0, 1.0)), np.zeros(3), 1.0)
    faces, distances = scene.first_faces(np.array([[[0.0, 0, 2, 0, 0, 1], [0, 0, 2, 0, 0, -1]]]))
    assert faces.shape == distances.shape == (1, 2)
    assert (faces[0, 0], distances[0, 0]) == (-1, np.inf)
    assert faces[0, 1] >= 0


def test_a_vertex_that_no_face_uses_may_be_beyond_float32() -> None:
    vertices, faces = box((1.0, 1.0, 1.0))
    scene = RayScene(np.concatenate([vertices, [[1e300, 0.0, 0.0]]]), faces, np.zeros(3), 1.0)
    found, _ = scene.first_faces(np.array([[0.1, 0.2, 3.0, 0.0, 0.0, -1.0]]))
    assert (vertices[faces[found[0]]][:, 2] == 0.5).all()
