import dataclasses
from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.multiway.pose_graph.edges import Edge, EdgeCode
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection, select_edges
from dqreg.multiway.unplaced_scans import unplaced
from dqreg.multiway.verdict import judge_scans
from dqreg.rigid import pose
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of, registration, world

SIGMA = 1e-3
SIX = np.vstack([np.eye(3), -np.eye(3)])


def judged(
    edges: list[Edge], count: int, anchor: int = 0, homes: Mapping[int, FloatArray] | None = None
) -> EdgeSelection:
    return select_edges(edges, count, anchor, size=2.0, floor=0.0, homes=homes or {})


def test_right_edges_are_used_and_their_loops_close() -> None:
    T = world(8, seed=0)
    selection = judged(edges_of(T, combinations(range(8), 2), SIGMA, seed=1), 8)
    assert all(edge.used for edge in selection.edges)
    # One loop in a thousand may miss: of 56, none or one.
    assert np.count_nonzero(selection.loops.fails) <= 1
    assert len(selection.loops.chi2) == 56
    np.testing.assert_allclose(selection.T_world_scan[:8], T, atol=10 * SIGMA)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_a_third_of_wrong_edges_changes_nothing_beyond_the_covariance(seed: int) -> None:
    T = world(10, seed=seed)
    pairs = list(combinations(range(10), 2))
    wrong = frozenset(pairs[k] for k in np.random.default_rng(50 + seed).choice(len(pairs), 15, replace=False))
    clean = judged(edges_of(T, pairs, SIGMA, seed=seed), 10)
    selection = judged(edges_of(T, pairs, SIGMA, seed=seed, wrong=wrong), 10)
    assert {(e.target, e.source) for e in selection.edges if not e.used} >= wrong
    assert sum(edge.used for edge in selection.edges) >= len(pairs) - len(wrong) - 1
    apart = pose.log(selection.T_world_scan[1:10] @ pose.inverse(clean.T_world_scan[1:10]))
    assert np.abs(apart).max() < 3 * SIGMA


def with_suspect_edges(edges: list[Edge], scan: int, *, wrong: bool) -> list[Edge]:
    rng, found = np.random.default_rng(0), []
    for edge in edges:
        old = edge.registration
        if edge.source == scan:
            T, centre = old.T_target_source, np.array(old.settings["centre"])
            T = pose.random(rng, reach=1.0) if wrong else T
            edge = Edge(edge.target, edge.source, registration(T, old.covariance, centre, "suspect"))
        found.append(edge)
    return found


def test_a_suspect_edge_is_used_only_where_loops_confirm_it() -> None:
    edges = edges_of(world(4, seed=3), combinations(range(4), 2), SIGMA, seed=4)
    selection = judged(with_suspect_edges(edges, 3, wrong=False), 4)
    assert [edge.code for edge in selection.edges if edge.source == 3] == ["confirmed"] * 3
    selection = judged(with_suspect_edges(edges, 3, wrong=True), 4)
    assert [edge.code for edge in selection.edges if edge.source == 3] == ["unconfirmed"] * 3
    assert np.isnan(selection.T_world_scan[3]).all()
    assert np.isfinite(selection.T_world_scan[:3]).all()


def test_islands_are_told_apart_and_the_anchors_is_placed() -> None:
    edges = edges_of(world(7, seed=5), [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5)], SIGMA, seed=6)
    selection = judged(edges, 7, anchor=3)
    assert np.flatnonzero(np.isfinite(selection.T_world_scan[:7, 0, 0])).tolist() == [3, 4, 5]
    assert [edge.code for edge in selection.edges] == ["elsewhere"] * 3 + ["used"] * 3
    assert len(set(selection.island.tolist())) == 3


def doubted(edge: Edge, confidence: float, code: Code = "weakly_constrained", *, wrong: bool = False) -> Edge:
    """The edge, suspect with a confidence for one reason; a wrong one puts its scan upside down."""
    old = edge.registration
    upside_down = pose.exp(np.r_[np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])
    T = old.T_target_source @ upside_down if wrong else old.T_target_source
    verdict = Verdict("suspect", (Reason("made by hand", code),), confidence=confidence)
    return dataclasses.replace(edge, registration=dataclasses.replace(old, T_target_source=T, verdict=verdict))


# Both sides of a plate, four views each, and pairs across its edge.
SIDE_BY_SIDE = [*combinations(range(4), 2), *combinations(range(4, 8), 2)]


@pytest.mark.parametrize(
    ("code", "right", "wrong", "joined"),
    [
        ("weakly_constrained", (0.5, 0.5), (), True),
        ("weakly_constrained", (0.5,), (), False),  # Nothing agrees with it
        ("weakly_constrained", (0.5, 0.5), (0.2, 0.2), True),
        ("weakly_constrained", (0.5, 0.5), (0.4, 0.4), False),  # Nobody can tell
        ("faces_apart", (0.5, 0.5), (), False),  # Something speaks against where the scans stand
    ],
)
def test_doubted_edges_that_agree_join_islands(
    code: Code, right: tuple[float, ...], wrong: tuple[float, ...], joined: bool
) -> None:
    T = world(8, seed=9)
    edges = edges_of(T, [*SIDE_BY_SIDE, (3, 4), (0, 7), (2, 4), (1, 7)], SIGMA, seed=10)
    sure, across = edges[: len(SIDE_BY_SIDE)], edges[len(SIDE_BY_SIDE) :]
    bridges = [doubted(edge, sureness, code) for edge, sureness in zip(across[:2], right, strict=False)]
    rivals = [doubted(edge, sureness, code, wrong=True) for edge, sureness in zip(across[2:], wrong, strict=False)]
    selection = judged([*sure, *bridges, *rivals], 8)
    assert np.isfinite(selection.T_world_scan[:8]).all() == joined
    assert not any(edge.used for edge in selection.edges[len(sure) + len(bridges) :])
    if joined:
        np.testing.assert_allclose(selection.T_world_scan[:8], T, atol=20 * SIGMA)


@pytest.mark.parametrize(
    ("confidence", "level", "unanimous"),
    [(0.3, "suspect", True), (0.9, "suspect", False), (0.3, "accepted", False), (None, "", True)],
)
def test_pairs_agree_where_surer_ones_outweigh_what_is_left_out(
    confidence: float | None, level: str, unanimous: bool
) -> None:
    edges = edges_of(world(4, seed=3), combinations(range(4), 2), SIGMA, seed=4)
    edges = [
        dataclasses.replace(
            edge, registration=dataclasses.replace(edge.registration, verdict=verdict_of("accepted", 0.5))
        )
        for edge in edges
    ]
    if confidence is not None:
        edges[-1] = doubted(edges[-1], confidence, wrong=True)
        verdict = verdict_of(level, confidence)
        edges[-1] = dataclasses.replace(
            edges[-1], registration=dataclasses.replace(edges[-1].registration, verdict=verdict)
        )
    selection = judged(edges, 4)
    assert selection.edges[-1].used == (confidence is None)
    assert selection.is_unanimous == unanimous


def verdict_of(level: str, confidence: float) -> Verdict:
    code: Code = "accepted" if level == "accepted" else "weakly_constrained"
    return Verdict(level, (Reason("made by hand", code),), confidence=confidence)


def test_an_anchor_that_hangs_on_nothing_is_replaced() -> None:
    selection = judged(edges_of(world(4, seed=7), [(1, 2), (2, 3)], SIGMA, seed=8), 4, anchor=0)
    assert selection.anchor == 1
    np.testing.assert_allclose(selection.T_world_scan[1], np.eye(4), atol=1e-15)
    assert np.isnan(selection.T_world_scan[0]).all()


def test_the_world_is_that_of_the_starts_where_the_anchor_is_replaced() -> None:
    T = pose.exp(np.r_[0.3, 0.2, 0.1, 4.0, 5.0, 6.0]) @ world(4, seed=7)
    edges = edges_of(T, [(1, 2), (2, 3)], SIGMA, seed=8)
    selection = judged(edges, 4, 0, dict(enumerate(T)))
    np.testing.assert_allclose(selection.T_world_scan[1:4], T[1:], atol=10 * SIGMA)
    # The first one without a start says nothing of their world.
    selection = judged(edges, 4, 0, {0: T[0], 3: T[3]})
    assert selection.anchor == 3
    np.testing.assert_allclose(selection.T_world_scan[1:4], T[1:], atol=10 * SIGMA)


def test_the_limit_is_the_chi_square_that_one_in_a_thousand_exceeds() -> None:
    from scipy.stats import chi2

    assert chi2.sf(CHI2_LIMIT, 6) == pytest.approx(1e-3, rel=1e-2)


def ring(count: int, reach: int) -> list[tuple[int, int]]:
    """Pairs of a ring, each scan with so many neighbours to either side."""
    return sorted(
        {(min(i, j), max(i, j)) for i in range(count) for j in ((i + d) % count for d in range(1, reach + 1))}
    )


@pytest.mark.parametrize(
    ("count", "reach", "seed"),
    [*(pytest.param(*case, marks=pytest.mark.soak) for case in ((20, 2, 0), (24, 3, 2))), (24, 3, 1), (12, 5, 3)],
)
def test_what_confirmed_edges_hold_together_is_right_however_dense_the_graph(count: int, reach: int, seed: int) -> None:
    # The truth is what the edges were made of; errors are drawn from their covariances.
    T, pairs, rng = world(count, seed), ring(count, reach), np.random.default_rng(seed)
    wrong = frozenset(pairs[k] for k in rng.choice(len(pairs), round(0.3 * len(pairs)), replace=False))
    selection = judged(edges_of(T, pairs, SIGMA, seed=seed, wrong=wrong), count)
    sure = {(selection.edges[row].target, selection.edges[row].source) for row in selection.rows[selection.confirmed]}
    assert not sure & wrong
    placed = set(np.flatnonzero(np.isfinite(selection.T_world_scan[:count, 0, 0])).tolist())
    for i, j in sorted(pair for pair in sure if placed >= set(pair)):
        relative = pose.inverse(selection.T_world_scan[i]) @ selection.T_world_scan[j]
        apart = pose.log(relative @ pose.inverse(pose.inverse(T[i]) @ T[j]))
        # Centres of the edges lie some units away: a few standard deviations with their lever.
        assert np.abs(apart).max() < 20 * SIGMA
    # Both ends of what is wrong and used hang on nothing else: the verdict has a reason.
    used = {(edge.target, edge.source) for edge in selection.edges if edge.used}
    told = {reason.code for reason in judge_edges(selection, count).reasons}
    assert not used & wrong or "unconfirmed_edge" in told


def judge_edges(selection: EdgeSelection, count: int) -> Verdict:
    views = [View(str(k)) for k in range(count)]
    covariances = np.zeros((count, 6, 6))
    return judge_scans(views, selection, selection.T_world_scan[:count], covariances, 2.0, converged=True, stopped="")


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("others", [2, 3])
def test_a_scan_that_as_many_accepted_pairs_put_to_another_place_is_not_accepted(seed: int, others: int) -> None:
    """Which two of four are wrong nobody can tell; of the first seed the wrong ones are used, of the second the right.

    A third right one tells.
    """
    count = 3 + others
    T, pairs, aside = world(count, seed), list(combinations(range(count), 2)), pose.exp(np.r_[0.5, 0.2, -0.3, 1, 0, 0])
    edges = edges_of(T, pairs, SIGMA, seed + 1)
    for row, (i, j) in enumerate(pairs):
        if j == count - 1 and i < 2:
            measured = pose.inverse(T[i]) @ aside @ T[j]
            edges[row] = Edge(i, j, registration(measured, edges[row].registration.covariance, np.zeros(3)))
    selection = judged(edges, count)
    verdict, last = judge_edges(selection, count), selection.T_world_scan[count - 1]
    assert (np.linalg.norm(last - T[-1]) < 0.1) == (others == 3 or seed == 1)
    assert verdict.level == ("suspect" if others == 2 else "accepted")
    if others == 2:
        assert verdict.codes == ("alternative_poses", "contradicting_edge")
        assert verdict.reasons[0].startswith(f"{count - 1}: ")


def test_scans_that_hang_on_a_single_edge_are_not_accepted() -> None:
    pairs = [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5)]
    for wrong in (frozenset[tuple[int, int]](), frozenset({(2, 3)})):
        selection = judged(edges_of(world(6, seed=9), [*pairs, (2, 3)], SIGMA, seed=9, wrong=wrong), 6)
        verdict = judge_edges(selection, 6)
        assert verdict.level == "suspect"
        assert verdict.codes == ("unconfirmed_edge",)
        assert "2 - 3" in verdict.reasons[0]
    selection = judged(edges_of(world(6, seed=9), [*pairs, (2, 3), (1, 4)], SIGMA, seed=9), 6)
    assert judge_edges(selection, 6).level == "accepted"


def test_scans_that_only_doubted_pairs_join_are_not_accepted() -> None:
    # Both sides of a sheet on each other from every side: such pairs confirm each other.
    edges = edges_of(world(4, seed=3), combinations(range(4), 2), SIGMA, seed=4)
    selection = judged(with_suspect_edges(edges, 3, wrong=False), 4)
    assert np.isfinite(selection.T_world_scan[3]).all()
    told = judge_edges(selection, 4)
    assert told.level == "suspect"
    assert "unconfirmed_edge" in told.codes
    assert judge_edges(judged(edges, 4), 4).level == "accepted"


@pytest.mark.parametrize("wrong", [frozenset[tuple[int, int]](), frozenset({(2, 3)}), frozenset({(2, 3), (1, 4)})])
def test_of_two_threads_that_contradict_each_other_none_is_used(wrong: frozenset[tuple[int, int]]) -> None:
    pairs = [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5)]
    selection = judged(edges_of(world(6, seed=9), [*pairs, (2, 3), (1, 4)], SIGMA, seed=9, wrong=wrong), 6)
    placed = np.flatnonzero(np.isfinite(selection.T_world_scan[:6, 0, 0])).tolist()
    # Two right ones make a loop; of a right and a wrong one, or of two wrong ones, nobody can tell which is which.
    assert placed == ([0, 1, 2] if wrong else list(range(6)))
    told = judge_edges(selection, 6)
    assert told.level == ("suspect" if wrong else "accepted")
    assert ("islands" in told.codes) == bool(wrong)


def test_a_loop_longer_than_three_confirms_its_edges() -> None:
    edges = edges_of(world(6, seed=2), ring(6, 1), SIGMA, seed=2)
    assert judged(edges, 6).confirmed.all()
    edges = edges_of(world(6, seed=2), ring(6, 1), SIGMA, seed=2, wrong=frozenset({(2, 3)}))
    assert not judged(edges, 6).confirmed.any()


def test_an_edge_to_the_part_outweighs_one_between_two_scans() -> None:
    T = world(4, seed=5)
    nodes = np.concatenate([T, np.eye(4)[None]])
    edges = edges_of(nodes, [(-1, 0), (-1, 1), (-1, 2), (0, 1), (0, 2), (1, 2)], SIGMA, seed=6)
    # A right edge to the part and a wrong, much sharper one to a scan are all that hold the last scan.
    edges += edges_of(nodes, [(-1, 3)], SIGMA, seed=7)
    edges += edges_of(nodes, [(1, 3)], 0.1 * SIGMA, seed=8, wrong=frozenset({(1, 3)}))
    selection = judged(edges, 4, anchor=-1)
    assert [edge.code for edge in selection.edges if edge.source == 3] == ["used", "contradicts"]
    np.testing.assert_allclose(selection.T_world_scan[:4], T, atol=10 * SIGMA)


def verdict_of_shapes(
    doubted: list[tuple[int, int]], left_out: tuple[tuple[int, int], ...] = (), off: float = 0.02
) -> Verdict:
    """Of four scans, some of whose pairs are stretched; those left out come so far off the others."""
    edges = []
    for edge in edges_of(world(4, seed=3), combinations(range(4), 2), SIGMA, seed=4):
        stretched = Verdict("suspect", (Reason("made by hand", "stretched"),))
        is_doubted = (edge.target, edge.source) in doubted
        result = dataclasses.replace(edge.registration, verdict=stretched) if is_doubted else edge.registration
        if (edge.target, edge.source) in left_out:
            away = pose.exp(np.r_[np.zeros(3), off, 0.0, 0.0])
            result = dataclasses.replace(result, T_target_source=away @ result.T_target_source)
            edges.append(dataclasses.replace(edge, registration=result, code="contradicts"))
            continue
        edges.append(dataclasses.replace(edge, registration=result, used=True, code="used"))
    selection = dataclasses.replace(judged(edges, 4), edges=tuple(edges))
    views = [View(str(k), PointCloud(np.eye(3))) for k in range(4)]
    return judge_scans(
        views,
        selection,
        selection.T_world_scan[:4],
        np.tile(1e-8 * np.eye(6), (4, 1, 1)),
        2.0,
        converged=True,
        stopped="",
    )


def test_a_scan_that_its_pairs_call_stretched_is_doubted() -> None:
    assert "deformed_scan" not in verdict_of_shapes([]).codes
    # Of one pair nobody knows which scan it is.
    assert "deformed_scan" not in verdict_of_shapes([(0, 2), (1, 3)]).codes
    verdict = verdict_of_shapes([(0, 2), (2, 3)])
    assert verdict.level == "suspect"
    (words,) = [reason for reason in verdict.reasons if reason.code == "deformed_scan"]
    assert words[:18] == "2 (2 of 3 pairs): "


def test_pairs_left_out_that_come_near_tell_of_a_bent_scan_too() -> None:
    verdict = verdict_of_shapes([(0, 2)], left_out=((0, 2), (2, 3)))
    (words,) = [reason for reason in verdict.reasons if reason.code == "deformed_scan"]
    assert words[:18] == "2 (2 of 3 pairs): "
    # Elsewhere they tell of the pairs, and without one that is bent of nothing.
    assert "deformed_scan" not in verdict_of_shapes([(0, 2)], left_out=((0, 2), (2, 3)), off=0.5).codes
    assert "deformed_scan" not in verdict_of_shapes([], left_out=((0, 2), (2, 3))).codes


def test_what_is_doubted_of_all_scans_stands_first() -> None:
    edges = edges_of(world(4, seed=3), combinations(range(4), 2), SIGMA, seed=4)
    views, selection = [View(str(k), PointCloud(np.eye(3))) for k in range(4)], judged(edges, 4)
    covariances, still = np.tile(1e-8 * np.eye(6), (4, 1, 1)), Reason("it stands still", "unmoved_scans")
    told = {"converged": True, "stopped": "", "doubts": [still]}
    verdict = judge_scans(views, selection, selection.T_world_scan[:4], covariances, 2.0, **told)
    assert (verdict.level, verdict.codes) == ("suspect", ("unmoved_scans",))


def told_of_scan_4(codes: dict[tuple[int, int], EdgeCode]) -> str:
    """Why the fifth scan is joined to no other, where some of its pairs were left out so, and all are loose."""
    loose = Verdict("suspect", (Reason("made by hand", "unconstrained"),))
    edges = []
    for edge in edges_of(world(5, seed=3), combinations(range(5), 2), SIGMA, seed=4):
        if edge.source == 4:
            code = codes.get((edge.target, edge.source), "unconfirmed")
            result = dataclasses.replace(edge.registration, verdict=loose)
            edges.append(dataclasses.replace(edge, registration=result, code=code))
        else:
            edges.append(dataclasses.replace(edge, used=True, code="used"))
    selection = dataclasses.replace(judged(edges, 5), edges=tuple(edges))
    (reason,) = unplaced([View(str(k), PointCloud(SIX)) for k in range(5)], selection, range(4))
    return reason


def test_a_scan_is_not_told_the_reason_of_another_one() -> None:
    assert "another object, moved" in told_of_scan_4({(k, 4): "misfit" for k in range(4)})
    assert "4 of its 4 pairs leave a motion nearly free" in told_of_scan_4({})
    # The one pair was left out with the other scan.
    assert "3 of its 4 pairs leave a motion nearly free" in told_of_scan_4({(0, 4): "misfit"})
