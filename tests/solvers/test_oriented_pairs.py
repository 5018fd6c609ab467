from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.rigid import pose
from dqreg.solvers.oriented_pairs import OrientedPairs, poses_from_pairs
from tests.strategies import poses


def cloud(seed: int, count: int = 20):
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, count, 3))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


FIRST, SECOND = np.arange(0, 20, 2), np.arange(1, 20, 2)


@settings(deadline=None, max_examples=50)
@given(poses(), st.integers(0, 1000))
def test_a_moved_pair_gives_the_motion(T, seed):
    points, normals = cloud(seed)
    source = OrientedPairs.of(points, normals, FIRST, SECOND)
    target = OrientedPairs.of(pose.apply(T, points), pose.rotate(T, normals), FIRST, SECOND)
    R, t = poses_from_pairs(source, target)
    # Far translations cost digits of the distances between the moved points.
    digits = 1e-10 * (1.0 + np.abs(T[:3, 3]).max())
    np.testing.assert_allclose(R, np.broadcast_to(T[:3, :3], R.shape), atol=digits)
    np.testing.assert_allclose(t, np.broadcast_to(T[:3, 3], t.shape), atol=10 * digits)


def test_signs_of_normals_do_not_matter():
    points, normals = cloud(1)
    signs = np.random.default_rng(2).choice([-1.0, 1.0], size=(20, 1))
    one, other = (
        OrientedPairs.of(points, normals, FIRST, SECOND),
        OrientedPairs.of(points, signs * normals, FIRST, SECOND),
    )
    np.testing.assert_array_equal(one.cosines, other.cosines)


def test_features_are_invariant():
    points, normals = cloud(3)
    T = pose.random(np.random.default_rng(4), reach=5.0)
    one = OrientedPairs.of(points, normals, FIRST, SECOND)
    moved = OrientedPairs.of(pose.apply(T, points), pose.rotate(T, normals), FIRST, SECOND)
    np.testing.assert_allclose(moved.cosines, one.cosines, atol=1e-12)


def test_answers_are_rotations_also_for_pairs_that_do_not_match():
    source, target = (OrientedPairs.of(*cloud(seed), FIRST, SECOND) for seed in (5, 6))
    R, t = poses_from_pairs(source, target)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", R, source.middle) + t, target.middle, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", R, source.along), target.along, atol=1e-12)
