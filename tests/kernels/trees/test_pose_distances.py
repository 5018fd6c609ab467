"""How far many poses put points from triangles, against all triangles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels import threads
from dqreg.kernels.trees.triangle_tree import CHUNK_QUERIES, TriangleTree
from dqreg.rigid import pose
from tests.geometry.oracles import brute_triangles


def tree_of(corners: np.ndarray) -> TriangleTree:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return TriangleTree.of(corners, across / np.linalg.norm(across, axis=1, keepdims=True))


def brute(corners: np.ndarray, T: np.ndarray, points: np.ndarray) -> np.ndarray:
    moved = np.stack([pose.apply(each, points) for each in T]).reshape(-1, 3)
    return np.linalg.norm(moved - brute_triangles(corners, moved), axis=1).reshape(len(T), len(points))


def asked(tree: TriangleTree, T: np.ndarray, points: np.ndarray, bound: float, by_point: bool) -> np.ndarray:
    return tree.distances(T[:, :3, :3], T[:, :3, 3], points, bound, by_point=by_point)


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 40), st.sampled_from([0.05, 0.5, np.inf]), st.sampled_from([1e-3, 1.0])
)
def test_distances_are_those_of_all_triangles(seed: int, count: int, bound: float, step: float) -> None:
    rng = np.random.default_rng(seed)
    corners, points = rng.normal(size=(count, 3, 3)), rng.normal(size=(10, 3))
    # Near each other, as in a refinement, or anywhere.
    T = pose.exp(step * rng.normal(size=(5, 6))) @ pose.random(rng, reach=1.0)
    expected = brute(corners, T, points)
    for by_point in (False, True):
        found = asked(tree_of(corners), T, points, bound, by_point)
        near = expected < bound * (1.0 - 1e-12)
        np.testing.assert_allclose(found[near], expected[near], rtol=0, atol=1e-11)
        assert np.isinf(found[expected > bound * (1.0 + 1e-12)]).all()


@pytest.mark.parametrize("by_point", [False, True])
def test_any_number_of_threads_finds_the_same(monkeypatch: pytest.MonkeyPatch, by_point: bool) -> None:
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(50, 3, 3)), rng.normal(size=(CHUNK_QUERIES // 10, 3))
    tree, T, found = tree_of(corners), pose.random(rng, reach=1.0, shape=(25,)), []
    for count in (1, 2, 8):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        found.append(asked(tree, T, points, 0.3, by_point))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])
    assert 0 < np.count_nonzero(np.isinf(found[0])) < found[0].size


def test_of_no_poses_and_of_no_points_there_are_none() -> None:
    tree = tree_of(np.random.default_rng(1).normal(size=(4, 3, 3)))
    assert asked(tree, np.zeros((0, 4, 4)), np.zeros((3, 3)), 1.0, False).shape == (0, 3)
    assert asked(tree, np.eye(4)[None], np.zeros((0, 3)), 1.0, True).shape == (1, 0)
