from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.kernels import face_cells
from dqreg.kernels.triangle_tree import TriangleTree
from dqreg.synth.parts import bracket
from tests.geometry.oracles import brute_triangles
from tests.kernels.test_triangle_tree import tree_of, triangles

# Rounds after which every cell that serves is made.
ROUNDS = 3


@pytest.fixture(scope="module")
def part() -> Mesh:
    vertices, faces = bracket()
    # A second sheet on the first, cut otherwise: places above it have two faces equally near.
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    sheet = np.array([[low[0], low[1], high[2]], [high[0], low[1], high[2]], [high[0], high[1], high[2]]])
    return Mesh(np.vstack([vertices, sheet]), np.vstack([faces, len(vertices) + np.arange(3)[None]]))


def places_near(part: Mesh, count: int, apart: float, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.ones(3), size=count)
    on = np.einsum("ij,ijk->ik", shares, part.corners[rng.integers(len(part.faces), size=count)])
    return on + apart * part.diagonal * rng.normal(size=(count, 3))


def taught(tree: TriangleTree, queries: FloatArray, monkeypatch: pytest.MonkeyPatch) -> TriangleTree:
    monkeypatch.setattr(face_cells, "PATIENCE", 0)
    monkeypatch.setattr(face_cells, "FACES", 1)
    for _ in range(ROUNDS):
        tree.closest(queries)
    return tree


@pytest.mark.parametrize("apart", [0.0, 1e-3, 3e-2])
def test_cells_change_no_bit(part: Mesh, monkeypatch: pytest.MonkeyPatch, apart: float) -> None:
    queries = places_near(part, 3_000, apart, seed=1)
    tree = TriangleTree.of(part.corners, part.face_normals)
    for bound in (np.inf, 0.01 * part.diagonal):
        expected = tree.closest(queries, bound=bound)
        monkeypatch.undo()
        for found, of_tree in zip(
            taught(tree, queries, monkeypatch).closest(queries, bound=bound), expected, strict=True
        ):
            np.testing.assert_array_equal(found, of_tree)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1.0, 1e-3]))
def test_no_triangle_is_nearer_than_those_of_the_cells(seed: int, count: int, thin: float) -> None:
    # Brute force over all triangles is the oracle.
    rng = np.random.default_rng(seed)
    corners = triangles(rng, count, thin)
    queries = corners[rng.integers(count, size=40), rng.integers(3, size=40)] + 0.05 * rng.normal(size=(40, 3))
    with pytest.MonkeyPatch.context() as patch:
        distances = taught(tree_of(corners), queries, patch).closest(queries)[2]
    expected = np.linalg.norm(queries - brute_triangles(corners, queries), axis=1)
    np.testing.assert_allclose(distances, expected, rtol=0, atol=1e-9 if thin < 1.0 else 1e-11)


def test_the_lists_begin_with_the_nearest_face_and_bound_the_distance_of_each(
    part: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    queries = places_near(part, 500, 1e-3, seed=2)
    made = taught(TriangleTree.of(part.corners, part.face_normals), queries, monkeypatch).cells.made
    heads, used = made.heads, int(made.shape[3])
    sizes = np.diff(heads[: used + 1])
    assert 1 <= sizes.min() <= sizes.max() <= face_cells.MOST
    for first, last in itertools.pairwise(heads[: used + 1]):
        assert (np.diff(made.floors[first:last]) >= 0.0).all()


def test_cells_are_made_once_they_pay(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, queries = TriangleTree.of(part.corners, part.face_normals), places_near(part, 100, 1e-3, seed=3)
    monkeypatch.setattr(face_cells, "PATIENCE", 250)
    for expected in (False, False, True, True):
        tree.closest(np.repeat(queries, 1, axis=0))
        assert bool(tree.cells.made.shape[3]) is expected or not expected
    assert tree.cells.made.shape[3]


def test_threads_that_ask_while_cells_are_made_get_the_same(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = TriangleTree.of(part.corners, part.face_normals)
    sets = [places_near(part, 600, 2e-3, seed) for seed in range(8)]
    expected = [tree.closest(queries) for queries in sets]
    monkeypatch.setattr(face_cells, "PATIENCE", 0)
    monkeypatch.setattr(face_cells, "TOGETHER", 16)
    with ThreadPoolExecutor(4) as pool:
        for _ in range(ROUNDS):
            for answer, known in zip(pool.map(tree.closest, sets), expected, strict=True):
                for found, column in zip(answer, known, strict=True):
                    np.testing.assert_array_equal(found, column)


def test_places_outside_and_those_that_are_no_numbers_are_left_to_the_tree(
    part: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    queries = places_near(part, 200, 1e-3, seed=4)
    tree = taught(TriangleTree.of(part.corners, part.face_normals), queries, monkeypatch)
    far = np.array([[1e9, 0.0, 0.0], [-1e300, 1e300, 0.0], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]])
    faces = tree.closest(far)[3]
    assert faces[0] >= 0
    assert faces[2] == -1


def test_a_part_of_very_many_faces_has_no_cells(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, queries = TriangleTree.of(part.corners, part.face_normals), places_near(part, 200, 1e-3, seed=5)
    monkeypatch.setattr(face_cells, "MANY", len(tree.faces) - 1)
    assert taught(tree, queries, monkeypatch).cells.made.shape[3] == 0


def test_a_large_call_makes_no_cells_and_reads_those_there_are(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, queries = TriangleTree.of(part.corners, part.face_normals), places_near(part, 300, 1e-3, seed=6)
    expected = tree.closest(queries)
    monkeypatch.setattr(face_cells, "LARGE", 100)
    assert taught(tree, queries, monkeypatch).cells.made.shape[3] == 0
    taught(tree, queries[:100], monkeypatch)
    made = tree.cells.made.shape[3]
    for found, column in zip(tree.closest(queries), expected, strict=True):
        np.testing.assert_array_equal(found, column)
    assert tree.cells.made.shape[3] == made > 0


def test_cells_that_serve_nobody_are_few(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = TriangleTree.of(part.corners, part.face_normals)
    monkeypatch.setattr(face_cells, "ALLOWED", 10)
    monkeypatch.setattr(face_cells, "PAID", 10**9)
    assert 0 < taught(tree, places_near(part, 500, 1e-3, seed=7), monkeypatch).cells.made.shape[3] <= 10
