from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, Surface, prepare_scan, sample_mesh
from dqreg.icp import ESTIMATORS, IcpSettings
from dqreg.rigid import pose
from dqreg.search import stages
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Poses
from dqreg.search.problem import SearchProblem
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
SURFACE: Surface = MeshSurface(PART)


def problem_of(points: np.ndarray) -> SearchProblem:
    plan = IcpSettings(ESTIMATORS["dq"], 0.2 * PART.diagonal)
    scan = prepare_scan(PointCloud(points))
    return SearchProblem(scan, SURFACE, PART, plan, lambda: PairTable.of(PART, SURFACE), np.random.default_rng(0))


def scene() -> np.ndarray:
    """The part on a table four times its size."""
    rng = np.random.default_rng(1)
    spots = 2.0 * PART.diagonal * rng.uniform(-1.0, 1.0, size=(6_000, 2))
    table = np.column_stack([spots, np.full(len(spots), PART.bounds[0][2])])
    return np.concatenate([sample_mesh(PART, 3_000, rng).points, table])


@pytest.mark.parametrize("seed", range(4))
def test_a_scan_of_the_part_alone_is_scored_one_way_however_it_is_turned(seed):
    # A long part that stands aslant has a bounding box far larger than its own.
    points = sample_mesh(PART, 5_000, np.random.default_rng(seed)).points
    turned = pose.apply(pose.random(np.random.default_rng(seed), reach=0.0), points)
    assert problem_of(turned).other_way is None
    assert problem_of(scene()).other_way is not None


def test_the_table_of_pairs_is_made_when_it_is_first_needed_and_once():
    made = []

    def make() -> PairTable:
        made.append(1)
        return PairTable.of(PART, SURFACE)

    scan = prepare_scan(PointCloud(sample_mesh(PART, 2_000, np.random.default_rng(0)).points))
    problem = SearchProblem(scan, SURFACE, PART, IcpSettings(ESTIMATORS["dq"], 1.0), make, np.random.default_rng(0))
    assert problem.size == SURFACE.diagonal
    assert made == []
    assert problem.table is problem.table
    assert made == [1]


def test_poses_far_behind_the_best_are_dropped_of_a_part_and_none_of_a_scene():
    # A scene is explained by its table: there the part's pose may be far behind.
    away = np.eye(4)
    away[0, 3] = 10.0 * PART.diagonal
    poses = Poses.of(np.stack([away, np.eye(4), away]))
    points = sample_mesh(PART, 5_000, np.random.default_rng(0)).points
    assert problem_of(points).order(poses, 100, 0.02, 0.6).tolist() == [1]
    assert problem_of(points).order(poses, 100, 0.02).tolist() == [1, 0, 2]
    assert sorted(problem_of(scene()).order(poses, 100, 0.02, 0.6).tolist()) == [0, 1, 2]


def test_so_many_rows_by_falling_gain_are_the_first_of_all() -> None:
    problem, rng = problem_of(scene()), np.random.default_rng(3)
    poses = Poses.of(np.array([pose.random(rng, reach=0.3 * PART.diagonal) for _ in range(400)]))
    # Poses come twice: of equal gains the first is first.
    poses = poses + poses
    state = problem.rng.bit_generator.state
    rows = problem.order(poses, 64, 0.1)
    for most in (1, 33, 800, 1_000):
        problem.rng.bit_generator.state = state
        assert problem.order(poses, 64, 0.1, most=most).tolist() == rows[:most].tolist()


def test_near_symmetries_are_tried_again_from_a_better_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(sample_mesh(PART, 1_000, np.random.default_rng(0)).points)
    turned = pose.about(pose.exp([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), PART.centre)
    symmetry = dataclasses.replace(problem.table.symmetry, near=turned[None])
    monkeypatch.setitem(problem.table.__dict__, "symmetry", symmetry)
    better = [np.linalg.matrix_power(turned, k) for k in (1, 2, 2)]
    monkeypatch.setattr(stages, "_followed", lambda *_: Poses.of(better.pop(0)[None]))
    found = stages.add_near_symmetric(problem, Poses.of(np.eye(4)[None]))
    np.testing.assert_allclose(found.matrices[0], np.linalg.matrix_power(turned, 2))
    assert better == []
