from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

from dqreg.geometry import Mesh, sample_mesh
from dqreg.kernels.threads import TimeUpError, until
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.search import fpfh
from dqreg.search.fpfh import FpfhCloud, first_in_voxels, match_hypotheses, orient_consistently
from dqreg.synth.parts import bracket

BRACKET = Mesh(*bracket())
VOXEL = BRACKET.diagonal / 60.0


def test_halves_that_share_a_third_are_matched():
    # Truth: the drawn pose itself. 12 degrees and 5 % of the size are what the refinement that follows can mend.
    rng = np.random.default_rng(0)
    T = pose.random(rng, reach=BRACKET.diagonal)
    sides = []
    for sign in (1.0, -1.0):
        points = sample_mesh(BRACKET, 20_000, rng).points
        along = sign * (points - BRACKET.centre)[:, 0]
        sides.append(points[along < 0.17 * np.ptp(points[:, 0])])
    source = FpfhCloud.of(pose.apply(pose.inverse(T), sides[0]), VOXEL)
    poses = match_hypotheses(source, FpfhCloud.of(sides[1], VOXEL), VOXEL)
    there = poses.apply(pose.apply(pose.inverse(T), BRACKET.centre[None]))[:, 0]
    near = np.linalg.norm(there - BRACKET.centre, axis=1) < 0.05 * BRACKET.diagonal
    angles = np.array([angle_of(each @ T[:3, :3].T) for each in poses.R[near]])
    assert np.count_nonzero(angles < np.deg2rad(12.0)) >= 10


def test_signs_are_propagated_over_a_sphere():
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(800, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    order = np.argsort(-(normals @ normals.T), axis=1)[:, :10]
    turned = orient_consistently(normals * rng.choice([-1.0, 1.0], size=(800, 1)), order)
    # All outwards or all inwards.
    assert abs(np.sign(np.einsum("ij,ij->i", turned, normals)).sum()) == 800


@pytest.mark.parametrize("voxel", [0.1, 0.3])
def test_each_voxel_keeps_its_first_point(voxel):
    points = np.random.default_rng(2).uniform(size=(500, 3))
    cells = [tuple(c) for c in ((points - points.min(axis=0)) / voxel).astype(int)]
    assert first_in_voxels(points, voxel).tolist() == sorted(cells.index(c) for c in set(cells))


def test_nothing_to_match_is_no_pose():
    few = FpfhCloud.of(np.eye(3), 0.1)
    poses = match_hypotheses(few, few, 0.1)
    assert poses.R.shape[1:] == (3, 3)
    assert len(poses.R) == len(poses.t)


def test_matching_asks_the_clock_and_is_the_same_under_a_deadline(monkeypatch):
    # Histograms, and rows of likenesses, in several turns.
    monkeypatch.setattr(fpfh, "HISTOGRAMS_AT_ONCE", 100)
    monkeypatch.setattr(fpfh, "COMPARED_AT_ONCE", 100)
    points, voxel = sample_mesh(BRACKET, 2_000, np.random.default_rng(0)).points, 3.0 * VOXEL
    made = [FpfhCloud.of(points, voxel) for _ in range(3)]
    assert len(made[0].points) > 200
    free = match_hypotheses(made[0], made[0], voxel)
    with until(time.perf_counter() + 1e6):
        timed = match_hypotheses(made[1], made[1], voxel)
    np.testing.assert_array_equal(timed.matrices, free.matrices)
    # A clock that runs a second at each look: what is begun ends soon.
    looks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(looks)))
    with until(2.0), pytest.raises(TimeUpError):
        _ = made[2].histograms
    assert "histograms" not in vars(made[2])
