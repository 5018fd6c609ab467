"""Scans of something else: those without which the others stand nowhere that a scanner looked through.

Where nothing was looked through, scans that no accepted pair holds are tested against all others together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DqregError
from dqreg.multiway.pairwise.pairs import Pair
from dqreg.multiway.pose_graph.edges import Edge, EdgeCode
from dqreg.multiway.pose_graph.motion_prior import MotionPrior
from dqreg.multiway.scans.merge import merged_target
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection, select_edges
from dqreg.multiway.visibility.passed_rays import MAX_PASSED_SHARE
from dqreg.multiway.visibility.sides import Sides
from dqreg.registration.options.options import Effort
from dqreg.registration.register import register
from dqreg.rigid import pose
from dqreg.trust.code_sets import SETTLED_BY_AGREEMENT, SETTLED_BY_TABLE, WEAKLY_CONSTRAINED

# Scans that are left out for a trial, those first that most speaks against; and share of all that may be left out.
MAX_TRIALS, MAX_LEFT_OUT_SHARE = 6, 0.5
# Scans that are put to the test against all others together, those that the others stand without, and scans that make
# a test.
MAX_TESTED_SCANS, MIN_SCANS_OF_TEST = 8, 3
# Motion, in sizes of a scan, by which a pose may differ from that of its pairs.
MAX_MOTION_SIZES = 0.05


Key = tuple[int, int, bytes]


@dataclasses.dataclass(frozen=True)
class Judge:
    """Judges edges by sides, free space, loops and the graph."""

    sides: Sides
    count: int  # Of scans
    home: int  # Node whose pose is held
    size: float
    floor: float
    homes: Mapping[int, FloatArray]  # Poses that are known; of the one held, if there, it is kept
    steps: MotionPrior | None = None  # Of a turntable, or starts
    # Edges that contradict scans besides their own two, and how
    refuted: Mapping[Key, EdgeCode] = dataclasses.field(default_factory=dict)

    def __call__(self, edges: Sequence[Edge]) -> EdgeSelection:
        """What is to be believed of edges, whatever was believed of them before."""
        fresh = [dataclasses.replace(edge, code="unconfirmed") if edge.found else edge for edge in edges]
        checked = [
            dataclasses.replace(edge, code=self.refuted[key_of(edge)])
            if edge.found and key_of(edge) in self.refuted
            else edge
            for edge in self.sides.checked(fresh)
        ]
        return select_edges(checked, self.count, self.home, self.size, self.floor, self.homes, self.steps)

    def without(self, edges: Iterable[Edge], code: EdgeCode) -> Judge:
        """The same judge, to whom some edges are refuted."""
        return dataclasses.replace(self, refuted={**self.refuted, **{key_of(edge): code for edge in edges}})

    def contradictions(self, selection: EdgeSelection) -> FloatArray:
        """By how much free space speaks against each two scans, (n, n)."""
        return self.sides.free.contradictions(selection.T_world_scan[: self.count])


def without_contradicting_scans(judge: Judge, selection: EdgeSelection) -> tuple[Judge, EdgeSelection]:
    """The selection without the edges of scans that cannot stand where they were placed.

    A scan of something else bends those that its edges join, which then contradict the others too: each scan in
    question is left out for a trial, and that one stays out without which the least contradicts. Edges of it that put
    it where nothing speaks against it are taken back.
    """
    against = judge.contradictions(selection)
    for _ in range(int(MAX_LEFT_OUT_SHARE * judge.count)):
        pairs = _count(against)
        if not pairs:
            break
        trials: list[tuple[int, int, Judge, EdgeSelection, FloatArray]] = []
        for k in np.argsort(-against.sum(axis=1), kind="stable")[:MAX_TRIALS].tolist():
            if not against[k].any() or (trials and min(trials, key=_cost)[0] == 0):
                break
            trial, rest, left = _left_out(judge, selection, k)
            if _count(left) < pairs:
                trials.append((_count(left) + _loss(selection, rest), -placed_of(rest), trial, rest, left))
        if not trials:
            break
        _, _, judge, selection, against = min(trials, key=_cost)
    return judge, selection


def _cost(trial: tuple[int, int, Judge, EdgeSelection, FloatArray]) -> tuple[int, int]:
    """Contradictions that remain and accepted pairs lost; then scans lost."""
    return trial[0], trial[1]


def _loss(before: EdgeSelection, after: EdgeSelection) -> int:
    """Accepted pairs that are used no longer: a scan of something else has few."""
    used = {_ends_of(edge) for edge in after.edges if edge.used}
    return sum(edge.used and edge.level == "accepted" and _ends_of(edge) not in used for edge in before.edges)


def _edges_at(selection: EdgeSelection, k: int) -> list[Edge]:
    """Edges of a scan that have a pose."""
    return [edge for edge in selection.edges if edge.found and k in _ends_of(edge)]


def _left_out(judge: Judge, selection: EdgeSelection, k: int) -> tuple[Judge, EdgeSelection, FloatArray]:
    """Judge, selection and contradictions without the edges of a scan, but for those that nothing speaks against."""
    own = [edge for edge in _edges_at(selection, k) if key_of(edge) not in judge.refuted]
    without = judge.without(own, "looked_through")
    rest = without(selection.edges)
    against = without.contradictions(rest)
    wrong = [edge for edge in own if not _fits(judge, rest, edge, k)]
    if len(wrong) < len(own):
        fewer = judge.without(wrong, "looked_through")
        again = fewer(selection.edges)
        more = fewer.contradictions(again)
        if _count(more) <= _count(against):
            return fewer, again, more
    return without, rest, against


def without_passed_scans(judge: Judge, selection: EdgeSelection) -> tuple[Judge, EdgeSelection]:
    """The selection without scans that stand where the rays of all others together passed, the worst first.

    All stay where that does not bring the others to agree: the verdict names the contradiction then.
    """
    rays, found = judge.sides.rays, (judge, selection)
    for _ in range(int(MAX_LEFT_OUT_SHARE * judge.count) + 1):
        shares = np.zeros(1) if rays is None else rays.shares(found[1].T_world_scan)
        if shares.max() <= MAX_PASSED_SHARE:
            return found
        found = _left_out(*found, int(shares.argmax()))[:2]
    return judge, selection


def _fits(judge: Judge, rest: EdgeSelection, edge: Edge, k: int) -> bool:
    """Whether an edge puts a scan where nothing speaks against it."""
    T = rest.T_world_scan[: judge.count].copy()
    other = edge.source if edge.target == k else edge.target
    T_other = rest.T_world_scan[other]
    if not np.isfinite(T_other).all():
        return False
    T_edge = edge.registration.T_target_source
    T[k] = T_other @ (pose.inverse(T_edge) if edge.target == k else T_edge)
    rays = judge.sides.rays
    is_passed = rays is not None and rays.shares(T)[k] > MAX_PASSED_SHARE
    return not is_passed and not judge.sides.free.contradictions_of(k, T).any()


def key_of(edge: Edge) -> Key:
    """Target, source and pose of an edge: another pose of the same two scans is another edge."""
    return edge.target, edge.source, edge.registration.T_target_source.tobytes()


def _ends_of(edge: Edge) -> Pair:
    """Target and source of an edge."""
    return edge.target, edge.source


def _count(against: FloatArray) -> int:
    return int(np.count_nonzero(np.triu(against, 1)))


def placed_of(selection: EdgeSelection) -> int:
    """How many scans have a pose."""
    return int(np.isfinite(selection.T_world_scan[:-1]).all(axis=(1, 2)).sum())


def without_misfits(
    views: Sequence[View], judge: Judge, selection: EdgeSelection, effort: Effort, seed: int
) -> tuple[Judge, EdgeSelection]:
    """The selection without scans that suspect pairs alone hold, and that the others together do not accept.

    Suspect pairs confirm each other by loops, and those of another object do so too where its faces meet. All other
    scans together show more than each of them: a right scan fits there, by the verdict on a registration.
    """
    for k in _weak(judge, selection)[:MAX_TESTED_SCANS]:
        T_scan = selection.T_world_scan[k]
        if not np.isfinite(T_scan).all():
            continue
        without = judge.without(_edges_at(selection, k), "misfit")
        rest = without(selection.edges)
        if placed_of(rest) < max(placed_of(selection) - 1, MIN_SCANS_OF_TEST) or rest.anchor != selection.anchor:
            continue
        if not _fits_all(views, k, selection, rest, judge.size, effort, seed):
            judge, selection = without, rest
    return judge, selection


def _weak(judge: Judge, selection: EdgeSelection) -> list[int]:
    """Placed scans none of whose used edges is accepted by itself."""
    sure = {k for edge in selection.edges if edge.used and edge.level == "accepted" for k in (edge.target, edge.source)}
    placed = np.isfinite(selection.T_world_scan[: judge.count]).all(axis=(1, 2))
    return [k for k in np.flatnonzero(placed).tolist() if k not in sure and k != judge.home]


def _fits_all(
    views: Sequence[View], k: int, selection: EdgeSelection, rest: EdgeSelection, size: float, effort: Effort, seed: int
) -> bool:
    """Whether nothing in all other scans together speaks against the pose of one, or one near by."""
    T, cloud = selection.T_world_scan[k], views[k].cloud
    assert cloud is not None
    others = merged_target(views, rest.T_world_scan[: len(views)])
    try:
        found = register(cloud, others, T, effort=effort, seed=seed, search="never", keep_inputs=False, units="ignore")
    except DqregError:
        return False
    agreed = SETTLED_BY_AGREEMENT if selection.is_unanimous else WEAKLY_CONSTRAINED
    unheld = SETTLED_BY_TABLE if k in selection.on_steps else agreed
    if found.verdict.level != "accepted" and not set(found.verdict.codes) <= unheld:
        return False
    middle = cloud.points.mean(axis=0)[None]
    moved = np.linalg.norm(pose.apply(found.T_target_source, middle) - pose.apply(T, middle))
    return bool(moved <= MAX_MOTION_SIZES * size)
