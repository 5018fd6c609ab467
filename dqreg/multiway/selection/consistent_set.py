"""Scans admitted one by one, each by the verdict on its registration to all scans admitted before it.

All of them together show more than each of them: what two views of few faces cannot tell, their union can. The poses
that pairs name are tried, and a search where none of them is accepted.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DqregError
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.multiway.pose_graph.edges import PART, Edge, confidence_of_edge
from dqreg.multiway.scans.merge import merged_target
from dqreg.multiway.scans.scans import View
from dqreg.registration.options.options import Effort, Search
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.registration.target import Target
from dqreg.rigid import pose
from dqreg.trust.code_sets import WEAKLY_CONSTRAINED_AMONG_ALL

# Seeds that are grown, and rounds over the scans that are left.
MAX_SEEDS, MAX_ROUNDS = 3, 4
# Poses of a scan that are tried in a round.
POSES_PER_ROUND = 3
# Poses closer than this are one: rotation, and shift in sizes of a scan.
SAME_RAD, SAME_SHIFT_SIZES = np.deg2rad(6.0), 0.05
# Points by which poses are compared before, and distance in spacings at which one lies on the others.
COMPARED_POINTS, NEAR_SPACINGS = 600, 2.0
# Least confidence of such a pose; and that of the next best one, as a share of it, beyond which they cannot be
# distinguished.
MIN_CONFIDENCE, MAX_RIVAL_CONFIDENCE_SHARE = 0.5, 0.65
# Confidence below which a pose is not tried again when more scans are in.
MIN_RETRIED_CONFIDENCE = 0.016
# Confidence below which no pose of a scan is one, even for a set that is small.
REFUSED_CONFIDENCE = 0.048
# Accepted pairs that hold a scan at one pose without a registration to all.
MIN_AGREEING_PAIRS = 2
# What a pose that no pair names counts, in confidences of one that does.
UNNAMED_CONFIDENCES = 0.2


@dataclasses.dataclass
class ConsistentSet:
    """Scans that fit together, with their poses in the frame of the first one."""

    views: Sequence[View]
    edges: Sequence[Edge]
    size: float
    effort: Effort
    seed: int
    is_over: Callable[[], bool]
    tell: Callable[[Edge], None]  # Called with each registration to all that are in
    T: dict[int, FloatArray]
    # Registrations of those that are not of the seed, and to which scans each was registered
    admitted: dict[int, tuple[Registration, tuple[int, ...]]] = dataclasses.field(default_factory=dict)
    ambiguous: set[int] = dataclasses.field(default_factory=set)  # Several poses of these fit alike
    hopeless: dict[int, list[FloatArray]] = dataclasses.field(default_factory=dict)  # Poses that were refused
    # How many were in when a scan was tried last by the pairs of a level
    seen: dict[tuple[int, str], int] = dataclasses.field(default_factory=dict)
    surest: dict[int, float] = dataclasses.field(default_factory=dict)  # Best confidence of any pose of a scan
    searched: set[int] = dataclasses.field(default_factory=set)
    _target: Target | None = None
    _tree: NeighbourTree | None = None

    def grow(self) -> None:
        """Admit what is accepted, then what a search finds, then what fits in one way only."""
        # What surer pairs join comes first: it tells more about what they do not.
        while self._rounds("accepted") or self._rounds() or self._searched():
            pass
        for k in self._left():
            self._admit_loose(k)
        for k in self._left():
            self._admit_held(k)

    def _left(self) -> list[int]:
        """Scans that are not in, those with most edges to what is in first."""
        left = [k for k, view in enumerate(self.views) if view.usable and k not in self.T]
        support = {k: sum(confidence_of_edge(edge) for edge, _ in self._named(k)) for k in left}
        return sorted(left, key=lambda k: (-support[k], k))

    def _rounds(self, level: str = "") -> bool:
        """Admit by the poses that pairs (of a level) name; whether any scan was."""
        before = len(self.T)
        for _ in range(MAX_ROUNDS):
            count = len(self.T)
            for k in [k for k in self._left() if self.seen.get((k, level)) != len(self.T)]:
                self.seen[k, level] = len(self.T)
                found = self._best(k, self._candidates(k, level)[:POSES_PER_ROUND])
                if found is not None:
                    self._admit(k, found)
                    if not level:
                        return True
            if len(self.T) == count:
                break
        return len(self.T) > before

    def _searched(self) -> bool:
        """Admit the first scan that a search places; whether one was."""
        for k in [k for k in self._left() if k not in self.searched]:
            self.searched.add(k)
            found = self._best(k, [*self._candidates(k)[:1], None])
            if found is not None:
                self._admit(k, found)
                return True
        return False

    def _best(self, k: int, starts: Sequence[FloatArray | None]) -> Registration | None:
        """The accepted registration, unless one that surer pairs name is doubted only; None without one."""
        fits = self._fits(k, starts)
        if not fits or fits[-1].verdict.level != "accepted":
            return None
        weighed = [fit.verdict.confidence * self._support(k, fit.T_target_source) for fit in fits]
        return fits[-1] if weighed[-1] == max(weighed) else None

    def _support(self, k: int, T: FloatArray) -> float:
        """Confidence of the edges that put a scan at a pose, taken together; a little for a pose that none names."""
        named = [confidence_of_edge(edge) for edge, other in self._named(k) if self.close(k, T, other)]
        return max(sum(named), UNNAMED_CONFIDENCES)

    def _admit_loose(self, k: int) -> None:
        """Admit a scan of which only one pose fits, though some of its motions are held by little."""
        found = [
            fit
            for fit in self._fits(k, self._candidates(k)[: 2 * POSES_PER_ROUND])
            if set(fit.verdict.codes) <= WEAKLY_CONSTRAINED_AMONG_ALL
        ]
        found.sort(key=lambda fit: -fit.verdict.confidence)
        if not found or found[0].verdict.confidence < MIN_CONFIDENCE:
            self.ambiguous |= {k} if found else set()
            return
        best, others = found[0], [fit for fit in found[1:] if not self._same(k, fit, found[0])]
        if any(fit.verdict.confidence > MAX_RIVAL_CONFIDENCE_SHARE * best.verdict.confidence for fit in others):
            self.ambiguous.add(k)
        else:
            self._admit(k, best)

    @property
    def refused(self) -> frozenset[int]:
        """Scans that fit nowhere."""
        return frozenset(k for k, sure in self.surest.items() if k not in self.T and sure < REFUSED_CONFIDENCE)

    def _admit_held(self, k: int) -> None:
        """Admit a scan that several accepted pairs put to one pose, whatever a sparse set says."""
        named = [T for edge, T in self._named(k) if edge.level == "accepted"]
        if len(named) >= MIN_AGREEING_PAIRS and all(self.close(k, T, named[0]) for T in named):
            self.T[k] = named[0]

    def _admit(self, k: int, found: Registration) -> None:
        self.admitted[k] = found, tuple(sorted(self.T))
        self.T[k] = found.T_target_source
        self._target = self._tree = None

    def _named(self, k: int) -> list[tuple[Edge, FloatArray]]:
        """Edges of a scan to what is in, and where they put it."""
        found = []
        for edge in self.edges:
            other = edge.source if edge.target == k else edge.target
            if k in (edge.target, edge.source) and edge.found and other in self.T and edge.target != PART:
                T = edge.registration.T_target_source
                found.append((edge, self.T[other] @ (pose.inverse(T) if edge.target == k else T)))
        return found

    def _candidates(self, k: int, level: str = "") -> list[FloatArray]:
        """Poses that edges (of a level) name, each once; first those of sure edges, with most of it on the others."""
        found: list[list[tuple[float, FloatArray]]] = []
        for edge, T in sorted(self._named(k), key=lambda each: -confidence_of_edge(each[0])):
            if any(self.close(k, T, other) for other in self.hopeless.get(k, ())):
                continue
            if level and edge.level != level:
                continue
            named = confidence_of_edge(edge), T
            same = next((group for group in found if self.close(k, T, group[0][1])), None)
            found.append([named]) if same is None else same.append(named)
        found.sort(key=lambda group: -sum(sure for sure, _ in group) * self._share_on_others(k, group[0][1]))
        return [group[0][1] for group in found]

    def _share_on_others(self, k: int, T: FloatArray) -> float:
        """Share of a scan that lies on the others at a pose."""
        if self._tree is None:
            clouds = [(self.T[j], self.views[j].cloud) for j in self.T]
            self._tree = NeighbourTree(np.concatenate([pose.apply(W, c.points) for W, c in clouds if c is not None]))
        points = pose.apply(T, self._some(k))
        return float(np.mean(self._tree.nearest(points, 1)[1] <= NEAR_SPACINGS * self.views[k].scan.spacing))

    def _some(self, k: int) -> FloatArray:
        cloud = self.views[k].cloud
        assert cloud is not None
        return cloud.points[:: max(1, len(cloud.points) // COMPARED_POINTS)]

    def close(self, k: int, first: FloatArray, second: FloatArray) -> bool:
        """Whether two poses of a scan are one."""
        middle = self._some(k).mean(axis=0)
        return bool(
            pose.angle_between(first, second) <= SAME_RAD
            and pose.offset_between(first, second, at=middle) <= SAME_SHIFT_SIZES * self.size
        )

    def _same(self, k: int, first: Registration, second: Registration) -> bool:
        return self.close(k, first.T_target_source, second.T_target_source)

    def _fits(self, k: int, starts: Sequence[FloatArray | None]) -> Sequence[Registration]:
        """Registrations of a scan to all that are in, from poses (None searches), up to the first accepted one."""
        fits: list[Registration] = []
        for start in starts:
            if self.is_over():
                break
            if self._target is None:
                poses = np.full((len(self.views), 4, 4), np.nan)
                poses[list(self.T)] = list(self.T.values())
                self._target = merged_target(self.views, poses)
            search: Search = "doubt" if start is None else "never"
            try:
                found = register(
                    self.views[k].cloud, self._target, start, effort=self.effort, seed=self.seed, search=search,
                    keep_inputs=False, units="ignore",
                )  # fmt: skip
            except DqregError:
                continue
            fits.append(found)
            self.tell(Edge(next(iter(self.T)), k, against(found, self.T)))
            self.surest[k] = max(self.surest.get(k, 0.0), float(np.nan_to_num(found.verdict.confidence)))
            if start is not None and not found.verdict.confidence > MIN_RETRIED_CONFIDENCE:
                self.hopeless.setdefault(k, []).append(start)
            if found.verdict.level == "accepted":
                break
        return fits


def against(registration: Registration, scans: Iterable[int]) -> Registration:
    """A registration that says to which scans together it was made."""
    return dataclasses.replace(registration, settings={**registration.settings, "against": sorted(scans)})


def largest_consistent_set(
    views: Sequence[View],
    edges: Sequence[Edge],
    size: float,
    effort: Effort,
    seed: int,
    confirmed: frozenset[tuple[int, int]],
    is_over: Callable[[], bool],
    tell: Callable[[Edge], None] = lambda _: None,
) -> ConsistentSet | None:
    """The largest set of scans that fit together, grown from the surest pairs; None where no pair is accepted."""
    sure = [edge for edge in edges if edge.level == "accepted" and edge.target != PART]
    sure.sort(key=lambda e: (-((e.target, e.source) in confirmed), -confidence_of_edge(e)))
    usable = sum(view.usable for view in views)
    best: ConsistentSet | None = None
    for _ in range(MAX_SEEDS):
        # What is in already grows to the same again.
        new = [edge for edge in sure if best is None or not {edge.target, edge.source} <= set(best.T)]
        if not new or (best is not None and 2 * len(best.T) > usable):
            break
        sure = new[1:]
        T = {new[0].target: np.eye(4), new[0].source: new[0].registration.T_target_source}
        trial = ConsistentSet(views, edges, size, effort, seed, is_over, tell, T)
        trial.grow()
        best = trial if best is None or len(trial.T) > len(best.T) else best
    return best
