from __future__ import annotations

import numpy as np
import pytest

from dqreg.batch.huge import register_huge
from dqreg.batch.sums import Question, Sums, measure, split
from dqreg.batch.sums import total as summed
from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import Icp, InlierMixture, NormalAngle, Stopping, WithinDistance
from dqreg.icp.face_noise import points_to_weighed_planes
from dqreg.icp.weights import Robust, product
from dqreg.register import register
from dqreg.solvers.quadratic import QuadraticForm
from dqreg.synth.parts import bracket
from tests.icp.scenes import motion


@pytest.fixture(scope="module")
def scene():
    mesh, rng = Mesh(*bracket()), np.random.default_rng(5)
    points = sample_mesh(mesh, 8_000, rng).points
    return mesh, points + rng.normal(scale=2e-4 * mesh.diagonal, size=points.shape)


@pytest.mark.parametrize("chunks", [2, 3, 17])
def test_the_pose_does_not_depend_on_the_chunks(scene, chunks):
    mesh, points = scene
    one = register_huge(points, mesh, "identity", effort="fast")
    many = register_huge(points, mesh, "identity", effort="fast", chunks=chunks)
    assert np.abs(one.T_target_source - many.T_target_source).max() <= 1e-10 * mesh.diagonal
    assert one.status == "converged"
    assert one.history[-1].points == len(points)


def test_it_ends_where_the_loop_of_one_machine_ends(scene):
    # The oracle is the loop itself at the width that was learned: points to planes, all points, until nothing moves.
    mesh, points = scene
    found = register_huge(PointCloud(points), mesh, "identity", effort="fast")
    origin = found.inputs.target.origin
    scan = prepare_scan(found.inputs.source.cloud, 2_000)
    centred = Mesh(mesh.vertices - origin, mesh.faces)
    last = found.history[-1]
    share = last.inlier_fraction
    kernel = InlierMixture(last.scale, share, found.settings["max_distance"])
    gates = (WithinDistance(kernel.limit), NormalAngle(np.deg2rad(60.0)))
    loop = Icp(points_to_weighed_planes, kernel, gates, Stopping(1e-9, 30, 10), accelerate=False)
    shift = found.inputs.source.origin - origin
    start = np.eye(4)
    start[:3, 3] = shift
    run = loop.run(scan, MeshSurface(centred), start)
    T = run.T_target_source.copy()
    T[:3, 3] += origin - T[:3, :3] @ found.inputs.source.origin
    assert np.abs(T - found.T_target_source).max() <= 1e-8 * mesh.diagonal


def test_it_agrees_with_best_effort(scene):
    mesh, points = scene
    best = register(points, mesh, "identity", effort="best")
    found = register_huge(points, mesh, "identity")
    # Far below what the noise leaves open: 2e-4 S over the root of 8,000.
    assert np.abs(best.T_target_source - found.T_target_source).max() <= 1e-6 * mesh.diagonal
    assert found.rms == pytest.approx(best.rms, rel=1e-2)
    assert found.verdict == register(points, mesh, "identity", effort="normal").verdict


def test_sums_of_chunks_are_those_of_the_whole(scene):
    mesh, points = scene
    scan, surface = prepare_scan(PointCloud(points), 1_000), MeshSurface(mesh)
    T = motion(0.05, 0.3)
    question = Question(T, InlierMixture(0.5, 0.7, 10.0), 1.0, (points.mean(axis=0), points.mean(axis=0)))
    parts = split(scan, 6)
    assert sum(map(len, parts)) == len(scan)
    np.testing.assert_array_equal(np.concatenate([part.points for part in parts]), scan.points)
    total = summed([measure(part, surface, question) for part in parts])
    whole = measure(scan, surface, question)
    assert isinstance(total, Sums)
    np.testing.assert_allclose(total.matrix, whole.matrix, rtol=1e-12, atol=1e-12 * whole.matrix.max())
    assert (total.near, total.pairs, total.points) == (whole.near, whole.pairs, whole.points)
    # Against the loop's own parts, which know nothing of chunks: weights, and the cost of planes.
    from dqreg.icp import correspond

    pairs = correspond(scan, surface, T)
    weights = product((WithinDistance(10.0), NormalAngle(1.0)), pairs) * Robust(question.mixture)(pairs)
    assert whole.weight == pytest.approx(weights.sum(), rel=1e-12)
    moved = scan.points @ T[:3, :3].T + T[:3, 3]
    along = np.einsum("ij,ij->i", moved - pairs.closest.points, pairs.closest.normals)
    value = QuadraticForm(whole.matrix, *question.origins).value(T)
    assert value == pytest.approx(weights @ along**2, rel=1e-9)


@pytest.mark.parametrize(("options", "said"), [({"method": "dq"}, "method"), ({"dof": "z"}, "dof"),
                                               ({"chunks": 0}, "chunks")])  # fmt: skip
def test_what_the_chunked_stage_does_not_know_is_refused(scene, options, said):
    mesh, points = scene
    with pytest.raises(InputError, match=said):
        register_huge(points, mesh, "identity", **options)


def test_nothing_found_stays_nothing_found(scene):
    mesh, points = scene
    far = register_huge(points + 1e4, mesh, "identity", max_distance=1.0)
    assert np.isnan(far.T_target_source).all()
    assert far.verdict.level == "failed"
