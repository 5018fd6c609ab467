from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import Mesh
from dqreg.geometry.mesh_surface import FaceSides


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
