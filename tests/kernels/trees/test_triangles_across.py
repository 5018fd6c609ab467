"""What lies across the sides of triangles, beside the topology of the mesh; and walks, beside all triangles."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.kernels.trees import triangle_tree, triangles_across
from dqreg.kernels.trees.triangle import closest_on, height_square
from dqreg.kernels.trees.triangle_tree import TriangleTree
from dqreg.kernels.trees.triangles_across import STEPS_PER_ROUND, walk_across
from dqreg.synth.parts import bracket


@pytest.fixture(scope="module")
def part() -> Mesh:
    return Mesh(*bracket(segments=32))


def test_across_each_side_lies_the_face_that_the_topology_names(part: Mesh) -> None:
    tree = MeshSurface(part)._tree
    # Each face is one slot of a part without copies.
    across = np.zeros((len(part.faces), 3), dtype=np.int64)
    across[tree.faces] = tree.faces[tree.across]
    assert (tree.across >= 0).all()
    np.testing.assert_array_equal(across, part.face_neighbours)


def test_minus_zero_is_the_same_place_and_rims_have_nothing_across() -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, -0.0], [1, 1, 0], [-0.0, 1, 0]]])
    tree = TriangleTree.of(corners, np.tile([0.0, 0, 1], (2, 1)))
    across = np.zeros((2, 3), dtype=np.int64)
    across[tree.faces] = np.where(tree.across < 0, -1, tree.faces[tree.across])
    np.testing.assert_array_equal(across, [[-1, 1, -1], [-1, -1, 0]])


def test_a_walk_ends_no_farther_and_mostly_where_nothing_is_nearer(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    # In Python, which calls no kernel that kernels alone call.
    monkeypatch.setattr(triangles_across, "closest_on", closest_on.py_func)
    monkeypatch.setattr(triangles_across, "height_square", height_square.py_func)
    tree, rng = MeshSurface(part)._tree, np.random.default_rng(0)
    points, faces = part.corners.mean(axis=1), rng.integers(len(part.faces), size=300)
    # Across one side from where a walk begins.
    starts, queries = tree.slots[part.face_neighbours[faces, rng.integers(3, size=300)]], points[faces]
    ends, squares = [], []
    for slot, query in zip(starts, queries, strict=True):
        t, d, u, v = walk_across.py_func(tree.packed, tree.across, slot, *query)
        assert d <= closest_on.py_func(tree.packed, slot, *query)[0]
        assert (d, u, v) == closest_on.py_func(tree.packed, t, *query)
        ends.append(t)
        squares.append(d)
    assert np.mean(tree.faces[ends] == faces) > 0.9


def test_over_a_face_of_needles_a_walk_goes_on_and_high_above_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(triangles_across, "closest_on", closest_on.py_func)
    monkeypatch.setattr(triangles_across, "height_square", height_square.py_func)
    angles = np.linspace(0.0, 0.5 * np.pi, 61)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(61)])
    corners = np.stack([np.zeros((60, 3)), rim[:-1], rim[1:]], axis=1)
    tree = TriangleTree.of(corners, np.tile([0.0, 0, 1], (60, 1)))
    x, y, _ = 0.8 * rim[50:52].mean(axis=0)
    near, high = (walk_across.py_func(tree.packed, tree.across, tree.slots[0], x, y, z)[0] for z in (0.01, 2.0))
    assert (tree.faces[near], tree.faces[high]) == (50, STEPS_PER_ROUND)


def test_without_what_lies_across_the_same_is_found(part: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    queries = rng.uniform(*part.bounds, size=(500, 3))
    walked = MeshSurface(part)._tree
    monkeypatch.setattr(triangle_tree, "MAX_WALKED_TRIANGLES", 0)
    other = MeshSurface(part)._tree
    assert len(walked.across) == len(part.faces) > len(other.across) == 0
    for one, two in zip(walked.closest(queries), other.closest(queries), strict=True):
        np.testing.assert_array_equal(one, two)
