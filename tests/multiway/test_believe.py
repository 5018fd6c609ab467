from itertools import combinations

import numpy as np
import pytest

from dqreg.multiway.believe import Belief, believe
from dqreg.multiway.edges import Edge
from dqreg.multiway.loops import LIMIT
from dqreg.rigid import pose
from tests.multiway.edges_of_truth import edges_of, registration, world

SIGMA = 1e-3


def judged(edges: list[Edge], count: int, anchor: int = 0) -> Belief:
    return believe(edges, count, anchor, size=2.0, floor=0.0, T_anchor=np.eye(4))


def test_right_edges_are_used_and_their_loops_close() -> None:
    T = world(8, seed=0)
    belief = judged(edges_of(T, combinations(range(8), 2), SIGMA, seed=1), 8)
    assert all(edge.used for edge in belief.edges)
    # One loop in a thousand may miss: of 56, none or one.
    assert np.count_nonzero(belief.loops.fails) <= 1
    assert len(belief.loops.chi2) == 56
    np.testing.assert_allclose(belief.T_world_scan[:8], T, atol=10 * SIGMA)


@pytest.mark.parametrize("seed", range(2))
def test_a_third_of_wrong_edges_changes_nothing_beyond_the_covariance(seed: int) -> None:
    T = world(10, seed=seed)
    pairs = list(combinations(range(10), 2))
    wrong = frozenset(pairs[k] for k in np.random.default_rng(50 + seed).choice(len(pairs), 15, replace=False))
    clean = judged(edges_of(T, pairs, SIGMA, seed=seed), 10)
    belief = judged(edges_of(T, pairs, SIGMA, seed=seed, wrong=wrong), 10)
    assert {(e.target, e.source) for e in belief.edges if not e.used} >= wrong
    assert sum(edge.used for edge in belief.edges) >= len(pairs) - len(wrong) - 1
    apart = pose.log(belief.T_world_scan[1:10] @ pose.inverse(clean.T_world_scan[1:10]))
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
    belief = judged(with_suspect_edges(edges, 3, wrong=False), 4)
    assert [edge.code for edge in belief.edges if edge.source == 3] == ["confirmed"] * 3
    belief = judged(with_suspect_edges(edges, 3, wrong=True), 4)
    assert [edge.code for edge in belief.edges if edge.source == 3] == ["unconfirmed"] * 3
    assert np.isnan(belief.T_world_scan[3]).all()
    assert np.isfinite(belief.T_world_scan[:3]).all()


def test_islands_are_told_apart_and_the_anchors_is_placed() -> None:
    edges = edges_of(world(7, seed=5), [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5)], SIGMA, seed=6)
    belief = judged(edges, 7, anchor=3)
    assert np.flatnonzero(np.isfinite(belief.T_world_scan[:7, 0, 0])).tolist() == [3, 4, 5]
    assert [edge.code for edge in belief.edges] == ["elsewhere"] * 3 + ["used"] * 3
    assert len(set(belief.island.tolist())) == 3


def test_an_anchor_that_hangs_on_nothing_is_replaced() -> None:
    belief = judged(edges_of(world(4, seed=7), [(1, 2), (2, 3)], SIGMA, seed=8), 4, anchor=0)
    assert belief.anchor == 1
    np.testing.assert_allclose(belief.T_world_scan[1], np.eye(4), atol=1e-15)
    assert np.isnan(belief.T_world_scan[0]).all()


def test_the_limit_is_the_chi_square_that_one_in_a_thousand_exceeds() -> None:
    from scipy.stats import chi2

    assert chi2.sf(LIMIT, 6) == pytest.approx(1e-3, rel=1e-2)
