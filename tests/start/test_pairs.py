from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.rigid import pose
from dqreg.start import PairTable, propose
from dqreg.start.pairs import LENGTH_BIN, pair_keys
from dqreg.start.screening import DistanceGrid, distinct
from dqreg.synth import random_pose, worst_vertex_displacement
from dqreg.synth.parts import box, bracket


@pytest.fixture(scope="module")
def part():
    return Mesh(*bracket())


@pytest.fixture(scope="module")
def surface(part):
    return MeshSurface(part)


@pytest.fixture(scope="module")
def table(part, surface):
    return PairTable.of(part, surface)


def test_keys_ascend_and_belong_to_their_pairs(table):
    assert (np.diff(table.keys) >= 0).all()
    np.testing.assert_array_equal(table.keys, pair_keys(table.pairs, table.size))
    assert table.pairs.length.min() > 7 * LENGTH_BIN * table.size


def test_every_true_counterpart_is_a_rigid_copy(table):
    # Pairs of one key agree to a bin in length.
    same = np.flatnonzero(np.diff(table.keys) == 0)
    gap = np.abs(table.pairs.length[same] - table.pairs.length[same + 1])
    assert gap.max() <= LENGTH_BIN * table.size


@pytest.mark.parametrize("oriented", [True, False])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_proposal_is_near_the_truth(part, table, seed, oriented):
    # Truth: the drawn pose itself. The table's points stand 4 % of the size apart, so half of that is near.
    rng = np.random.default_rng(seed)
    T = random_pose(rng, part.diagonal, part.centre)
    sample = sample_mesh(part, 5_000, rng)
    back = pose.inverse(T)
    normals = pose.rotate(back, sample.normals) if oriented else None
    scan = prepare_scan(PointCloud(pose.apply(back, sample.points), normals))
    errors = [worst_vertex_displacement(P, T, part.vertices) for P in propose(scan, table, rng)]
    assert min(errors) < 0.1 * part.diagonal


def test_same_seed_same_proposals(part, table):
    scan = prepare_scan(sample_mesh(part, 3_000, np.random.default_rng(0)))
    one, other = (propose(scan, table, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_nothing_to_go_by_proposes_nothing(table):
    flat = np.column_stack([np.random.default_rng(0).uniform(0, 100, (500, 2)), np.zeros(500)])
    assert propose(prepare_scan(PointCloud(flat)), table, np.random.default_rng(0)) == []


def test_grid_scores_agree_with_exact_distances(part, surface, table):
    rng = np.random.default_rng(1)
    points = sample_mesh(part, 300, rng).points
    poses = np.array([pose.exp(rng.normal(size=6) * [0.1, 0.1, 0.1, 5, 5, 5]) for _ in range(20)])
    reach = 0.1 * part.diagonal
    got = table.grid.scores(poses[:, :3, :3], poses[:, :3, 3], points, reach)
    exact = []
    for T in poses:
        d = surface.closest(pose.apply(T, points)).distances
        exact.append(np.maximum(1.0 - (d / reach) ** 2, 0.0).mean())
    # A point is at most half a cell's diagonal from its node; the gain's slope is at most 2 / reach.
    bound = 2.0 / reach * 0.5 * np.sqrt(3.0) * table.grid.cell
    assert np.abs(got - exact).max() < bound
    assert np.corrcoef(got, exact)[0, 1] > 0.99


def test_points_outside_the_grid_count_nothing():
    mesh = Mesh(*box())
    grid = DistanceGrid(MeshSurface(mesh), *mesh.bounds)
    far = np.array([[0.0, 0.0, 1e6]])
    assert grid.scores(np.eye(3)[None], far, np.zeros((4, 3)), 0.1).tolist() == [0.0]


def test_distinct_keeps_the_first_of_each_group():
    turns = [0.0, 0.01, 1.0, 1.01, 2.0]
    R = np.array([pose.exp([0, 0, a, 0, 0, 0])[:3, :3] for a in turns])
    rows = distinct(R, np.zeros((5, 3)), np.zeros(3), 0.1, 0.1, 10)
    assert rows.tolist() == [0, 2, 4]
    shifted = distinct(R[:2], np.array([[0.0, 0, 0], [1, 0, 0]]), np.zeros(3), 0.1, 0.1, 10)
    assert shifted.tolist() == [0, 1]
    assert distinct(R, np.zeros((5, 3)), np.zeros(3), 0.1, 0.1, 2).tolist() == [0, 2]
