"""Given starts as a prior: pairs that hold all but a motion or two, and come to the starts in these, hold a scan.

A view that shares a face or two with the next one has the right pose and cannot show it, and no loop of such pairs
tells anything. Where each scan was put before does, if the pair stays near it in what it holds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.multiway.pairwise.starts import OTHER_POSE_RAD, OTHER_POSE_SIZES
from dqreg.multiway.pose_graph.edges import PART, Edge, graph_of
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT, covariances_of
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.turntables.equal_steps import is_sound
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by
from dqreg.trust.records import Reason

# A start is another pose where it is off by so many times what starts err by.
LIMIT_SIGMAS = 3.0


@dataclasses.dataclass(frozen=True)
class StartPrior:
    """Motions between scans as their starts say."""

    starts: Mapping[int, FloatArray]
    pairs: tuple[tuple[int, int], ...]  # Of scans with starts that were registered
    size: float
    floor: float
    centres: FloatArray  # (m, 3): Of the pairs, in the target's frame
    assumed = True

    @staticmethod
    def of(
        starts: Mapping[int, FloatArray], edges: Sequence[Edge], count: int, size: float, floor: float
    ) -> StartPrior:
        """The prior between all scans of pairs that nothing but how they are held is doubted of."""
        sound = [e for e in edges if e.found and e.target in starts and e.source in starts and is_sound(e)]
        ends = tuple((edge.target, edge.source) for edge in sound)
        return StartPrior(starts, ends, size, floor, graph_of(sound, count).centres)

    def agree(self, graph: PoseGraph, edges: Sequence[Edge]) -> BoolArray:
        """Edges of a graph that come to what the starts say, and of which nothing else is doubted, (m,)."""
        known = [edge.target in self.starts and edge.source in self.starts and is_sound(edge) for edge in edges]
        rows = np.flatnonzero(np.array(known, dtype=bool))
        found = np.zeros(len(edges), dtype=bool)
        part = graph.part(rows)
        ends = zip(part.targets.tolist(), part.sources.tolist(), strict=True)
        inward = pose.from_parts(np.eye(3), -part.centres)
        said = self._between(list(ends))
        twists = pose.log(inward @ part.measured @ pose.inverse(said) @ pose.inverse(inward))
        spread = covariances_of(part, self.size, self.floor) + np.diag(self._variances)
        chi2 = np.einsum("mi,mi->m", twists, np.linalg.solve(spread, twists[..., None])[..., 0])
        near = np.abs(twists) <= LIMIT_SIGMAS * np.sqrt(self._variances)
        found[rows] = (chi2 <= CHI2_LIMIT) & near.all(axis=1)
        return found

    def graph(self, count: int) -> PoseGraph:
        """The motions between scans of pairs, as edges of a graph of so many nodes."""
        targets, sources = np.array(self.pairs, dtype=np.int64).reshape(-1, 2).T
        information = np.tile(np.diag(1.0 / self._variances), (len(targets), 1, 1))
        return PoseGraph(count, targets, sources, self._between(self.pairs), information, self.centres)

    def doubts(self) -> Iterator[Reason]:
        """A doubt: what pairs leave free is as the starts have it."""
        yield Reason(
            "some scans hang on pairs that leave a motion nearly free and that no loop confirms: they stay near the "
            "starts in what they hold, and the rest is assumed to be as the starts have it; scan more overlap there",
            "unconfirmed_scan",
        )

    @property
    def _variances(self) -> FloatArray:
        sigmas = scaling_by(OTHER_POSE_RAD, OTHER_POSE_SIZES * self.size) / LIMIT_SIGMAS
        return np.asarray(sigmas**2)

    def _between(self, pairs: Sequence[tuple[int, int]]) -> FloatArray:
        there = [pose.inverse(self.starts[i]) @ self.starts[j] for i, j in pairs]
        return np.array(there).reshape(-1, 4, 4)


def joined_by_starts(
    selection: EdgeSelection, starts: Mapping[int, FloatArray], size: float, floor: float
) -> StartPrior | None:
    """The prior, where scans that have starts are not all placed without it."""
    placed = np.isfinite(selection.T_world_scan[:-1, 3, 3]).tolist()
    if selection.anchor == PART or all(placed[k] for k in starts):
        return None
    found = StartPrior.of(starts, selection.edges, len(placed), size, floor)
    return found if found.pairs else None
