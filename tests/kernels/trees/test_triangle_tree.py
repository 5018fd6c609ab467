from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.kernels import threads
from dqreg.kernels.trees.treelets import BLOCK
from dqreg.kernels.trees.triangle_tree import MAX_SMALL_TRIANGLES, TriangleTree, order_of_triangles
from dqreg.synth.parts import bracket
from tests.geometry.oracles import brute_triangles

LEAF_TRIANGLES = 2  # At most


def tree_of(corners: FloatArray) -> TriangleTree:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return TriangleTree.of(corners, across / np.linalg.norm(across, axis=1, keepdims=True))


def triangles(rng: np.random.Generator, count: int, thin: float = 1.0) -> FloatArray:
    """Triangles of size one; the third corner lies at the share ``thin`` of its height above the first side."""
    corners = rng.normal(size=(count, 3, 3))
    along = corners[:, 0] + rng.uniform(size=(count, 1)) * (corners[:, 1] - corners[:, 0])
    corners[:, 2] = along + thin * corners[:, 2]
    return corners


def slimness(corners: FloatArray) -> FloatArray:
    """Longest side by the height above it, times the size of the scene."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return (longest + 10.0) * longest**2 / np.linalg.norm(across, axis=1)


def distances_of(corners: FloatArray, queries: FloatArray) -> FloatArray:
    return np.linalg.norm(queries - brute_triangles(corners, queries), axis=1)


@settings(deadline=None, max_examples=150)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.sampled_from([1.0, 1e-3, 1e-6]), st.sampled_from([0.01, 2.0]))
def test_no_triangle_is_nearer_with_any_first_guess(seed: int, count: int, thin: float, spread: float) -> None:
    # Brute force over all triangles is the oracle.
    rng = np.random.default_rng(seed)
    corners = triangles(rng, count, thin)
    queries = corners[rng.integers(count, size=30), rng.integers(3, size=30)] + spread * rng.normal(size=(30, 3))
    queries[:3] = corners[0]
    tree, expected = tree_of(corners), distances_of(corners, queries)
    # Products over a needle lose digits as its height falls; in its own plane it shows, in the distance hardly.
    rounding = 1e-14 * slimness(corners)
    for guesses in (None, rng.integers(count, size=30)):
        points, normals, distances, faces = tree.closest(queries, guesses)
        np.testing.assert_allclose(distances, expected, rtol=0, atol=rounding.max())
        np.testing.assert_allclose(np.linalg.norm(queries - points, axis=1), distances, rtol=0, atol=1e-13)
        assert np.array_equal(normals, tree.normals[faces])
        for face in np.unique(faces):
            on_face = distances_of(corners[face : face + 1], points[faces == face])
            assert (on_face <= 1e3 * rounding[face]).all()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("count", [1, 2, 3, 9, 300, BLOCK + 1, 3 * BLOCK + 7])
@pytest.mark.parametrize("alike", [False, True])
def test_every_node_is_the_box_of_its_triangles_and_each_is_in_one_leaf(seed: int, count: int, alike: bool) -> None:
    rng = np.random.default_rng(seed)
    corners = triangles(rng, count) + (0.0 if alike else 30.0 * rng.uniform(size=(count, 1, 3)))
    if alike:
        # One box for all: no neighbour is nearer than another.
        corners[:, 0], corners[:, 1] = -9.0, 9.0
    tree = tree_of(corners)
    low, high = corners[tree.faces].min(axis=1), corners[tree.faces].max(axis=1)
    depth, bottom, top = np.zeros(len(tree.nodes), int), np.zeros((len(tree.nodes), 3)), np.zeros((len(tree.nodes), 3))
    for node in range(len(tree.nodes) - 1, -1, -1):
        child, many, _ = tree.links[node]
        assert many or (child > node and child % 2 == 1 and (tree.links[child : child + 2, 2] == node).all())
        assert 0 <= many <= LEAF_TRIANGLES
        held = slice(child, child + (many or 2))
        bottom[node] = low[held].min(axis=0) if many else bottom[held].min(axis=0)
        top[node] = high[held].max(axis=0) if many else top[held].max(axis=0)
        depth[node] = 0 if many else 1 + depth[held].max()
        assert not many or (tree.leaves[held] == node).all()
    np.testing.assert_array_equal(tree.nodes, np.hstack([bottom, top]))
    np.testing.assert_array_equal(np.sort(tree.faces), np.arange(count))
    np.testing.assert_array_equal(tree.faces[tree.slots], np.arange(count))
    assert depth[0] < 2.0 * np.log2(count + 1) + 16


def test_halves_of_a_rectangle_are_no_copies_and_copies_among_them_are_found() -> None:
    # They have one box, and so have many that are not in one place in the order.
    square = np.array(
        [[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 0]]]
    )
    corners = np.concatenate([square, square[::-1, [1, 2, 0]], -square, 1.0 + square])
    rows, first = order_of_triangles(corners)
    np.testing.assert_array_equal(np.sort(rows), [0, 1, 2, 6, 7, 8, 9, 10, 11])
    np.testing.assert_array_equal(first, [0, 1, 2, 2, 1, 0, 6, 7, 8, 9, 10, 11])
    assert order_of_triangles(np.concatenate([square, -square]))[1] is None


@pytest.mark.parametrize("thin", [1.0, 1e-3])
def test_single_triangles_against_trimesh(thin: float) -> None:
    rng = np.random.default_rng(0)
    corners, queries = triangles(rng, 200, thin), 2.0 * rng.normal(size=(200, 3))
    expected = trimesh.triangles.closest_point(corners, queries)
    found = np.concatenate([tree_of(c[None]).closest(q[None])[0] for c, q in zip(corners, queries, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0))
def test_beyond_the_bound_there_is_nothing(seed: int, bound: float) -> None:
    rng = np.random.default_rng(seed)
    corners, queries = triangles(rng, 12), 2.0 * rng.normal(size=(30, 3))
    expected = distances_of(corners, queries)
    points, normals, distances, faces = tree_of(corners).closest(queries, bound=bound)
    near = expected < bound
    np.testing.assert_allclose(distances[near], expected[near], rtol=0, atol=1e-12)
    assert np.isinf(distances[~near]).all()
    assert (faces[~near] == -1).all()
    assert np.isnan(points[~near]).all()
    assert np.isnan(normals[~near]).all()


def test_copies_of_a_face_are_one_and_the_first_is_named() -> None:
    rng = np.random.default_rng(1)
    corners = np.tile(triangles(rng, 5), (40, 1, 1))
    # In any order of the corners, and with the other sign of zero, it is the same triangle.
    corners[3::5, 0, 0] = np.where(np.arange(40) % 2, 0.0, -0.0)
    corners[5::7] = corners[5::7, ::-1]
    tree = tree_of(corners)
    queries = rng.normal(size=(50, 3))
    *_, distances, faces = tree.closest(queries, rng.integers(200, size=50))
    assert len(tree.faces) == 5
    assert faces.max() < 5
    np.testing.assert_allclose(distances, distances_of(corners[:5], queries), rtol=0, atol=1e-13)


@pytest.mark.parametrize("count", [LEAF_TRIANGLES, LEAF_TRIANGLES + 1, 2 * LEAF_TRIANGLES, 65])
@pytest.mark.parametrize("place", ["one", "line", "grid"])
def test_centroids_in_one_place_in_line_or_in_a_grid(count: int, place: str) -> None:
    rng = np.random.default_rng(2)
    corners = triangles(rng, count)
    corners -= corners.mean(axis=1, keepdims=True)
    steps = np.arange(count)
    shifts = {"one": 0 * steps[:, None] * np.ones(3), "line": np.outer(steps, [1.0, 0, 0])}
    corners += shifts.get(place, np.column_stack([steps % 4, steps // 4 % 4, steps // 16]).astype(float))[:, None]
    queries = rng.normal(size=(60, 3)) * 4.0
    np.testing.assert_allclose(tree_of(corners).closest(queries)[2], distances_of(corners, queries), rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_the_bits_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    rng = np.random.default_rng(3)
    tree, queries = tree_of(triangles(rng, 300)), rng.normal(size=(9_000, 3))
    monkeypatch.setattr(threads, "thread_count", lambda: 1)
    alone = tree.closest(queries)
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    for found, expected in zip(tree.closest(queries), alone, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("count", [1, 3])
def test_a_tree_does_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    corners = triangles(np.random.default_rng(8), MAX_SMALL_TRIANGLES + 1)
    expected = tree_of(corners)
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    found = tree_of(corners)
    for name in ("nodes", "links", "packed", "faces", "slots", "leaves"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("bound", [np.inf, 0.02])
def test_many_queries_of_few_faces_are_answered_as_each_alone(bound: float) -> None:
    # Each of many looks around for those after it; one alone is searched for. Edges, plates and a fan are among them.
    rng = np.random.default_rng(6)
    mesh = Mesh(*bracket(segments=64))
    tree = tree_of(mesh.corners)
    rows, shares = np.sort(rng.integers(len(mesh.corners), size=4_000)), rng.dirichlet(np.ones(3), size=4_000)
    shares[::9, 0], shares[::27, 1] = 0.0, 0.0
    queries = np.einsum("nk,nkj->nj", shares, mesh.corners[rows]) + 1e-3 * mesh.diagonal * rng.normal(size=(4_000, 3))
    queries = np.concatenate([queries[np.lexsort((queries[:, 0] // 5.0, queries[:, 2] // 5.0))], queries[:9]])
    queries[100::500] = np.nan
    bound *= mesh.diagonal
    alone = zip(*(tree.closest(query[None], bound=bound) for query in queries), strict=True)
    for found, expected in zip(tree.closest(queries, bound=bound), alone, strict=True):
        np.testing.assert_array_equal(found, np.concatenate(expected))


def test_a_query_that_is_no_number_has_no_answer() -> None:
    tree = tree_of(triangles(np.random.default_rng(4), 9))
    points, _, distances, faces = tree.closest(np.array([[np.nan, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert faces.tolist()[0] == -1
    assert np.isnan(points[0]).all()
    assert np.isfinite(distances[1])


@pytest.mark.soak
def test_a_million_faces_against_those_near_by() -> None:
    rng = np.random.default_rng(5)
    side = np.linspace(0.0, 1.0, 708)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid, 0.1 * np.sin(7.0 * grid[:, 0])])
    rows = np.arange(708 * 708).reshape(708, 708)
    a, b, c, d = rows[:-1, :-1].ravel(), rows[1:, :-1].ravel(), rows[:-1, 1:].ravel(), rows[1:, 1:].ravel()
    corners = vertices[np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])]
    tree, queries = tree_of(corners), vertices[rng.integers(len(vertices), size=200)] + 0.01 * rng.normal(size=(200, 3))
    expected = [distances_of(near_by(corners, query), query[None])[0] for query in queries]
    np.testing.assert_allclose(tree.closest(queries)[2], expected, rtol=0, atol=1e-12)


def near_by(corners: FloatArray, query: FloatArray) -> FloatArray:
    """Triangles with a corner within 0.2 of a query that is nearer than 0.1 to the sheet."""
    return corners[(np.linalg.norm(corners[:, 0] - query, axis=1) < 0.2)]


def test_a_query_that_all_but_touches_the_face_of_its_guess_is_answered() -> None:
    # Corners, and places beside them by less than squares of differences keep digits of.
    vertices, faces = bracket()
    part = Mesh(vertices, faces)
    tree = TriangleTree.of(part.corners, part.face_normals)
    rng = np.random.default_rng(4)
    places = vertices[rng.integers(len(vertices), size=4_000)] + 4e-7 * rng.normal(size=(4_000, 3))
    without = tree.closest(places)
    found = tree.closest(places, without[3])
    assert np.isfinite(found[2]).all()
    np.testing.assert_allclose(found[2], without[2], atol=1e-13 * part.diagonal)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.sampled_from([0.05, 1.0, np.inf]))
def test_distances_under_many_poses_are_those_of_the_moved_points(seed: int, count: int, bound: float) -> None:
    rng = np.random.default_rng(seed)
    tree, points = tree_of(triangles(rng, count)), rng.normal(size=(17, 3))
    R, t = Rotation.random(5, random_state=rng).as_matrix(), rng.normal(size=(5, 3))
    found = tree.distances(R, t, points, bound)
    expected = tree.closest((points @ R.transpose(0, 2, 1) + t[:, None]).reshape(-1, 3), bound=bound)[2]
    np.testing.assert_allclose(found.reshape(-1), expected, rtol=0, atol=1e-13)
    by_point = tree.distances(R, t, points, bound, by_point=True)
    np.testing.assert_allclose(by_point.reshape(-1), expected, rtol=0, atol=1e-13)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(-0.9, 0.9), st.sampled_from([0.5, 3.0, np.inf]))
def test_the_closest_face_that_looks_to_a_direction_is_that_of_brute_force(
    seed: int, count: int, cosine: float, bound: float
) -> None:
    rng = np.random.default_rng(seed)
    corners, queries, directions = triangles(rng, count), 2.0 * rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tree = tree_of(corners)
    points, distances, faces = tree.closest_facing(queries, directions, cosine, bound)
    for query, direction, point, distance, face in zip(queries, directions, points, distances, faces, strict=True):
        looking = np.flatnonzero(tree.normals @ direction > cosine)
        away = distances_of(corners[looking], query[None])[0] if len(looking) else np.inf
        if away >= bound:
            assert face == -1
            assert distance == np.inf
            continue
        assert face in looking
        assert distance == pytest.approx(away, abs=1e-9)
        assert np.linalg.norm(point - query) == pytest.approx(away, abs=1e-9)
