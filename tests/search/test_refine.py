from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refine, refined_on
from dqreg.search.scoring import score_poses
from dqreg.synth import disturbance, worst_vertex_displacement
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
SURFACE = MeshSurface(PART)


def stacked(poses: list[np.ndarray]) -> Poses:
    return Poses.of(np.array(poses))


def test_all_poses_of_a_batch_converge_as_if_alone():
    # The sample lies on the part, so the truth is the identity.
    rng = np.random.default_rng(0)
    cloud = sample_mesh(PART, 400, rng)
    sample = OrientedPoints.on_faces(cloud.points, np.asarray(cloud.normals))
    starts = [disturbance(rng, 0.05, 0.01 * PART.diagonal, PART.centre) for _ in range(8)]
    widths = np.geomspace(0.03, 1e-3, 12) * PART.diagonal
    refined = refine(stacked(starts), sample, SURFACE, widths)
    for k, start in enumerate(starts):
        T = pose.from_parts(refined.R[k], refined.t[k])
        assert worst_vertex_displacement(T, np.eye(4), PART.vertices) < 1e-5 * PART.diagonal
        alone = refine(stacked([start]), sample, SURFACE, widths)
        np.testing.assert_allclose(alone.R[0], refined.R[k], atol=1e-9)


def test_no_pose_and_no_point_near_move_nothing():
    sample = OrientedPoints.on_faces(PART.vertices)
    nothing = refine(Poses.of(np.zeros((0, 4, 4))), sample, SURFACE, np.ones(3))
    assert nothing.R.shape == (0, 3, 3)
    assert nothing.t.shape == (0, 3)
    far = np.full((1, 3), 1e3 * PART.diagonal)
    refined = refine(Poses(np.eye(3)[None], far), sample, SURFACE, np.full(3, 0.01 * PART.diagonal))
    np.testing.assert_allclose(refined.R[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(refined.t, far)


def test_the_true_pose_has_the_best_score_and_wrong_ones_a_deficit():
    rng = np.random.default_rng(2)
    points = sample_mesh(PART, 3_000, rng).points + 1e-3 * PART.diagonal * rng.normal(size=(3_000, 3))
    wrong = disturbance(rng, 0.02, 0.0, PART.centre)
    poses = stacked([wrong, np.eye(4), np.eye(4)])
    scores = score_poses(poses, points, SURFACE, 0.05 * PART.diagonal, 1e-6 * PART.diagonal)
    assert scores.means.argmax() == 1
    behind, error = scores.deficit(1)
    assert behind[0] > 10.0 * error[0] > 0.0
    assert behind[2] == error[2] == 0.0
    # The noise is isotropic; the distance sees the part of it along the normal.
    assert 0.7e-3 < scores.width / PART.diagonal < 1.3e-3


def test_outliers_cost_all_poses_the_same():
    rng = np.random.default_rng(3)
    clean = sample_mesh(PART, 2_000, rng).points
    outliers = PART.centre + PART.diagonal * rng.uniform(1.0, 2.0, size=(1_000, 3))
    poses = stacked([np.eye(4), disturbance(rng, 0.02, 0.0, PART.centre)])
    scores = score_poses(poses, np.concatenate([clean, outliers]), SURFACE, 0.05 * PART.diagonal, 1e-3 * PART.diagonal)
    assert scores.means.argmax() == 0
    assert scores.likelihoods[:, 2_000:].std(axis=1).max() < 1e-12


def test_a_sample_is_as_large_as_said_and_its_kernel_scales_are_in_sizes_or_lengths() -> None:
    how = Refinement(first=0.02, steps=3, points=100, last=0.005)
    assert len(how.sample(np.zeros((1_000, 3)))) == 100
    assert np.allclose(how.widths(2.0), [0.04, 0.02, 0.01], rtol=1e-12)
    points = sample_mesh(PART, 400, np.random.default_rng(0)).points
    T = disturbance(np.random.default_rng(1), 0.02, 0.005 * PART.diagonal, PART.centre)[None]
    in_lengths = Refinement(0.02 * SURFACE.diagonal, 3, 100, 0.005 * SURFACE.diagonal)
    same = refined_on(T, points, SURFACE, how), refined_on(T, points, SURFACE, in_lengths, unit=1.0)
    assert np.abs(same[0] - T).max() > 1e-4
    assert np.allclose(*same, rtol=0.0, atol=1e-9)
