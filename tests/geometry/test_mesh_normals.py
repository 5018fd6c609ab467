from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_normals import PseudoNormals, _unit, smooth_normals_of
from dqreg.synth.parts import box, bracket, cylinder


def barycentric(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = places - corners[:, 0]
    aa, ab, bb = (np.einsum("ni,ni->n", x, y) for x, y in ((a, a), (a, b), (b, b)))
    ao, bo = (np.einsum("ni,ni->n", x, offset) for x in (a, b))
    area = aa * bb - ab**2
    second, third = (bb * ao - ab * bo) / area, (aa * bo - ab * ao) / area
    # Rounding may leave the triangle.
    return np.clip(np.column_stack([1.0 - second - third, second, third]), 0.0, 1.0)


def test_flat_faces_answer_with_their_own_normal_and_round_ones_as_interpolation_does() -> None:
    # The oracle interpolates on every face, flat or not.
    part = Mesh(*bracket(segments=16))
    places = sample_mesh(part, 3_000, np.random.default_rng(0)).points
    found = MeshSurface(part).closest(places)
    fans = part._fans.find(np.arange(len(part.faces)))
    own = np.where(fans.is_round[:, None, None], fans.corner_normals, part.face_normals[:, None])
    shares = barycentric(found.points, part.corners[found.elements])
    expected = _unit(np.einsum("nk,nki->ni", shares, own[found.elements]))
    normals = smooth_normals_of(part, found.points, found.elements, found.normals)
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
    normals = smooth_normals_of(shaft, found.points, found.elements, found.normals)
    gaps = np.linalg.norm(normals[side] - radial, axis=1)
    assert gaps.max() < np.deg2rad(3.75) / 20


FloatArray = NDArray[np.float64]


def notched() -> Mesh:
    """An L of two boxes' outline, extruded: one concave edge, acute corners at a wedge."""
    outline = np.array([[0.0, 0], [4, 0], [4, 1], [1, 1.3], [0.4, 4], [0, 4]])
    count = len(outline)
    vertices = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (0.0, 0.7)])
    caps = [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 5, 4]]
    faces = caps + [[a + count, c + count, b + count] for a, b, c in caps]
    for k in range(count):
        j = (k + 1) % count
        faces += [[k, j, j + count], [k, j + count, k + count]]
    return Mesh(vertices, np.array(faces))


def spike() -> Mesh:
    """A needle of a tetrahedron: every dihedral angle at its base is acute."""
    return Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -3]], [[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]])


def part() -> Mesh:
    mesh = Mesh(*bracket())
    return Mesh(mesh.vertices - mesh.centre, mesh.faces)


def star() -> Mesh:
    """An icosahedron with every other vertex pushed in: saddles and acute corners everywhere."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    scale = np.random.default_rng(4).uniform(0.35, 1.0, size=len(ball.vertices))
    return Mesh(ball.vertices * scale[:, None], np.array(ball.faces))


def winding(mesh: Mesh, queries: FloatArray) -> FloatArray:
    """Winding number, Van Oosterom and Strackee's solid angles over all faces: 1 inside, 0 outside."""
    a, b, c = (mesh.corners[None, :, k] - queries[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    top = np.einsum("qfi,qfi->qf", a, np.cross(b, c))
    dots = [np.einsum("qfi,qfi->qf", x, y) for x, y in ((a, b), (b, c), (c, a))]
    return np.arctan2(top, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum(axis=1) / (2.0 * np.pi)


def sides(mesh: Mesh, queries: FloatArray) -> FloatArray:
    found = MeshSurface(mesh).closest(queries)
    return PseudoNormals.of(mesh).signed(queries, found)


def near_features(mesh: Mesh, reach: float, count: int = 200) -> FloatArray:
    """Points near vertices and near the middle of sides, where the normal of one face is often wrong."""
    rng = np.random.default_rng(1)
    faces, share = rng.integers(len(mesh.faces), size=2 * count), rng.uniform(size=(2 * count, 1))
    share[:count] = 0.0
    places = share * mesh.corners[faces, 0] + (1.0 - share) * mesh.corners[faces, 1]
    away = rng.normal(size=(2 * count, 3))
    return places + reach * mesh.diagonal * rng.uniform(0.05, 1.0, (2 * count, 1)) * away / np.linalg.norm(
        away, axis=1, keepdims=True
    )


@pytest.mark.parametrize("reach", [0.2, 0.01, 1e-4])
@pytest.mark.parametrize("make", [notched, spike, part, star])
def test_the_side_is_that_of_the_winding_number(make, reach: float) -> None:
    mesh = make()
    queries = near_features(mesh, reach)
    inside = winding(mesh, queries) > 0.5
    assert 0.005 < inside.mean() < 0.95
    np.testing.assert_array_equal(sides(mesh, queries) < 0.0, inside)


@pytest.mark.parametrize("make", [notched, spike, part, star])
def test_of_faces_equally_near_the_one_below_the_highest_height_has_the_side(make) -> None:
    # Any other choice would be wrong beside acute edges: CloudCompare's issue of wrong signs beside the edges of a box.
    mesh = make()
    queries = near_features(mesh, 0.2)
    found = MeshSurface(mesh).closest(queries)
    plain = np.einsum("ni,ni->n", queries - found.points, found.normals)
    np.testing.assert_array_equal(plain < 0.0, winding(mesh, queries) > 0.5)


def test_trimesh_agrees_on_the_bracket() -> None:
    import trimesh

    mesh = part()
    queries = near_features(mesh, 0.05, 150)
    inside = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).contains(queries)
    np.testing.assert_array_equal(sides(mesh, queries) < 0.0, inside)


def test_vertices_that_are_not_shared_make_no_difference() -> None:
    mesh = part()
    soup = Mesh(mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))
    queries = near_features(mesh, 0.05)
    assert soup.is_closed
    np.testing.assert_array_equal(np.sign(sides(soup, queries)), np.sign(sides(mesh, queries)))


def test_a_seam_of_faces_without_area_hands_the_normal_on() -> None:
    # Side 1-3 of face (1, 3, 2) is met by two sides with a vertex between them; (1, 4, 3), (1, 5, 4) are the seam.
    whole = spike()
    middle, quarter = 0.5 * (whole.vertices[1] + whole.vertices[3]), 0.75 * whole.vertices[1] + 0.25 * whole.vertices[3]
    faces = [[0, 1, 2], [2, 1, 3], [0, 2, 3], [0, 5, 1], [0, 4, 5], [0, 3, 4], [1, 4, 3], [1, 5, 4]]
    mesh = Mesh(np.vstack([whole.vertices, middle, quarter]), faces)
    assert (mesh.dropped, len(mesh.faces)) == (2, 6)
    moved = dataclasses.replace(mesh, vertices=mesh.vertices - 0.0)
    assert moved.is_closed
    assert moved.is_consistently_wound
    rng = np.random.default_rng(3)
    share = rng.uniform(size=(2000, 1))
    queries = share * whole.vertices[1] + (1 - share) * whole.vertices[3] + rng.normal(scale=0.05, size=(2000, 3))
    np.testing.assert_array_equal(sides(moved, queries) < 0.0, winding(whole, queries) > 0.5)


def test_a_point_on_the_surface_is_on_no_wrong_side_by_more_than_rounding() -> None:
    mesh = Mesh(*box((3.0, 2.0, 1.0)))
    queries = np.vstack([mesh.vertices, mesh.corners.mean(axis=1)])
    np.testing.assert_allclose(sides(mesh, queries), 0.0, atol=1e-15)
