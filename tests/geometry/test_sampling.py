from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.sampling import places_on
from dqreg.synth.parts import box, bracket
from tests.geometry.oracles import brute_triangles


def test_samples_lie_on_the_surface_with_its_normals() -> None:
    mesh = Mesh(*bracket(segments=8), units="mm")
    cloud = sample_mesh(mesh, 500, np.random.default_rng(0))
    assert (len(cloud), cloud.units) == (500, "mm")
    assert cloud.normals is not None
    off = np.linalg.norm(brute_triangles(mesh.corners, cloud.points) - cloud.points, axis=1)
    assert off.max() < 1e-13 * mesh.diagonal
    # No sample comes so near to an edge that the face beyond it would be taken.
    np.testing.assert_allclose(MeshSurface(mesh).closest(cloud.points).normals, cloud.normals, atol=1e-12)


def test_each_face_gets_points_in_proportion_to_its_area() -> None:
    mesh, n = Mesh(*box((5.0, 2.0, 1.0))), 20_000
    cloud = sample_mesh(mesh, n, np.random.default_rng(1))
    elements = MeshSurface(mesh).closest(cloud.points).elements
    expected = n * mesh.face_areas / mesh.face_areas.sum()
    statistic = ((np.bincount(elements, minlength=12) - expected) ** 2 / expected).sum()
    assert statistic < chi2.isf(1e-6, df=11)


def test_points_are_uniform_within_a_triangle() -> None:
    n = 40_000
    points = sample_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), n, np.random.default_rng(2)).points
    # Sixteen triangles of equal area: quarters of both coordinates, squares cut by the diagonal.
    column, row = (4.0 * points[:, 0]).astype(int), (4.0 * points[:, 1]).astype(int)
    upper = (4.0 * points[:, :2] % 1.0).sum(axis=1) > 1.0
    cells = np.unique(np.column_stack([column, row, upper]), axis=0, return_counts=True)[1]
    assert len(cells) == 16
    assert ((cells - n / 16) ** 2 / (n / 16)).sum() < chi2.isf(1e-6, df=15)


def test_the_same_seed_draws_the_same_points() -> None:
    mesh = Mesh(*box())
    first, again, other = (sample_mesh(mesh, 100, np.random.default_rng(seed)).points for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.isin(other, first).any(axis=1).all()


@pytest.mark.parametrize(("scale", "origin"), [(1e-6, 0.0), (1.0, 5e6)])
def test_tiny_and_far_parts_are_sampled_on_their_faces(scale: float, origin: float) -> None:
    mesh = Mesh(box()[0] * scale + origin, box()[1])
    cloud = sample_mesh(mesh, 500, np.random.default_rng(0))
    rounding = 16.0 * np.finfo(float).eps * (abs(origin) + scale)
    assert MeshSurface(mesh).closest(cloud.points).distances.max() <= rounding


def test_faces_are_drawn_as_by_choice_with_their_areas() -> None:
    mesh = Mesh(*bracket())
    for seed in range(3):
        drawn = np.random.default_rng(seed).choice(len(mesh.faces), size=500, p=mesh.face_areas / mesh.face_areas.sum())
        np.testing.assert_array_equal(places_on(mesh, 500, np.random.default_rng(seed))[1], drawn)
