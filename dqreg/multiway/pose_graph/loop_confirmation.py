"""Which edges closing loops confirm: trust from the loops of three, then longer loops along the trusted edges."""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT, MAX_LOOP_SIGMA_RAD, MAX_LOOP_SIGMA_SIZES, Loops
from dqreg.rigid import pose

# Trust of an edge that no loop tells anything about: its registration accepted, or suspect.
ACCEPTED_TRUST, SUSPECT_TRUST = 0.7, 0.3
# The same of an accepted edge to the part: all of its surface is there, where a scan shows some.
ACCEPTED_ON_PART_TRUST = 0.9
# Votes of a closing loop: wrong edges seldom close one, but one wrong edge makes its right neighbours' loops fail.
CLOSING_VOTES = 4.0
# Rounds in which the trust of edges and the votes of loops follow each other.
TRUST_ROUNDS = 10
# Cost of a path over an edge that no loop confirms, in typical confirmed edges.
UNCONFIRMED_COST = 30.0
# Paths tried for an edge: at first, and at most where nothing else is left to confirm.
PATHS_PER_EDGE = 8, 32
# Scans of an island that doubted edges may join to another one, and such edges, at least.
MIN_ISLAND_SCANS, MIN_BRIDGES = 3, 2
# Confidence of all other edges between the two, as a share of theirs, beyond which they cannot be distinguished.
MAX_RIVAL_CONFIDENCE_SHARE = 0.5


@dataclasses.dataclass(frozen=True)
class Confirmation:
    """What loops tell about the edges."""

    trust: FloatArray  # (m,): From 0 to 1
    confirmed: BoolArray  # (m,): Part of a closing loop of trusted edges
    refuted: BoolArray  # (m,): At odds with a path of confirmed edges

    def also(self, more: BoolArray) -> Confirmation:
        """The same with more edges confirmed."""
        trust = np.maximum(self.trust, np.where(more, ACCEPTED_TRUST, 0.0))
        return Confirmation(trust, self.confirmed | more, self.refuted & ~more)


def trust_of(loops: Loops, accepted: BoolArray, on_part: BoolArray) -> FloatArray:
    """Trust of edges from closing and failing loops, each weighed by the trust of its other edges. Returns (m,)."""
    prior = np.where(accepted, np.where(on_part, ACCEPTED_ON_PART_TRUST, ACCEPTED_TRUST), SUSPECT_TRUST)
    trust, m = prior.copy(), len(prior)
    votes = np.where(loops.closes, CLOSING_VOTES, 0.0), loops.fails.astype(float)
    for _ in range(TRUST_ROUNDS if len(loops.edges) else 0):
        t = trust[loops.edges]
        others = np.stack([t[:, 1] * t[:, 2], t[:, 0] * t[:, 2], t[:, 0] * t[:, 1]], axis=1)
        closing, failing = (
            np.bincount(loops.edges.ravel(), weights=(vote[:, None] * others).ravel(), minlength=m) for vote in votes
        )
        trust = (prior + closing) / (1.0 + closing + failing)
    return np.asarray(trust)


def confirm(
    graph: PoseGraph,
    covariances: FloatArray,
    loops: Loops,
    accepted: BoolArray,
    size: float,
    sure: FloatArray,
    held: BoolArray,
) -> Confirmation:
    """Confirm edges by loops of three, then by ever longer ones; size is a typical diagonal of a scan.

    Shapes: sure (m,), the confidence of the edges; held (m,), whether only how well they are held is doubted.
    """
    # The part is the last node, and always a target.
    trust = trust_of(loops, accepted, graph.targets == graph.count - 1)
    confirmed, refuted = np.zeros(len(trust), dtype=bool), np.zeros(len(trust), dtype=bool)
    if len(loops.edges):
        good = loops.closes & (trust[loops.edges] >= 0.5).all(axis=1)
        confirmed[loops.edges[good].ravel()] = True
    paths = _Paths(graph, covariances, size)
    _by_longer_loops(paths, trust, accepted, confirmed, refuted)
    while (bridges := _bridges(paths, confirmed, sure, held & ~accepted)).any():
        confirmed |= bridges
        refuted[:] = False
        _by_longer_loops(paths, trust, accepted, confirmed, refuted)
    return Confirmation(trust, confirmed, refuted & ~confirmed)


def _by_longer_loops(
    paths: _Paths, trust: FloatArray, accepted: BoolArray, confirmed: BoolArray, refuted: BoolArray
) -> None:
    """Mark in place what loops along the trusted edges confirm or refute."""
    order = np.argsort(-trust, kind="stable")
    most = PATHS_PER_EDGE[0]
    while most <= PATHS_PER_EDGE[1]:
        before = int(confirmed.sum())
        for row in order[~(confirmed | refuted)[order]].tolist():
            if not confirmed[row]:
                extra = np.where(confirmed, 0.0, np.where(accepted & ~refuted, UNCONFIRMED_COST, np.inf))
                open_edges, refuted[row] = _search(paths, row, extra, trust, most)
                # A suspect edge needs a loop of confirmed edges.
                if open_edges is not None and (accepted[row] or not open_edges):
                    confirmed[[row, *open_edges]] = True
        if confirmed.sum() == before:
            most *= 4


def _bridges(paths: _Paths, confirmed: BoolArray, sure: FloatArray, held: BoolArray) -> BoolArray:
    """Doubted edges that put two islands of confirmed scans to one pose of each other, (m,).

    Six numbers do not agree by chance. Edges between the two that say something else are weighed against them.
    """
    graph = paths.graph
    island = islands(graph, np.flatnonzero(confirmed))
    large = np.bincount(island) >= MIN_ISLAND_SCANS
    ends = np.sort(np.column_stack([island[graph.targets], island[graph.sources]]), axis=1)
    across = ~confirmed & (ends[:, 0] != ends[:, 1]) & large[ends].all(axis=1)
    found = np.zeros(len(confirmed), dtype=bool)
    for pair in np.unique(ends[across], axis=0):
        rows = np.flatnonzero(across & (ends == pair).all(axis=1))
        best = max((_agreeing(paths, row, rows[held[rows]], confirmed) for row in rows[held[rows]]), default=rows[:0],
                   key=lambda group: float(sure[group].sum()))  # fmt: skip
        if (
            len(best) >= MIN_BRIDGES
            and sure[np.setdiff1d(rows, best)].sum() <= MAX_RIVAL_CONFIDENCE_SHARE * sure[best].sum()
        ):
            found[best] = True
    return found


def _agreeing(paths: _Paths, row: int, others: IntArray, confirmed: BoolArray) -> IntArray:
    """An edge, and those of others that close a loop with it along confirmed ones, (k,)."""
    group = [int(row)]
    for other in others[others != row].tolist():
        extra = np.where(confirmed, 0.0, np.inf)
        extra[other] = 0.0
        path = paths.shortest(row, extra, frozenset((row,)))
        chi2, sharp = paths.loop(row, path) if path else (np.inf, False)
        if chi2 <= CHI2_LIMIT and sharp:
            group.append(other)
    return np.array(group, dtype=np.int64)


def islands(graph: PoseGraph, rows: IntArray) -> IntArray:
    """Number of the connected part that some edges, by their rows, leave each node in, (n,)."""
    shape = (graph.count, graph.count)
    links = sparse.coo_matrix((np.ones(len(rows)), (graph.targets[rows], graph.sources[rows])), shape=shape)
    _, labels = sparse.csgraph.connected_components(links, directed=False)
    return np.asarray(labels, dtype=np.int64)


def _search(paths: _Paths, row: int, extra: FloatArray, trust: FloatArray, most: int) -> tuple[list[int] | None, bool]:
    """Edges, not yet confirmed, that close a loop with an edge, None without one; and whether confirmed ones refute it.

    Confirmed edges are those whose passage costs nothing extra. Looks at so many paths at most.
    """
    without = [frozenset((row,))]
    for banned in without:
        path = paths.shortest(row, extra, banned)
        if not path:
            continue
        open_edges = [edge for edge, _ in path if extra[edge] > 0.0]
        chi2, sharp = paths.loop(row, path)
        if chi2 <= CHI2_LIMIT and sharp:
            return open_edges, False
        if chi2 > CHI2_LIMIT and not open_edges:
            return None, True
        # One of these is wrong, or the path is too long to tell: go round each, the least trusted first.
        for edge in sorted(open_edges, key=lambda edge: (float(trust[edge]), edge)):
            if len(without) < most and banned | {edge} not in without:
                without.append(banned | {edge})
    return None, False


class _Paths:
    """Paths along edges, and how far a loop made of a path and one more edge is from closing."""

    def __init__(self, graph: PoseGraph, covariances: FloatArray, size: float) -> None:
        self.graph, self.size = graph, size
        there = pose.adjoint(pose.from_parts(np.eye(3), graph.centres))
        inverse = pose.inverse(graph.measured)
        forth = there @ covariances @ there.transpose(0, 2, 1)
        turn = pose.adjoint(inverse)
        # Measured poses and their covariances about the origin, along an edge and against it.
        self.poses = (graph.measured, inverse)
        self.adjoints = (pose.adjoint(graph.measured), turn)
        self.covariances = (forth, turn @ forth @ turn.transpose(0, 2, 1))
        spread = np.trace(covariances[:, :3, :3], axis1=1, axis2=2)
        spread = spread + np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2) / size**2
        self.lengths = np.clip(spread / np.median(spread), 0.1, 1e4) if len(spread) else spread
        self.near: dict[int, list[tuple[int, int, int]]] = {k: [] for k in range(graph.count)}
        for edge, (i, j) in enumerate(zip(graph.targets.tolist(), graph.sources.tolist(), strict=True)):
            self.near[i].append((edge, 0, j))
            self.near[j].append((edge, 1, i))

    def shortest(self, row: int, extra: FloatArray, banned: frozenset[int]) -> list[tuple[int, int]]:
        """Edges, and 1 where they are gone against, from the target of an edge to its source; none without a path."""
        first, last = int(self.graph.targets[row]), int(self.graph.sources[row])
        lengths, came = (self.lengths + extra).tolist(), dict[int, tuple[int, int, int]]()
        cost, heap, done = {first: 0.0}, [(0.0, first)], set[int]()
        while heap:
            length, node = heapq.heappop(heap)
            if node == last:
                return _path_back(came, first, last)
            if node in done:
                continue
            done.add(node)
            for edge, against, other in self.near[node]:
                total = length + lengths[edge]
                if total < cost.get(other, math.inf) and other not in done and edge not in banned:
                    cost[other], came[other] = total, (node, edge, against)
                    heapq.heappush(heap, (total, other))
        return []

    def loop(self, row: int, path: Sequence[tuple[int, int]]) -> tuple[float, bool]:
        """Squared error of a loop in units of its covariance, and whether that is narrow enough to tell anything."""
        T, A, covariance = np.eye(4), np.eye(6), self.covariances[0][row].copy()
        for edge, against in path:
            covariance += A @ self.covariances[against][edge] @ A.T
            T, A = T @ self.poses[against][edge], A @ self.adjoints[against][edge]
        inward = pose.from_parts(np.eye(3), -self.graph.centres[row])
        A = pose.adjoint(inward)
        covariance = A @ covariance @ A.T
        twist = pose.log(inward @ T @ self.poses[1][row] @ pose.inverse(inward))
        turn, shift = (float(np.sqrt(np.linalg.eigvalsh(block).max())) for block in _diagonal(covariance))
        sharp = turn <= MAX_LOOP_SIGMA_RAD and shift <= MAX_LOOP_SIGMA_SIZES * self.size
        return float(twist @ np.linalg.solve(covariance, twist)), sharp


def _diagonal(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    return covariance[:3, :3], covariance[3:, 3:]


def _path_back(came: dict[int, tuple[int, int, int]], first: int, last: int) -> list[tuple[int, int]]:
    path = []
    while last != first:
        last, edge, against = came[last]
        path.append((edge, against))
    return path[::-1]


def joined_by(graph: PoseGraph, order: IntArray) -> IntArray:
    """Rows of the first edges, in an order, that join all nodes the edges can join (Kruskal)."""
    group = list(range(graph.count))

    def root(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = group[k]
        return k

    rows = []
    for row in order.tolist():
        a, b = root(int(graph.targets[row])), root(int(graph.sources[row]))
        if a != b:
            group[max(a, b)] = min(a, b)
            rows.append(row)
    return np.array(rows, dtype=np.int64)
