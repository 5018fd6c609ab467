"""Which scans fit together, asked of all of them: a scan of something else goes, whatever its pairs say."""

import dataclasses
from typing import cast

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.multiway.pairwise.pair_runs import PairRunner, Progress
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import View, read_views, typical_size
from dqreg.multiway.selection import consensus, consistent_set
from dqreg.multiway.selection.consensus import _in_frame, by_consensus
from dqreg.multiway.selection.outlier_scans import Judge
from dqreg.multiway.turntables.equal_steps import EqualSteps
from dqreg.multiway.visibility.sides import Sides
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import bracket, feeder
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of

VIEWS = 5


@pytest.fixture(scope="module")
def mixed() -> tuple[tuple[View, ...], np.ndarray, list[Edge]]:
    """Views of a bracket 30 degrees apart, then one of a feeder; pairs that all agree, the feeder's doubted."""
    made = turntable_views(bracket(), 12, pixels=40, rng=np.random.default_rng(0))
    vertices, faces = feeder()
    scale = np.linalg.norm(np.ptp(bracket()[0], axis=0)) / np.linalg.norm(np.ptp(vertices, axis=0))
    other = turntable_views((scale * vertices, faces), 2, pixels=40, rng=np.random.default_rng(1))
    views = read_views([*made.scans[:VIEWS], other.scans[0]], 0)
    middles = [pose.apply(T, scan).mean(axis=0) for T, scan in zip(made.T_world_scan, made.scans[:VIEWS], strict=False)]
    shift = pose.from_parts(np.eye(3), np.mean(middles, axis=0) - other.scans[0].mean(axis=0))
    T = pose.inverse(made.T_world_scan[0]) @ np.concatenate([made.T_world_scan[:VIEWS], shift[None]])
    pairs = [(i, j) for j in range(VIEWS + 1) for i in range(j) if j - i <= 2 or j == VIEWS]
    edges = [said(edge, sure=edge.source < VIEWS) for edge in edges_of(T, pairs, 1e-3, 0)]
    return views, T, edges


def said(edge: Edge, *, sure: bool, T: np.ndarray | None = None) -> Edge:
    """An edge with a verdict, at a pose of its own where one is given."""
    reason = Reason("made by hand", "accepted" if sure else "faces_apart")
    verdict = Verdict("accepted" if sure else "suspect", (reason,), confidence=0.8 if sure else 0.4)
    pose_of = edge.registration.T_target_source if T is None else T
    return dataclasses.replace(
        edge, registration=dataclasses.replace(edge.registration, verdict=verdict, T_target_source=pose_of)
    )


def test_a_scan_of_something_else_goes_though_its_pairs_confirm_each_other(
    mixed: tuple[tuple[View, ...], np.ndarray, list[Edge]], monkeypatch: pytest.MonkeyPatch
) -> None:
    views, T, edges = mixed
    size = typical_size(views)
    judge = Judge(Sides.of(views, "any"), VIEWS + 1, 0, size, 1e-3 * size, {})
    before = judge(edges)
    assert np.isfinite(before.T_world_scan[VIEWS]).all()
    feeder_scan = views[VIEWS].cloud

    def registered(cloud: PointCloud, others: object, start: np.ndarray | None, **_: object) -> Registration:
        """What the verdict on each scan would be; the pose is where it began."""
        return said(edges_of(T, [(0, 1)], 1e-3, 0)[0], sure=cloud is not feeder_scan, T=start).registration

    monkeypatch.setattr(consistent_set, "register", registered)
    told: list[Progress] = []
    runner = PairRunner(views, None, "fast", 0, 1, np.inf, told.append, None)
    _, after = by_consensus(runner, judge, before)
    assert np.isnan(after.T_world_scan[VIEWS]).all()
    assert {edge.code for edge in after.edges if edge.source == VIEWS} == {"misfit"}
    # Each registration to several scans is told: it takes as long as one of a pair.
    assert [progress.done for progress in told] == list(range(1, len(told) + 1))
    assert {progress.edge.source for progress in told} >= set(range(2, VIEWS + 1))
    assert all(len(progress.edge.registration.settings["against"]) >= 2 for progress in told)
    # The others stand where their pairs have them: these were moved by a thousandth of their size.
    np.testing.assert_allclose(after.T_world_scan[:VIEWS], T[:VIEWS], atol=0.01 * size)


def doubted(edges: list[Edge], code: Code) -> list[Edge]:
    """The edges, those of the last view of the bracket suspect for one reason."""
    verdict = Verdict("suspect", (Reason("made by hand", code),), confidence=0.4)
    return [
        dataclasses.replace(edge, registration=dataclasses.replace(edge.registration, verdict=verdict))
        if VIEWS - 1 in (edge.target, edge.source)
        else edge
        for edge in edges
    ]


@pytest.mark.parametrize(
    ("code", "turned", "asked"),
    [
        ("weakly_constrained", False, False),
        ("one_plane", False, False),
        ("faces_apart", False, True),
        ("weakly_constrained", True, True),
    ],
)
def test_where_all_pairs_agree_loops_hold_what_is_weakly_held(
    mixed: tuple[tuple[View, ...], np.ndarray, list[Edge]],
    monkeypatch: pytest.MonkeyPatch,
    code: Code,
    turned: bool,
    asked: bool,
) -> None:
    """All scans together are asked where a pair speaks against a pose, or one pair against the others."""
    views, T, edges = mixed
    views, size = views[:VIEWS], typical_size(views)
    edges = doubted([edge for edge in edges if edge.source < VIEWS], code)
    if turned:
        flipped = edges_of(T, [(0, 3)], 1e-3, 0)[0]
        T_flipped = flipped.registration.T_target_source @ pose.exp(np.r_[np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])
        edges.append(said(flipped, sure=True, T=T_flipped))
    judge = Judge(Sides.of(views, "any"), VIEWS, 0, size, 1e-3 * size, {})
    before = judge(edges)
    assert np.isfinite(before.T_world_scan[:VIEWS]).all()
    calls: list[int] = []
    monkeypatch.setattr(consensus, "largest_consistent_set", lambda *_: calls.append(1))
    _, after = by_consensus(PairRunner(views, None, "fast", 0, 1, np.inf, None, None), judge, before)
    assert bool(calls) == asked
    assert after is before
    # Equal steps of a turntable tell more than a union, which once took the wrong side of a plate.
    calls.clear()
    steps = cast("EqualSteps", object())
    by_consensus(
        PairRunner(views, None, "fast", 0, 1, np.inf, None, None), dataclasses.replace(judge, steps=steps), before
    )
    assert not calls


def test_a_registration_to_all_others_is_the_same_in_the_frame_of_one_of_them() -> None:
    rng = np.random.default_rng(3)
    target = rng.normal(size=(400, 3)) * [3.0, 2.0, 1.0]
    found = register(target, target, np.eye(4), effort="fast", search="never")
    there = pose.exp(rng.normal(size=6))
    seen = _in_frame(found, there, (0, 1))
    np.testing.assert_allclose(there @ seen.T_target_source, found.T_target_source, atol=1e-12)
    # The covariance about the source's own origin does not ask which frame the target is in.
    np.testing.assert_allclose(seen.covariance_in("source"), found.covariance_in("source"), rtol=1e-9, atol=1e-18)
    assert seen.settings["against"] == [0, 1]
