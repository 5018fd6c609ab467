from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_normals import SmoothNormals, _clipped_barycentric, _unit
from dqreg.synth.parts import bracket, cylinder


def test_flat_faces_answer_with_their_own_normal_and_round_ones_as_interpolation_does() -> None:
    # The oracle interpolates on every face, flat or not.
    part = Mesh(*bracket(segments=16))
    places = sample_mesh(part, 3_000, np.random.default_rng(0)).points
    found = MeshSurface(part).closest(places)
    smooth = SmoothNormals(part)
    shares = _clipped_barycentric(found.points, part.corners[found.elements])
    expected = _unit(np.einsum("nk,nki->ni", shares, smooth._corner_normals[found.elements]))
    normals = smooth.at(found.points, found.elements)
    np.testing.assert_allclose(normals, expected, atol=1e-12)
    bent = np.linalg.norm(normals - part.face_normals[found.elements], axis=1) > 1e-6
    assert 0.01 < bent.mean() < 0.5


def test_a_turned_shaft_is_round_between_its_facets() -> None:
    shaft = Mesh(*cylinder(diameter=2.0, height=3.0, segments=48))
    places = sample_mesh(shaft, 2_000, np.random.default_rng(0)).points
    found = MeshSurface(shaft).closest(places)
    side = np.abs(shaft.face_normals[found.elements][:, 2]) < 0.5
    radial = found.points[side] * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    # Facets are off by up to 3.75 degrees, the interpolation by the third power of that.
    gaps = np.linalg.norm(SmoothNormals(shaft).at(found.points, found.elements)[side] - radial, axis=1)
    assert gaps.max() < np.deg2rad(3.75) / 20
