"""Which edges closing loops confirm: graphs made by hand, whose right and wrong edges are known."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pytest

from dqreg._arrays import BoolArray
from dqreg.multiway.pose_graph.edges import graph_of
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.pose_graph.loop_confirmation import (
    ACCEPTED_ON_PART_TRUST,
    ACCEPTED_TRUST,
    MAX_RIVAL_CONFIDENCE_SHARE,
    SUSPECT_TRUST,
    Confirmation,
    confirm,
    islands,
    joined_by,
    trust_of,
)
from dqreg.multiway.pose_graph.loops import Loops, covariances_of, find_loops
from dqreg.rigid import pose
from tests.multiway.edges_of_truth import edges_of, registration, world

Pair = tuple[int, int]
SIGMA, SIZE = 1e-3, 2.0


class Made:
    """Edges between scans on a ring, in the order that they are named in; some measure a random pose."""

    def __init__(
        self,
        count: int,
        pairs: Iterable[Pair],
        *,
        wrong: Iterable[Pair] = (),
        suspect: Iterable[Pair] = (),
        held: Iterable[Pair] = (),
        seed: int = 0,
    ) -> None:
        self.pairs, self.wrong = list(pairs), frozenset(wrong)
        self.T = world(count, seed)
        self.edges = edges_of(self.T, self.pairs, SIGMA, seed + 1, self.wrong)
        self.suspect, self.held = set(suspect), set(held)
        self.count, self.sure = count, np.ones(len(self.pairs))

    def of(self, pairs: Iterable[Pair]) -> BoolArray:
        chosen = set(pairs)
        return np.array([pair in chosen for pair in self.pairs])

    def loops(self, graph: PoseGraph) -> Loops:
        return find_loops(graph, SIZE, 0.0)

    def confirmed(self, size: float = SIZE) -> Confirmation:
        graph = graph_of(self.edges, self.count)
        covariances = covariances_of(graph, size, 0.0)
        loops = find_loops(graph, size, 0.0)
        return confirm(graph, covariances, loops, ~self.of(self.suspect), size, self.sure, self.of(self.held))

    def names(self, rows: BoolArray) -> set[Pair]:
        return {pair for pair, told in zip(self.pairs, rows, strict=True) if told}


def test_a_triangle_that_closes_confirms_its_three_edges() -> None:
    found = Made(3, combinations(range(3), 2)).confirmed()
    assert found.confirmed.all()
    assert not found.refuted.any()
    # A closing loop of accepted edges is more than each of them says alone.
    assert (found.trust > ACCEPTED_TRUST).all()


@pytest.mark.parametrize("wrong", list(combinations(range(3), 2)))
def test_a_triangle_that_does_not_close_confirms_none_and_says_not_which_is_wrong(wrong: Pair) -> None:
    found = Made(3, combinations(range(3), 2), wrong=[wrong]).confirmed()
    assert not found.confirmed.any()
    assert not found.refuted.any()
    assert (found.trust < ACCEPTED_TRUST).all()


@pytest.mark.parametrize("wrong", [(0, 1), (1, 3), (0, 3)])
def test_one_wrong_edge_of_all_between_four_is_refuted_and_the_others_are_confirmed(wrong: Pair) -> None:
    made = Made(4, combinations(range(4), 2), wrong=[wrong])
    found = made.confirmed()
    assert made.names(found.refuted) == {wrong}
    assert made.names(found.confirmed) == set(made.pairs) - {wrong}
    assert found.trust[made.of([wrong])].max() < found.trust[~made.of([wrong])].min()


def test_an_edge_round_which_no_loop_goes_is_neither() -> None:
    made = Made(7, [*combinations(range(3), 2), (2, 3), *combinations(range(3, 6), 2), (5, 6)])
    found = made.confirmed()
    assert made.names(found.confirmed) == {*combinations(range(3), 2), *combinations(range(3, 6), 2)}
    assert not found.refuted.any()
    np.testing.assert_array_equal(found.trust[made.of([(2, 3), (5, 6)])], ACCEPTED_TRUST)


@pytest.mark.parametrize("count", [4, 6, 9])
def test_a_ring_without_triangles_is_confirmed_by_going_round_it(count: int) -> None:
    ring = [(k, (k + 1) % count) for k in range(count)]
    assert Made(count, ring).confirmed().confirmed.all()
    # Of one that does not close, any edge may be the wrong one.
    found = Made(count, ring, wrong=[ring[1]]).confirmed()
    assert not found.confirmed.any()
    assert not found.refuted.any()


def test_two_wrong_edges_that_agree_with_each_other_do_not_outvote_the_right_ones() -> None:
    """Both put the last scan to the same wrong place, and with the edge between the two others they close a loop."""
    made = Made(5, combinations(range(5), 2), seed=3)
    aside = pose.exp(np.array([0.5, 0.2, -0.3, 1.0, 0.5, -0.4]))
    liars = [(0, 4), (1, 4)]
    for row, (i, j) in enumerate(made.pairs):
        if (i, j) in liars:
            one = made.edges[row].registration
            T = pose.inverse(made.T[i]) @ aside @ made.T[j]
            made.edges[row] = type(made.edges[row])(i, j, registration(T, one.covariance, np.zeros(3)))
    loops = made.loops(graph_of(made.edges, 5))
    closing = {tuple(nodes) for nodes in loops.nodes[loops.closes].tolist()}
    assert (0, 1, 4) in closing
    found = made.confirmed()
    # The last scan has two on either side; the three others hold each other.
    right = set(combinations(range(4), 2))
    assert right <= made.names(found.confirmed)
    told = found.trust[made.of(liars)], found.trust[made.of([(2, 4), (3, 4)])]
    assert max(told[0].max(), told[1].max()) < found.trust[made.of(right)].min()
    # Which of the two pairs is wrong no loop tells; that it is not told is for the verdict to say.
    assert not found.refuted.any()
    # With a third witness against them they are outvoted.
    made = Made(6, combinations(range(6), 2), wrong=liars, seed=4)
    found = made.confirmed()
    assert made.names(found.refuted) == set(liars)
    assert made.names(found.confirmed) == set(made.pairs) - set(liars)


def test_a_suspect_edge_needs_a_loop_of_confirmed_ones() -> None:
    triangle, doubted = list(combinations(range(3), 2)), [(1, 3), (2, 3)]
    made = Made(4, [*triangle, *doubted], suspect=doubted)
    # Two suspect edges lead to the last scan: they confirm each other by no loop of confirmed ones.
    assert made.names(made.confirmed().confirmed) >= set(triangle)
    square = [(0, 1), (1, 2), (2, 3), (0, 3)]
    for suspect, expected in (([], True), ([(0, 3)], False)):
        made = Made(4, square, suspect=suspect)
        assert (made.names(made.confirmed().confirmed) == set(square)) == expected
    made = Made(4, [*square, (0, 2)], suspect=[(0, 3)])
    assert made.names(made.confirmed().confirmed) == {*square, (0, 2)}


def bridged(*, wrong: Iterable[Pair] = (), held: Iterable[Pair], rival: float = 1.0, seed: int = 5) -> Made:
    """Two islands of three scans each, and suspect edges between them."""
    within, across = [*combinations(range(3), 2), *combinations(range(3, 6), 2)], [(0, 3), (1, 4), (2, 5)]
    made = Made(6, [*within, *across], wrong=wrong, suspect=across, held=held, seed=seed)
    made.sure[made.of(wrong)] = rival
    return made


def test_doubted_edges_that_agree_are_a_bridge_between_islands() -> None:
    across = [(0, 3), (1, 4), (2, 5)]
    assert bridged(held=across).confirmed().confirmed.all()
    # Those whose verdict says more than that little holds them are none.
    made = bridged(held=[])
    assert not made.names(made.confirmed().confirmed) & set(across)
    # One alone may be wrong by chance.
    made = bridged(held=across, wrong=across[1:])
    assert not made.names(made.confirmed().confirmed) & set(across)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_bridge_is_weighed_against_what_says_something_else(share: float) -> None:
    across, wrong = [(0, 3), (1, 4), (2, 5)], [(2, 5)]
    made = bridged(held=across, wrong=wrong, rival=share * 2.0 * MAX_RIVAL_CONFIDENCE_SHARE)
    found = made.confirmed()
    assert made.names(found.confirmed) & set(across) == (set(across[:2]) if share < 1.0 else set())
    assert made.names(found.refuted) == (set(wrong) if share < 1.0 else set())


def test_the_order_of_the_edges_and_the_way_they_are_gone_do_not_matter() -> None:
    pairs, wrong = [*combinations(range(5), 2), (4, 5)], [(1, 3)]
    made = Made(6, pairs, wrong=wrong)
    expected = made.confirmed()
    rng = np.random.default_rng(0)
    order = rng.permutation(len(pairs))
    other = Made(6, pairs, wrong=wrong)
    other.pairs, other.edges = [made.pairs[k] for k in order], [made.edges[k] for k in order]
    found = other.confirmed()
    np.testing.assert_array_equal(found.confirmed, expected.confirmed[order])
    np.testing.assert_array_equal(found.refuted, expected.refuted[order])
    np.testing.assert_allclose(found.trust, expected.trust[order], rtol=1e-12)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_unit_changes_nothing(unit: float) -> None:
    made = Made(6, [*combinations(range(5), 2), (4, 5)], wrong=[(1, 3)])
    expected = made.confirmed()
    for row, edge in enumerate(made.edges):
        T = edge.registration.T_target_source.copy()
        T[:3, 3] *= unit
        scale = np.repeat([1.0, unit], 3)
        covariance = edge.registration.covariance * scale[:, None] * scale
        centre = unit * np.array(edge.registration.settings["centre"])
        made.edges[row] = type(edge)(edge.target, edge.source, registration(T, covariance, centre))
    found = made.confirmed(size=unit * SIZE)
    np.testing.assert_array_equal(found.confirmed, expected.confirmed)
    np.testing.assert_array_equal(found.refuted, expected.refuted)
    np.testing.assert_allclose(found.trust, expected.trust, rtol=1e-12)


def test_without_loops_trust_is_what_the_registration_says() -> None:
    made = Made(3, [(0, 1), (1, 2)])
    loops = made.loops(graph_of(made.edges, 3))
    accepted, on_part = np.array([True, True, False, False]), np.array([False, True, False, True])
    expected = [ACCEPTED_TRUST, ACCEPTED_ON_PART_TRUST, SUSPECT_TRUST, SUSPECT_TRUST]
    np.testing.assert_array_equal(trust_of(loops, accepted, on_part), expected)


def test_more_edges_may_be_confirmed_and_none_is_both() -> None:
    given = Confirmation(np.array([0.1, 0.9, 0.2]), np.array([False, True, False]), np.array([True, False, True]))
    more = given.also(np.array([True, True, False]))
    np.testing.assert_array_equal(more.confirmed, [True, True, False])
    np.testing.assert_array_equal(more.refuted, [False, False, True])
    np.testing.assert_array_equal(more.trust, [ACCEPTED_TRUST, 0.9, 0.2])


def test_islands_and_the_edges_that_join_them() -> None:
    made = Made(6, [(0, 1), (1, 2), (0, 2), (3, 4), (2, 3)])
    graph = graph_of(made.edges, 6)
    labels = islands(graph, np.array([0, 1, 3]))
    assert labels[0] == labels[1] == labels[2] != labels[3] == labels[4] != labels[5]
    assert len(set(islands(graph, np.zeros(0, dtype=np.int64)).tolist())) == graph.count
    # A tree of the first ones that join something.
    np.testing.assert_array_equal(joined_by(graph, np.arange(5)), [0, 1, 3, 4])
    np.testing.assert_array_equal(joined_by(graph, np.array([2, 4, 1, 0, 3])), [2, 4, 1, 3])
