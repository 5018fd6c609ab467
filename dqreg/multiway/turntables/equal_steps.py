"""What the steps of a turntable say of the pairs: one motion from each scan to the next, as sure as pairs agree on it.

A pair of views that share one face, or the rims of a plate, has the right pose and cannot show it. Where most other
pairs agree on one motion, it is no accident that a pair comes to the same in what it holds; the steps hold the rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.multiway.pose_graph.edges import PART, Edge, graph_of
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT, covariances_of
from dqreg.multiway.scans.scans import View
from dqreg.multiway.turntables.turntable import OTHER_STEP_SHARE, step_of
from dqreg.rigid import DualQuaternion, pose
from dqreg.rigid.twist import scaling_by
from dqreg.trust.code_sets import SETTLED_BY_STEPS

# Accepted pairs of near places that agree with the step, at least, and their share of all of these.
MIN_AGREEING_PAIRS, MIN_AGREEING_SHARE = 3, 0.5
# Places apart of pairs that tell how well the steps agree.
MAX_PLACES_APART = 2
# Median of the sum of three squares of unit variance.
MEDIAN_OF_THREE_SQUARES = 2.366


@dataclasses.dataclass(frozen=True)
class EqualSteps:
    """One motion from each scan to the next; a prior that outweighs nothing that pairs know better."""

    step: DualQuaternion
    places: dict[int, int]  # Of the scans on the table
    closes: bool  # Whether the scans go round once
    variances: FloatArray  # (6,): Of one step, as pairs scatter about it, about the middle of a scan
    agreeing: int  # Pairs that it follows from
    size: float
    floor: float  # Poses of pairs need not agree to better
    centres: FloatArray  # (n, 3): Middle of each scan

    @staticmethod
    def of(edges: Sequence[Edge], views: Sequence[View], size: float, floor: float) -> EqualSteps | None:
        """The steps that most accepted pairs of near places agree on; None without them."""
        usable = [k for k, view in enumerate(views) if view.usable]
        places = {scan: k for k, scan in enumerate(usable)}
        pairs = [edge for edge in edges if edge.target != PART and edge.found]
        table = step_of([(places[edge.source] - places[edge.target], edge) for edge in pairs], len(usable))
        centres = np.array([view.cloud.points.mean(axis=0) if view.cloud is not None and view.usable else np.zeros(3)
                            for view in views])  # fmt: skip
        if table is None:
            return None
        found = EqualSteps(table.step, places, True, np.ones(6), table.agreeing, size, floor, centres)
        accepted = [edge for edge in pairs if edge.level == "accepted"]
        near = [edge for edge in accepted if abs(found._apart(edge.target, edge.source)) <= MAX_PLACES_APART]
        if not near:
            return None
        twists = found._twists(graph_of(near, len(views)))
        alike = found._near(twists)
        if alike.sum() < MIN_AGREEING_PAIRS or alike.sum() < MIN_AGREEING_SHARE * len(near):
            return None
        squares = np.array([np.median((twists[alike][:, rows] ** 2).sum(axis=1)) for rows in (slice(3), slice(3, 6))])
        found = dataclasses.replace(found, variances=np.repeat(squares / MEDIAN_OF_THREE_SQUARES, 3))
        return dataclasses.replace(found, closes=found._goes_round())

    def agree(self, graph: PoseGraph, edges: Sequence[Edge]) -> BoolArray:
        """Edges of a graph that come to what the steps say, and of which nothing else is doubted, (m,)."""
        on_table = [edge.target in self.places and edge.source in self.places for edge in edges]
        sound = [edge.level == "accepted" or set(edge.registration.verdict.codes) <= SETTLED_BY_STEPS for edge in edges]
        rows = np.flatnonzero(np.array(on_table, dtype=bool) & np.array(sound, dtype=bool))
        found = np.zeros(len(edges), dtype=bool)
        part = graph.part(rows)
        twists, n = self._twists(part), self._all_apart(part)
        spread = covariances_of(part, self.size, self.floor)
        spread[:, range(6), range(6)] += self._variances(n)
        chi2 = np.einsum("mi,mi->m", twists, np.linalg.solve(spread, twists[..., None])[..., 0])
        found[rows] = (chi2 <= CHI2_LIMIT) & self._near(twists)
        return found

    def graph(self, count: int) -> PoseGraph:
        """The steps between neighbours, as edges of a graph of so many nodes."""
        scans = list(self.places)
        pairs = list(pairwise(scans)) + ([(scans[-1], scans[0])] if self.closes else [])
        targets, sources = np.array(pairs, dtype=np.int64).T
        information = np.tile(np.diag(1.0 / self._variances(np.ones(1))[0]), (len(pairs), 1, 1))
        measured = np.tile(self.step.as_matrix(), (len(pairs), 1, 1))
        return PoseGraph(count, targets, sources, measured, information, self.centres[targets])

    def _goes_round(self) -> bool:
        """Whether as many steps as there are scans come back to the first."""
        count, inward = len(self.places), pose.from_parts(np.eye(3), -self.centres[next(iter(self.places))])
        twist = pose.log(inward @ (self.step ** float(count)).as_matrix() @ pose.inverse(inward))
        floor = scaling_by(2.0 * self.floor / self.size, self.floor)
        return bool((twist**2 / (self._variances(np.array([float(count)]))[0] + floor**2)).sum() <= CHI2_LIMIT)

    def _variances(self, apart: FloatArray) -> FloatArray:
        """Of the motion between places so far apart: the step's own error adds up, (m, 6)."""
        least = (1e-3 * self.floor * scaling_by(2.0 / self.size)) ** 2
        return np.asarray(np.maximum(self.variances, least) * (1.0 + apart**2 / self.agreeing)[:, None])

    def _apart(self, target: int, source: int) -> int:
        n, count = self.places[source] - self.places[target], len(self.places)
        return (n + count // 2) % count - count // 2 if self.closes else n

    def _all_apart(self, graph: PoseGraph) -> FloatArray:
        ends = zip(graph.targets.tolist(), graph.sources.tolist(), strict=True)
        return np.array([float(self._apart(i, j)) for i, j in ends])

    def _twists(self, graph: PoseGraph) -> FloatArray:
        """From what the steps say to the edges, about their centres, (m, 6)."""
        said = np.array([(self.step**n).as_matrix() for n in self._all_apart(graph)]).reshape(-1, 4, 4)
        inward = pose.from_parts(np.eye(3), -graph.centres)
        return np.asarray(pose.log(inward @ graph.measured @ pose.inverse(said) @ pose.inverse(inward)))

    def _near(self, twists: FloatArray) -> BoolArray:
        turned, shifted = np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)
        return np.asarray((turned <= OTHER_STEP_SHARE) & (shifted <= OTHER_STEP_SHARE * self.size))
