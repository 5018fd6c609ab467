"""Nearest points that are asked for again after small motions, against all distances."""

import numpy as np
import pytest

from dqreg.kernels.trees.close_points import close_points, facing_matches
from dqreg.kernels.trees.point_tree import LEAF_POINTS, PointTree
from dqreg.rigid import pose


def brute(targets: np.ndarray, moved: np.ndarray, reach: float) -> np.ndarray:
    distances = np.linalg.norm(moved[:, None] - targets, axis=-1)
    return np.where(distances.min(axis=1) <= reach, distances.argmin(axis=1), -1)


@pytest.mark.parametrize("step", [1e-3, 0.05, 0.5])
def test_what_is_kept_from_the_call_before_is_what_all_distances_say(step: float) -> None:
    rng = np.random.default_rng(0)
    targets, points, reach = rng.uniform(size=(200, 3)), rng.uniform(-0.2, 1.2, (300, 3)), 0.1
    tree = PointTree.of(targets)
    found, others = np.full(300, -1), np.full(300, -np.inf)
    T, moved_by = np.eye(4), np.inf
    for _ in range(6):
        motion = np.ascontiguousarray(T[:3])
        place = tree.boxes, tree.places, LEAF_POINTS, tree.rows, targets
        close_points(0, 300, *place, points, motion, moved_by, reach, found, others)
        moved = pose.apply(T, points)
        near = np.where(
            (found >= 0) & (np.linalg.norm(moved - targets[np.maximum(found, 0)], axis=1) <= reach), found, -1
        )
        np.testing.assert_array_equal(near, brute(targets, moved, reach))
        after = pose.exp(step * rng.uniform(-1, 1, 6)) @ T
        moved_by = float(np.linalg.norm(pose.apply(after, points) - moved, axis=1).max())
        T = after


def test_matches_that_count_are_near_and_face_the_same_way() -> None:
    rng = np.random.default_rng(1)
    targets, points = rng.normal(size=(40, 3)), rng.normal(size=(60, 3))
    n, m = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (rng.normal(size=(40, 3)), rng.normal(size=(60, 3))))
    T, found, barred = pose.random(rng, reach=0.1), rng.integers(-1, 40, 60), rng.random(40) < 0.2
    for signed in (True, False):
        kept, distances, aside = np.zeros(60, dtype=np.int64), np.zeros(60), np.zeros(60)
        count = facing_matches(
            points, m, np.ascontiguousarray(T[:3]), found, targets, n, barred, 2.0, 0.3, signed, kept, distances, aside
        )
        gaps = pose.apply(T, points) - targets[found]
        cosines = np.einsum("ij,ij->i", m @ T[:3, :3].T, n[found])
        good = (found >= 0) & ~barred[found] & (np.linalg.norm(gaps, axis=1) <= 2.0)
        good &= (cosines if signed else np.abs(cosines)) >= 0.3
        np.testing.assert_array_equal(kept[:count], np.flatnonzero(good))
        np.testing.assert_allclose(distances[:count], np.linalg.norm(gaps, axis=1)[good], rtol=1e-12)
        np.testing.assert_allclose(aside[:count], np.einsum("ij,ij->i", gaps, n[found])[good], atol=1e-12)
