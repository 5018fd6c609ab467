from __future__ import annotations

import itertools
import time
from types import SimpleNamespace

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud, Scan, prepare_scan, sample_mesh
from dqreg.icp import ESTIMATORS, IcpSettings
from dqreg.rigid import pose
from dqreg.search import Candidate, PairTable, search, stages
from dqreg.search.problem import SearchProblem
from dqreg.synth import worst_vertex_displacement
from dqreg.synth.parts import block, box, bracket

BRACKET, BOX = Mesh(*bracket()), Mesh(*box((3.0, 2.0, 1.0)))


class Searched:
    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.surface = mesh, MeshSurface(mesh)
        self.table = PairTable.of(mesh, self.surface)

    def scan(self, seed: int, noise: float = 3e-4) -> tuple[Scan, np.ndarray]:
        # Truth: the drawn pose itself.
        rng = np.random.default_rng(seed)
        T = pose.random(rng, reach=self.mesh.diagonal)
        sample = sample_mesh(self.mesh, 5_000, rng).points
        sample = sample + noise * self.mesh.diagonal * rng.normal(size=sample.shape)
        return prepare_scan(PointCloud(pose.apply(pose.inverse(T), sample))), T

    def search(self, scan: Scan, **options) -> tuple[Candidate, ...]:
        plan = IcpSettings(ESTIMATORS["dq"], 0.2 * self.mesh.diagonal)
        return search(scan, self.surface, self.mesh, plan, lambda: self.table, np.random.default_rng(0), **options)

    def error(self, found: Candidate, T: np.ndarray) -> float:
        return worst_vertex_displacement(found.T_target_source, T, self.mesh.vertices) / self.mesh.diagonal


@pytest.fixture(scope="module")
def part():
    return Searched(BRACKET)


@pytest.fixture(scope="module")
def symmetric():
    return Searched(BOX)


def test_the_part_is_found_and_nothing_else(part):
    scan, T = part.scan(0)
    found = part.search(scan)
    # A start needs no more than this; noise of 3e-4 over thousands of points leaves far less.
    assert part.error(found[0], T) < 2e-3
    assert len(found) == 1
    assert found[0].stage == "judged"


def test_a_box_has_four_poses_and_says_why(symmetric):
    scan, T = symmetric.scan(0)
    found = symmetric.search(scan)
    assert len(found) == 4
    truths = [T, *(turn @ T for turn in symmetric.table.symmetry.poses[1:])]
    for truth in truths:
        assert min(symmetric.error(candidate, truth) for candidate in found) < 2e-3
    assert found[0].symmetry is None
    assert all(candidate.symmetry.order == 2 for candidate in found[1:])


def test_same_seed_same_poses(part):
    scan, _ = part.scan(2)
    one, other = part.search(scan), part.search(scan)
    np.testing.assert_array_equal(one[0].T_target_source, other[0].T_target_source)


def test_the_time_limit_returns_the_best_so_far_and_says_so(part, monkeypatch):
    # A clock that runs a second at each look between stages, and ahead of the one that is asked within them: no real
    # time is measured.
    scan, T = part.scan(3)
    ahead = float(round(time.perf_counter()) + 10**6)
    for limit, stage in ((1.0, "proposed"), (2.0, "screened"), (4.0, "refined")):
        ticks = itertools.count()
        clock = SimpleNamespace(perf_counter=lambda ticks=ticks: ahead + next(ticks))
        monkeypatch.setattr(stages, "time", clock)
        found = part.search(scan, time_limit=limit)
        assert [candidate.stage for candidate in found] == [stage]
    assert part.error(found[0], T) < 0.02


@pytest.mark.parametrize("limit", [1.0, 20.0, 60.0])
def test_the_time_limit_ends_a_stage_halfway(part, monkeypatch, limit):
    scan, _ = part.scan(3)
    part.search(scan)
    # A clock that runs a second at each look, of which a stage has tens: the search makes some, and no more.
    looks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(looks)))
    found = part.search(scan, time_limit=limit)
    assert next(looks) <= limit + 40
    assert len(found) == 1
    assert found[0].stage != "judged"


def test_where_the_time_is_up_nothing_is_made_to_score_the_target_on_the_scan(monkeypatch):
    rng = np.random.default_rng(0)
    target = PointCloud(sample_mesh(BRACKET, 4_000, rng).points)
    surface, scan = CloudSurface(target), prepare_scan(PointCloud(sample_mesh(BRACKET, 4_000, rng).points))
    monkeypatch.setattr(SearchProblem, "other_way", property(lambda self: pytest.fail("a tree of the scan")))
    plan = IcpSettings(ESTIMATORS["dq"], 0.2 * BRACKET.diagonal)
    table = lambda: PairTable.of(target, surface)  # noqa: E731
    found = search(scan, surface, target, plan, table, np.random.default_rng(0), time_limit=1e-9)
    assert [candidate.stage for candidate in found] == ["proposed"]
    assert np.isfinite(found[0].mean_nll)


def test_stages_are_reported_and_may_stop_the_search(part):
    scan, _ = part.scan(4)
    seen = []
    part.search(scan, observe=lambda stage: seen.append(stage))
    assert [s.name for s in seen] == ["proposed", "screened", "refined roughly", "refined", "turned", "refined finely"]
    assert seen[0].poses > 1_000 > seen[1].poses >= seen[2].poses >= seen[3].poses > 0
    assert [s.seconds for s in seen] == sorted(s.seconds for s in seen)
    stopped = part.search(scan, observe=lambda stage: stage.name != "screened")
    assert stopped[0].stage == "screened"


def test_a_part_is_found_in_a_larger_cloud(part):
    # The scene is the part at its place and a wall three times its size; truth: the drawn pose itself.
    scan, T = part.scan(5)
    rng = np.random.default_rng(6)
    wall = part.mesh.diagonal * np.column_stack([rng.uniform(-1.5, 1.5, size=(6_000, 2)), np.full(6_000, 1.2)])
    scene = PointCloud(np.concatenate([sample_mesh(part.mesh, 8_000, rng).points, wall]))
    surface = CloudSurface(scene)
    plan = IcpSettings(ESTIMATORS["dq"], 0.2 * part.mesh.diagonal)

    def never() -> PairTable:
        raise AssertionError("the table of a scene in which a smaller scan is looked for is of no use")

    found = search(scan, surface, scene, plan, never, np.random.default_rng(0))
    assert part.error(found[0], T) < 0.02


def test_a_notch_that_is_seen_decides_between_half_turns():
    # The notch is 0.7 % of the block: a hundred points of 14,000 see it.
    task = Searched(Mesh(*block()))
    scan, T = task.scan(7)
    found = task.search(scan)
    assert len(found) == 1
    assert task.error(found[0], T) < 2e-3


def test_where_a_pose_is_known_the_others_are_found_and_nothing_else(part, symmetric) -> None:
    scan, T = part.scan(seed=1)
    assert part.search(scan, known=T[None]) == ()
    # Of the four poses of a box two are known.
    scan, T = symmetric.scan(seed=1)
    copies = symmetric.table.symmetry.poses @ T
    found = symmetric.search(scan, known=copies[:2])
    assert len(found) == 2
    for copy in copies[2:]:
        assert min(symmetric.error(one, copy) for one in found) < 3e-3
    assert symmetric.search(scan, known=copies) == ()


def test_what_fits_better_than_a_known_pose_is_found(part) -> None:
    scan, T = part.scan(seed=2)
    wrong = pose.about(pose.exp([0.0, 0.0, np.pi, 0.0, 0.0, 0.0]), BRACKET.centre) @ T
    found = part.search(scan, known=wrong[None])
    assert len(found) == 1
    assert part.error(found[0], T) < 3e-3
