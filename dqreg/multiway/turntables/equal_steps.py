"""What the steps of a turntable say of the pairs: one motion from each scan to the next, as sure as pairs agree on it.

A pair of views that share one face, or the rims of a plate, has the right pose and cannot show it. Where most other
pairs agree on one motion, it is no accident that a pair comes to the same in what it holds; the steps hold the rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
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
from dqreg.trust.records import Reason

# Accepted pairs of near places that agree with the step, at least, and their share of all of these.
MIN_AGREEING_PAIRS, MIN_AGREEING_SHARE = 3, 0.5
# Places apart of pairs that tell how well the steps agree.
MAX_PLACES_APART = 2
# Rounds in which a step of loose pairs is found, its numerical differences, in radians and sizes, and the share of
# the neighbours all round, and of all such pairs, that come to it.
MAX_LOOSE_ROUNDS, MIN_LOOSE_SHARE = 20, 2 / 3
STEP_DIFFERENCE = 1e-6
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
    assumed: bool = False  # Whether it follows from pairs none of which need be accepted

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
        twists = found._twists(graph_of(near, len(views)))
        alike = found._near(twists)
        if alike.sum() < MIN_AGREEING_PAIRS or alike.sum() < MIN_AGREEING_SHARE * len(near):
            return found._of_loose(pairs) if len(near) < MIN_AGREEING_PAIRS else None
        squares = np.array([np.median((twists[alike][:, rows] ** 2).sum(axis=1)) for rows in (slice(3), slice(3, 6))])
        found = dataclasses.replace(found, variances=np.repeat(squares / MEDIAN_OF_THREE_SQUARES, 3))
        return dataclasses.replace(found, closes=found._goes_round())

    def _of_loose(self, pairs: Sequence[Edge]) -> EqualSteps | None:
        """The one step round the table to which pairs that each leave a motion free come in what they hold.

        Each view of a box shows a face or two of the next one: no pair is accepted, and all are right.
        """
        near = [edge for edge in pairs if abs(self._apart(edge.target, edge.source)) <= MAX_PLACES_APART]
        near = [edge for edge in near if is_sound(edge)]
        graph = graph_of(near, len(self.centres))
        spread = covariances_of(graph, self.size, self.floor)
        whitening = np.linalg.cholesky(np.linalg.inv(spread)).transpose(0, 2, 1)
        limit, found = np.inf, self
        for _ in range(MAX_LOOSE_ROUNDS if near else 0):
            errors = np.einsum("mij,mj->mi", whitening, found._twists(graph))
            chi2 = (errors**2).sum(axis=1)
            limit = max(min(0.5 * limit, float(np.median(chi2))), CHI2_LIMIT)
            weights = (limit / (limit + chi2)) ** 2
            J = np.stack([np.einsum("mij,mj->mi", whitening, found._moved(twist)._twists(graph)) - errors
                          for twist in self._differences()], axis=2) / STEP_DIFFERENCE  # fmt: skip
            normal = np.einsum("mki,m,mkj->ij", J, weights, J)
            step = np.linalg.lstsq(normal, -np.einsum("mki,m,mk->i", J, weights, errors), rcond=None)[0]
            found = found._moved(step * scaling_by(1.0, self.size))
        return found._if_agreed(graph, spread, normal) if near else None

    def _if_agreed(self, graph: PoseGraph, spread: FloatArray, normal: FloatArray) -> EqualSteps | None:
        """Such a step, where it is known, goes round, and most pairs all round come to it."""
        twists = self._twists(graph)
        agrees = np.einsum("mi,mi->m", twists, np.linalg.solve(spread, twists[..., None])[..., 0]) <= CHI2_LIMIT
        single = (np.abs(self._all_apart(graph)) == 1.0) & agrees
        few = single.sum() < MIN_LOOSE_SHARE * len(self.places) or agrees.sum() < MIN_LOOSE_SHARE * len(agrees)
        sigmas = np.sqrt(np.diag(np.linalg.pinv(normal)))
        if few or np.linalg.matrix_rank(normal) != 6 or sigmas.max() > OTHER_STEP_SHARE:
            return None
        variances = np.repeat([(sigmas[rows] ** 2).max() for rows in (slice(3), slice(3, 6))], 3)
        variances = variances * agrees.sum() * scaling_by(1.0, self.size) ** 2
        found = dataclasses.replace(self, variances=variances, agreeing=int(agrees.sum()), assumed=True)
        return found if found._goes_round() else None

    def _moved(self, twist: FloatArray) -> EqualSteps:
        centre = pose.from_parts(np.eye(3), self.centres[list(self.places)].mean(axis=0))
        T = centre @ pose.exp(twist) @ pose.inverse(centre) @ self.step.as_matrix()
        return dataclasses.replace(self, step=DualQuaternion.from_matrix(T))

    def _differences(self) -> FloatArray:
        return np.asarray(STEP_DIFFERENCE * np.diag(scaling_by(1.0, self.size)))

    def agree(self, graph: PoseGraph, edges: Sequence[Edge]) -> BoolArray:
        """Edges of a graph that come to what the steps say, and of which nothing else is doubted, (m,)."""
        on_table = [edge.target in self.places and edge.source in self.places for edge in edges]
        sound = [is_sound(edge) for edge in edges]
        rows = np.flatnonzero(np.array(on_table, dtype=bool) & np.array(sound, dtype=bool))
        found = np.zeros(len(edges), dtype=bool)
        part = graph.part(rows)
        twists, n = self._twists(part), self._all_apart(part)
        spread = covariances_of(part, self.size, self.floor)
        spread[:, range(6), range(6)] += self._variances(n)
        chi2 = np.einsum("mi,mi->m", twists, np.linalg.solve(spread, twists[..., None])[..., 0])
        found[rows] = (chi2 <= CHI2_LIMIT) & self._near(twists)
        return found

    def doubts(self) -> Iterator[Reason]:
        """A doubt where no pairs that are believed by themselves say the step."""
        if self.assumed:
            yield Reason(
                f"the step of the table follows from {self.agreeing} pairs that come to one in what they hold, and "
                f"fewer than {MIN_AGREEING_PAIRS} of them are accepted: what they leave free is assumed; scan with "
                "more overlap, or with a third face in it",
                "unconfirmed_scan",
            )

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


def is_sound(edge: Edge) -> bool:
    """Whether nothing is doubted of a pair but what steps can tell."""
    return edge.level == "accepted" or set(edge.registration.verdict.codes) <= SETTLED_BY_STEPS
