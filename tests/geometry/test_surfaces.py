from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud, sample_mesh
from dqreg.geometry.neighbours import KdTree, NeighbourTree
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from tests.geometry.oracles import FloatArray, brute_points, brute_triangles

BRACKET = Mesh(*bracket(segments=8))


@dataclasses.dataclass(frozen=True)
class Case:
    """A surface, where its points are, and what is closest by brute force."""

    surface: Any
    vertices: FloatArray
    faces: FloatArray | None

    def oracle(self, queries: FloatArray) -> FloatArray:
        if self.faces is None:
            return brute_points(self.vertices, queries)
        return brute_triangles(self.vertices[self.faces], queries)

    @property
    def size(self) -> float:
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))


def make(kind: str, T: FloatArray, size: float, origin: float) -> Case:
    """A cloud or a mesh of the bracket, turned, brought to a size (diagonal), then shifted along all axes."""
    vertices = pose.apply(T, BRACKET.vertices) * (size / BRACKET.diagonal) + origin
    if kind == "mesh":
        return Case(MeshSurface(Mesh(vertices, BRACKET.faces)), vertices, BRACKET.faces)
    cloud = PointCloud(np.concatenate([vertices, vertices[:5]]))
    return Case(CloudSurface(cloud), cloud.points, None)


TURN = pose.random(np.random.default_rng(7))
PLACES = {
    "plain": (np.eye(4), 1.0, 0.0),
    "turned": (TURN, 140.0, 30.0),
    "far origin": (TURN, 140.0, 5e6),
    "tiny": (TURN, 1e-6, 0.0),
    "huge": (TURN, 1e6, -1e5),
}
KINDS = ["cloud", "mesh"]


@pytest.fixture(params=[(kind, place) for kind in KINDS for place in PLACES], ids="-".join)
def case(request: pytest.FixtureRequest) -> Case:
    kind, place = request.param
    return make(kind, *PLACES[place])


def queries_of(case: Case, where: str, rng: np.random.Generator) -> FloatArray:
    """Sixty queries of one sort."""
    corners = case.vertices[rng.integers(len(case.vertices), size=(60, 2))]
    low, high = case.vertices.min(axis=0), case.vertices.max(axis=0)
    direction = rng.normal(size=(60, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return {
        "inside the box": rng.uniform(low, high, size=(60, 3)),
        "near": corners[:, 0] + 1e-3 * case.size * direction,
        "beside": 0.5 * (low + high) + 2.0 * case.size * direction,
        "far": 0.5 * (low + high) + 1e3 * case.size * direction,
        "on vertices": corners[:, 0],
        "between vertices": corners.mean(axis=1),
    }[where]


SORTS = ["inside the box", "near", "beside", "far", "on vertices", "between vertices"]


@pytest.mark.parametrize("where", SORTS)
def test_no_place_is_closer_and_the_answer_lies_on_the_surface(case: Case, where: str) -> None:
    queries = queries_of(case, where, np.random.default_rng(SORTS.index(where)))
    found = case.surface.closest(queries)
    expected = np.linalg.norm(queries - case.oracle(queries), axis=1)
    # Coordinates of this magnitude end here in float64; the factor covers the few sums and the flattest triangles.
    rounding = 128.0 * np.finfo(float).eps * np.abs(np.concatenate([queries, case.vertices])).max()
    excess = found.distances - expected
    assert excess.min() >= -rounding
    assert excess.max() <= rounding
    off = np.linalg.norm(found.points - case.oracle(found.points), axis=1)
    assert off.max() <= rounding
    if case.faces is None:
        assert np.abs(case.surface._distances(queries) - found.distances).max() <= rounding


def test_shapes_types_unit_normals_and_distances_that_belong_to_the_points(case: Case) -> None:
    queries = queries_of(case, "inside the box", np.random.default_rng(3))
    found = case.surface.closest(queries)
    assert found.points.shape == found.normals.shape == (60, 3)
    assert found.distances.shape == found.elements.shape == (60,)
    assert (found.points.dtype, found.normals.dtype, found.distances.dtype) == (np.float64,) * 3
    assert found.elements.dtype == np.int64
    rounding = 8.0 * np.finfo(float).eps * np.abs(case.vertices).max()
    np.testing.assert_allclose(found.distances, np.linalg.norm(queries - found.points, axis=1), rtol=0, atol=rounding)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-12)
    if case.faces is None:
        np.testing.assert_array_equal(case.vertices[found.elements], found.points)
    else:
        corners = case.vertices[case.faces[found.elements]]
        reach = np.abs(np.einsum("nki,ni->nk", corners - found.points[:, None], found.normals))
        assert reach.max() <= 4.0 * rounding


def test_no_queries_give_no_answers(case: Case) -> None:
    found = case.surface.closest(np.zeros((0, 3)))
    assert found.points.shape == found.normals.shape == (0, 3)
    assert found.distances.shape == found.elements.shape == (0,)
    assert found.elements.dtype == np.int64


def test_the_box_that_a_surface_reports(case: Case) -> None:
    low, high = case.vertices.min(axis=0), case.vertices.max(axis=0)
    np.testing.assert_allclose(case.surface.centre, 0.5 * (low + high), rtol=1e-15, atol=1e-15 * case.size)
    assert case.surface.diagonal == pytest.approx(case.size, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_two_threads_get_the_answer_of_one(kind: str) -> None:
    queries = np.random.default_rng(0).normal(size=(2_000, 3))
    alone = make(kind, np.eye(4), 1.0, 0.0).surface.closest(queries)
    shared = make(kind, np.eye(4), 1.0, 0.0).surface
    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(shared.closest, [queries] * 6))
    for answer in answers:
        for field in dataclasses.fields(answer):
            np.testing.assert_array_equal(getattr(answer, field.name), getattr(alone, field.name))


def test_given_normals_come_back_with_their_points_and_estimated_ones_are_not_called_oriented() -> None:
    cloud = sample_mesh(BRACKET, 500, np.random.default_rng(0))
    surface = CloudSurface(cloud)
    found = surface.closest(cloud.points)
    np.testing.assert_array_equal(found.points, cloud.points)
    np.testing.assert_array_equal(found.normals, cloud.normals)
    np.testing.assert_array_equal(found.elements, np.arange(500))
    assert surface.oriented
    assert MeshSurface(BRACKET).oriented
    assert not CloudSurface(PointCloud(cloud.points)).oriented


def test_points_on_a_line_have_no_normal_but_a_place() -> None:
    line = np.outer(np.arange(30.0), [1.0, 2.0, -1.0])
    found = CloudSurface(PointCloud(line)).closest(line + 0.1)
    assert not found.normals.any()
    np.testing.assert_array_equal(found.points, line)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_cloud_of_few_points_answers(count: int) -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])[:count]
    found = CloudSurface(PointCloud(points)).closest(np.array([[0.1, 0.0, 1.0]]))
    np.testing.assert_array_equal(found.points, [[0.0, 0, 0]])
    assert not found.normals.any()


@pytest.mark.parametrize("thinness", [1e-2, 1e-4, 1e-6])
def test_a_fan_of_needles(thinness: float) -> None:
    angles = thinness * np.arange(21)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(21)])
    vertices = np.vstack([np.zeros(3), rim])
    mesh = Mesh(vertices, [[0, k, k + 1] for k in range(1, 21)])
    queries = np.random.default_rng(0).uniform([-0.2, -thinness, -0.5], [1.2, 22 * thinness, 0.5], size=(300, 3))
    found = MeshSurface(mesh).closest(queries)
    expected = np.linalg.norm(queries - brute_triangles(mesh.corners, queries), axis=1)
    np.testing.assert_allclose(found.distances, expected, rtol=0, atol=1e-15 / thinness)


def test_points_on_long_facets_are_found_on_them() -> None:
    # Facets a sixtieth as wide as long: float32 names the other half of the facet for some points beside the diagonal,
    # up to 2e-5 of the size away.
    part = Mesh(*bracket())
    on = sample_mesh(part, 50_000, np.random.default_rng(0)).points
    off = MeshSurface(part).closest(on).distances / part.diagonal
    assert off.max() < 1e-14


@pytest.mark.parametrize("tree", [KdTree, NeighbourTree])
@pytest.mark.parametrize("origin", [0.0, 5e6])
@pytest.mark.parametrize("count", [1, 16])
def test_neighbours_are_those_of_scipy(tree: type[KdTree | NeighbourTree], origin: float, count: int) -> None:
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(500, 3)) + origin, 2.0 * rng.normal(size=(400, 3)) + origin
    indices, distances = tree(points).nearest(queries, count)
    middle = points.mean(axis=0)
    expected, rows = cKDTree(points - middle).query(queries - middle, k=count)
    np.testing.assert_array_equal(indices, rows.reshape(400, count))
    np.testing.assert_allclose(distances, expected.reshape(400, count), rtol=1e-12, atol=1e-8 if origin else 1e-14)
    assert indices.dtype == np.int64


@pytest.mark.parametrize("kind", [KdTree, NeighbourTree])
def test_fewer_points_than_neighbours_give_all_points(kind: type[KdTree | NeighbourTree]) -> None:
    tree = kind(np.array([[0.0, 0, 0], [3, 0, 0]]))
    indices, distances = tree.nearest(np.array([[1.0, 0, 0]]), 16)
    assert (indices.tolist(), distances.tolist()) == ([[0, 1]], [[1.0, 2.0]])
    assert tree.nearest(np.zeros((0, 3)), 16)[0].shape == (0, 2)
