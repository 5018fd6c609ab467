from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.search.refine import Sample, refine
from dqreg.search.scoring import weigh_up
from dqreg.synth import disturbance, worst_vertex_displacement
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
SURFACE = MeshSurface(PART)
NOTHING = np.zeros((0, 3))


def stacked(poses: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    T = np.array(poses)
    return T[:, :3, :3], T[:, :3, 3]


def test_all_poses_of_a_batch_come_home_and_as_if_alone():
    # The sample lies on the part, so the truth is the identity.
    rng = np.random.default_rng(0)
    cloud = sample_mesh(PART, 400, rng)
    sample = Sample(cloud.points, np.asarray(cloud.normals), NOTHING, NOTHING)
    starts = [disturbance(rng, 0.05, 0.01 * PART.diagonal, PART.centre) for _ in range(8)]
    widths = np.geomspace(0.03, 1e-3, 12) * PART.diagonal
    R, t = refine(*stacked(starts), sample, SURFACE, None, widths, NOTHING)
    for k, start in enumerate(starts):
        T = pose.from_parts(R[k], t[k])
        assert worst_vertex_displacement(T, np.eye(4), PART.vertices) < 1e-5 * PART.diagonal
        alone = refine(*stacked([start]), sample, SURFACE, None, widths, NOTHING)
        np.testing.assert_allclose(alone[0][0], R[k], atol=1e-9)


def test_no_pose_and_no_point_near_move_nothing():
    sample = Sample(PART.vertices, np.zeros_like(PART.vertices), NOTHING, NOTHING)
    R, t = refine(np.zeros((0, 3, 3)), np.zeros((0, 3)), sample, SURFACE, None, np.ones(3), NOTHING)
    assert R.shape == (0, 3, 3)
    assert t.shape == (0, 3)
    far = np.full((1, 3), 1e3 * PART.diagonal)
    R, t = refine(np.eye(3)[None], far, sample, SURFACE, None, np.full(3, 0.01 * PART.diagonal), NOTHING)
    np.testing.assert_allclose(R[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(t, far)


def test_the_judge_finds_the_truth_and_knows_what_is_behind():
    rng = np.random.default_rng(2)
    points = sample_mesh(PART, 3_000, rng).points + 1e-3 * PART.diagonal * rng.normal(size=(3_000, 3))
    wrong = disturbance(rng, 0.02, 0.0, PART.centre)
    R, t = stacked([wrong, np.eye(4), np.eye(4)])
    judgement = weigh_up(R, t, points, SURFACE, 0.05 * PART.diagonal, 1e-6 * PART.diagonal)
    assert judgement.means.argmax() == 1
    behind, error = judgement.behind(1)
    assert behind[0] > 10.0 * error[0] > 0.0
    assert behind[2] == error[2] == 0.0
    # The noise is isotropic; the distance sees the part of it along the normal.
    assert 0.7e-3 < judgement.width / PART.diagonal < 1.3e-3


def test_strays_cost_all_poses_the_same():
    rng = np.random.default_rng(3)
    clean = sample_mesh(PART, 2_000, rng).points
    strays = PART.centre + PART.diagonal * rng.uniform(1.0, 2.0, size=(1_000, 3))
    R, t = stacked([np.eye(4), disturbance(rng, 0.02, 0.0, PART.centre)])
    judged = weigh_up(R, t, np.concatenate([clean, strays]), SURFACE, 0.05 * PART.diagonal, 1e-3 * PART.diagonal)
    assert judged.means.argmax() == 0
    assert judged.likelihoods[:, 2_000:].std(axis=1).max() < 1e-12
