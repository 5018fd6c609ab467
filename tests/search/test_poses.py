from __future__ import annotations

import numpy as np

from dqreg.rigid import pose
from dqreg.search.poses import Poses


def test_distinct_keeps_the_first_of_each_group():
    turns = [0.0, 0.01, 1.0, 1.01, 2.0]
    R = np.array([pose.exp([0, 0, a, 0, 0, 0])[:3, :3] for a in turns])
    rows = Poses(R, np.zeros((5, 3))).distinct(np.zeros(3), 0.1, 0.1, 10)
    assert rows.tolist() == [0, 2, 4]
    shifted = Poses(R[:2], np.array([[0.0, 0, 0], [1, 0, 0]])).distinct(np.zeros(3), 0.1, 0.1, 10)
    assert shifted.tolist() == [0, 1]
    assert Poses(R, np.zeros((5, 3))).distinct(np.zeros(3), 0.1, 0.1, 2).tolist() == [0, 2]


def test_poses_act_as_their_matrices_do():
    rng = np.random.default_rng(0)
    T, M = (np.array([pose.random(rng, reach=2.0) for _ in range(n)]) for n in (5, 3))
    poses, points = Poses.of(T), rng.normal(size=(7, 3))
    np.testing.assert_array_equal(poses.matrices, T)
    np.testing.assert_allclose(poses.apply(points), [pose.apply(each, points) for each in T], atol=1e-14)
    np.testing.assert_allclose(poses.inverse.matrices, [pose.inverse(each) for each in T], atol=1e-14)
    np.testing.assert_allclose(poses.then(M).matrices, [m @ each for m in M for each in T], atol=1e-14)


def test_a_pose_is_beside_another_where_neither_angle_nor_place_is_apart() -> None:
    R = np.array([pose.exp([0, 0, a, 0, 0, 0])[:3, :3] for a in (0.0, 0.05, 0.2, 0.0)])
    poses = Poses(R, np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]]))
    known = Poses(R[:1], np.zeros((1, 3)))
    assert poses.beside(known, np.zeros(3), 0.1, 0.1).tolist() == [True, True, False, False]
    # Far from the axis a small angle moves the middle.
    assert poses.beside(known, np.array([10.0, 0.0, 0.0]), 0.1, 0.1).tolist() == [True, False, False, False]
