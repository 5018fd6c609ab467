from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.synth.parts import box, bracket
from dqreg.synth.raycast import check_mesh, face_normals, first_hits


def brute_force(vertices, faces, origins, directions):
    """Nearest crossing over all triangles, by the determinant of each 3x3 system."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    best = np.full(len(origins), np.inf)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        M = np.stack([b - a, c - a, np.broadcast_to(-d, a.shape)], axis=2)
        regular = np.abs(np.linalg.det(M)) > 1e-12
        u, v, t = np.linalg.solve(M[regular], (o - a[regular])[..., None])[..., 0].T
        good = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        best[i] = t[good].min(initial=np.inf)
    return best


def random_rays(rng, count, vertices):
    centre, size = vertices.mean(axis=0), np.ptp(vertices, axis=0).max()
    origins = rng.standard_normal((count, 3))
    origins = centre + 2.0 * size * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    return origins, centre + 0.4 * size * rng.standard_normal((count, 3)) - origins


def test_agrees_with_brute_force():
    vertices, faces = bracket(segments=16)
    origins, directions = random_rays(np.random.default_rng(3), 300, vertices)
    index, points = first_hits(vertices, faces, origins, directions)
    expected = brute_force(vertices, faces, origins, directions)
    hit = np.isfinite(expected)
    assert 50 < hit.sum() < 300
    np.testing.assert_array_equal(index >= 0, hit)
    assert np.isnan(points[~hit]).all()
    np.testing.assert_allclose(points[hit], (origins + expected[:, None] * directions)[hit], atol=1e-9)


@settings(deadline=None, max_examples=25)
@given(
    scale=st.floats(-6, 6).map(lambda e: 10.0**e),
    shift=st.tuples(*[st.floats(-1e3, 1e3)] * 3),
)
def test_does_not_mind_units_and_place(scale, shift):
    vertices, faces = box(size=(3.0, 2.0, 1.0))
    origins, directions = random_rays(np.random.default_rng(0), 50, vertices)
    index, points = first_hits(vertices, faces, origins, directions)
    s = np.array(shift)
    moved_index, moved = first_hits(scale * (vertices + s), faces, scale * (origins + s), directions)
    np.testing.assert_array_equal(moved_index, index)
    # 1e-16 of the distance from the origin, some operations deep.
    np.testing.assert_allclose(moved / scale - s, points, atol=1e-14 * (10 + np.abs(s).max()))


def test_points_of_rays_along_edges_lie_on_the_mesh():
    # Rays aimed past edges by less than float32 can tell: some of them miss the face that the caster names.
    vertices, faces = bracket()
    rng = np.random.default_rng(1)
    triangles = vertices[faces[rng.choice(len(faces), 20_000)]]
    goals = triangles[:, 0] + rng.random((20_000, 1)) * (triangles[:, 1] - triangles[:, 0])
    goals += 1e-5 * rng.standard_normal((20_000, 3))
    origins = goals + 300.0 * rng.standard_normal((20_000, 3))
    index, points = first_hits(vertices, faces, origins, goals - origins)
    hit = index >= 0
    assert hit.sum() > 10_000
    on_face = trimesh.triangles.closest_point(vertices[faces[index[hit]]], points[hit])
    np.testing.assert_allclose(points[hit], on_face, atol=1e-12 * 156)


def test_face_normals_are_those_of_trimesh_and_nan_without_area():
    vertices, faces = bracket()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    np.testing.assert_allclose(face_normals(vertices, faces), mesh.face_normals, atol=1e-12)
    assert np.isnan(face_normals(vertices, np.array([[0, 0, 1]]))).all()


@pytest.mark.parametrize(
    ("vertices", "faces", "word"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "0 to 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]], "0 to 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 1.0, 2.0]], "whole numbers"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.zeros((0, 3), int), "at least one"),
        ([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]], "NaN"),
        ([[1, 1, 1], [1, 1, 1], [1, 1, 1]], [[0, 1, 2]], "no extent"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "vertices"),
    ],
)
def test_malformed_meshes_are_named(vertices, faces, word):
    with pytest.raises(InputError, match=word):
        check_mesh(vertices, faces)
