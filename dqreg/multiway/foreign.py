"""Scans of something else: those without which the others stand nowhere that a scanner looked through."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.believe import Belief, believe
from dqreg.multiway.edges import Edge, EdgeCode
from dqreg.multiway.pairs import Pair
from dqreg.multiway.sides import Sides
from dqreg.rigid import pose

# Scans that are left out for a trial, those first that most speaks against; and share of all that may be left out.
TRIED, MOST = 6, 0.5


@dataclasses.dataclass(frozen=True)
class Judge:
    """Judges edges by sides, free space, loops and the graph."""

    sides: Sides
    count: int  # Of scans
    home: int  # Node whose pose is held
    size: float
    floor: float
    T_home: FloatArray
    # Edges that contradict scans besides their own two, and how
    refuted: Mapping[Pair, EdgeCode] = dataclasses.field(default_factory=dict)

    def __call__(self, edges: Sequence[Edge]) -> Belief:
        """What is to be believed of edges, whatever was believed of them before."""
        fresh = [dataclasses.replace(edge, code="unconfirmed") if edge.found else edge for edge in edges]
        checked = [
            dataclasses.replace(edge, code=self.refuted[ends_of(edge)])
            if edge.found and ends_of(edge) in self.refuted
            else edge
            for edge in self.sides.checked(fresh)
        ]
        return believe(checked, self.count, self.home, self.size, self.floor, self.T_home)

    def without(self, edges: Iterable[Edge], code: EdgeCode) -> Judge:
        """The same judge, to whom some edges are refuted."""
        return dataclasses.replace(self, refuted={**self.refuted, **{ends_of(edge): code for edge in edges}})

    def contradictions(self, belief: Belief) -> FloatArray:
        """By how much free space speaks against each two scans, (n, n)."""
        return self.sides.free.contradictions(belief.T_world_scan[: self.count])


def without_foreign(judge: Judge, belief: Belief) -> tuple[Judge, Belief]:
    """The belief without the edges of scans that cannot stand where they were placed.

    A scan of something else bends those that its edges join, which then contradict the others too: each scan in
    question is left out for a trial, and that one stays out without which the least contradicts. Edges of it that put
    it where nothing speaks against it are taken back.
    """
    against = judge.contradictions(belief)
    for _ in range(int(MOST * judge.count)):
        pairs = _count(against)
        if not pairs:
            break
        trials: list[tuple[int, int, Judge, Belief, FloatArray]] = []
        for k in np.argsort(-against.sum(axis=1), kind="stable")[:TRIED].tolist():
            if not against[k].any() or (trials and min(trials, key=_cost)[0] == 0):
                break
            trial, rest, left = _left_out(judge, belief, k)
            if _count(left) < pairs:
                trials.append((_count(left) + _loss(belief, rest), -placed_of(rest), trial, rest, left))
        if not trials:
            break
        _, _, judge, belief, against = min(trials, key=_cost)
    return judge, belief


def _cost(trial: tuple[int, int, Judge, Belief, FloatArray]) -> tuple[int, int]:
    """Contradictions that remain and accepted pairs lost; then scans lost."""
    return trial[0], trial[1]


def _loss(before: Belief, after: Belief) -> int:
    """Accepted pairs that are used no longer: a scan of something else has few."""
    used = {ends_of(edge) for edge in after.edges if edge.used}
    return sum(edge.used and edge.level == "accepted" and ends_of(edge) not in used for edge in before.edges)


def edges_at(belief: Belief, k: int) -> list[Edge]:
    """Edges of a scan that have a pose."""
    return [edge for edge in belief.edges if edge.found and k in ends_of(edge)]


def _left_out(judge: Judge, belief: Belief, k: int) -> tuple[Judge, Belief, FloatArray]:
    """Judge, belief and contradictions without the edges of a scan, but for those that nothing speaks against."""
    own = [edge for edge in edges_at(belief, k) if ends_of(edge) not in judge.refuted]
    without = judge.without(own, "looked_through")
    rest = without(belief.edges)
    against = without.contradictions(rest)
    wrong = [edge for edge in own if not _fits(judge, rest, edge, k)]
    if len(wrong) < len(own):
        fewer = judge.without(wrong, "looked_through")
        again = fewer(belief.edges)
        more = fewer.contradictions(again)
        if _count(more) <= _count(against):
            return fewer, again, more
    return without, rest, against


def _fits(judge: Judge, rest: Belief, edge: Edge, k: int) -> bool:
    """Whether an edge puts a scan where nothing speaks against it."""
    T = rest.T_world_scan[: judge.count].copy()
    other = edge.source if edge.target == k else edge.target
    T_other = rest.T_world_scan[other]
    if not np.isfinite(T_other).all():
        return False
    T_edge = edge.registration.T_target_source
    T[k] = T_other @ (pose.inverse(T_edge) if edge.target == k else T_edge)
    return not judge.sides.free.contradictions_of(k, T).any()


def ends_of(edge: Edge) -> Pair:
    """Target and source of an edge."""
    return edge.target, edge.source


def _count(against: FloatArray) -> int:
    return int(np.count_nonzero(np.triu(against, 1)))


def placed_of(belief: Belief) -> int:
    """How many scans have a pose."""
    return int(np.isfinite(belief.T_world_scan[:-1]).all(axis=(1, 2)).sum())
