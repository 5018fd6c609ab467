"""Which edges to use: verdicts of the pairs, loops that close, then graduated non-convexity on the graph."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.multiway.pose_graph.edges import PART, Edge, EdgeCode, confidence_of_edge, graph_of
from dqreg.multiway.pose_graph.graph import PoseGraph, solve_graph
from dqreg.multiway.pose_graph.loop_confirmation import Confirmation, confirm, islands, joined_by
from dqreg.multiway.pose_graph.loops import (
    CHI2_LIMIT,
    MAX_LOOP_SIGMA_RAD,
    MAX_LOOP_SIGMA_SIZES,
    Loops,
    covariances_of,
    find_loops,
)
from dqreg.multiway.pose_graph.motion_prior import MotionPrior
from dqreg.rigid import pose
from dqreg.trust.code_sets import SETTLED_BY_LOOPS

# Rounds in which the cost goes from convex to truncated, and its factor a round (Yang et al. 2020).
MAX_ROUNDS, CONVEXITY_FACTOR = 40, 1.4
# Trust of an edge, in that of a single thread which it contradicts, from which nobody can tell which of them is wrong.
RIVAL_TRUST_SHARE = 0.8
# Confidence of a doubted edge, as a share of that of all edges used at either of its scans, which tells nothing there.
OUTWEIGHED_CONFIDENCE_SHARE = 0.6


@dataclasses.dataclass(frozen=True)
class EdgeSelection:
    """Edges that were judged, and the poses that follow from those used."""

    edges: tuple[Edge, ...]
    T_world_scan: FloatArray  # (n + 1, 4, 4): The part last; NaN where not connected
    island: IntArray  # (n,): Number of the connected part of the graph a scan belongs to
    anchor: int  # Node whose pose was held
    loops: Loops  # Among the edges that have a pose
    rows: IntArray  # (m,): Numbers of those edges, in the order that the loops count them
    confirmed: BoolArray  # (m,): Whether a closing loop, of three or more, or the steps of a table confirm them
    by_steps: BoolArray  # (m,): Whether those steps do

    @functools.cached_property
    def on_steps(self) -> frozenset[int]:
        """Scans of used edges that steps of a table confirm."""
        used = [edge for row in self.rows[self.by_steps] if (edge := self.edges[row]).used]
        return frozenset(k for edge in used for k in (edge.target, edge.source))

    @functools.cached_property
    def is_unanimous(self) -> bool:
        """Whether all pairs that tell anything are used but for doubted ones that surer pairs of both scans outweigh.

        Scans of something else, and views that look alike elsewhere, always left pairs that contradict the others. A
        loop of used pairs alone that does not close is such a contradiction too.
        """
        used = np.array([edge.used for edge in self.edges], dtype=bool)
        if self.loops.fails.any() and used[self.rows[self.loops.edges[self.loops.fails]]].all(axis=1).any():
            return False
        weight = np.zeros(len(self.T_world_scan))
        for edge in self.edges:
            weight[[edge.target, edge.source]] += edge.used * confidence_of_edge(edge)
        left_out = [edge for edge in self.edges if edge.found and not edge.used and edge.code != "uncertain"]
        return all(
            edge.level != "accepted"
            and confidence_of_edge(edge) <= OUTWEIGHED_CONFIDENCE_SHARE * weight[[edge.target, edge.source]].min()
            for edge in left_out
        )


def select_edges(
    edges: Sequence[Edge],
    count: int,
    anchor: int,
    size: float,
    floor: float,
    homes: Mapping[int, FloatArray],
    steps: MotionPrior | None = None,
) -> EdgeSelection:
    """Judge all edges that were tried, and place what they hold together.

    The anchor, a scan or -1 for the part, keeps its pose of ``homes``, or is the origin where it has none there. So
    does a scan that takes its place, one with a pose there before others. Poses of pairs need not agree to better than
    the floor, a length; size is a typical diagonal of a scan. Steps of a turntable, or starts, confirm edges and hold
    what these leave free.
    """
    codes: list[EdgeCode] = [_initial_code(edge, size) for edge in edges]
    rows = np.array([k for k, code in enumerate(codes) if code == "unconfirmed"], dtype=np.int64)
    graph = graph_of([edges[k] for k in rows], count)
    loops = find_loops(graph, size, floor)
    accepted = np.array([edges[k].level == "accepted" for k in rows], dtype=bool)
    covariances = covariances_of(graph, size, floor)
    sure = np.array([confidence_of_edge(edges[k]) for k in rows])
    held = np.array([set(edges[k].registration.verdict.codes) <= SETTLED_BY_LOOPS for k in rows], dtype=bool)
    told = confirm(graph, covariances, loops, accepted, size, sure, held)
    by_steps = np.zeros(len(rows), dtype=bool) if steps is None else steps.agree(graph, [edges[k] for k in rows])
    told = told.also(by_steps)
    candidate = accepted | told.confirmed | (loops.counts(loops.closes, len(rows)) > 0)
    floored = dataclasses.replace(graph, information=np.asarray(np.linalg.inv(covariances), dtype=np.float64))
    order = np.lexsort((-np.linalg.slogdet(floored.information)[1], -told.trust, told.refuted, ~told.confirmed))
    prior = None if steps is None else steps.graph(count + 1)
    T, kept = _inliers(floored, order[candidate[order]], told, prior)
    kept &= ~_disputed(graph, kept, accepted & ~kept, told)
    for row, k in enumerate(rows):
        if not candidate[row]:
            continue
        codes[k] = ("used" if accepted[row] else "confirmed") if kept[row] else "contradicts"
    island = islands(graph, np.flatnonzero(kept))
    node = count if anchor == PART else anchor
    node = _anchored(island, node, count, homes)
    placed = island == island[node]
    held_together = graph.part(np.flatnonzero(kept & placed[graph.sources])).joined(_inside(prior, T, placed))
    final = solve_graph(held_together, T, _free(placed, node))
    final = homes.get(node, np.eye(4)) @ pose.inverse(final[node]) @ final
    final[~placed] = np.nan
    chi2 = np.full(len(edges), np.nan)
    there = np.flatnonzero(placed[graph.targets] & placed[graph.sources])
    chi2[rows[there]] = graph.part(there).chi2(np.where(placed[:, None, None], final, np.eye(4)))
    judged = []
    for k, (edge, code) in enumerate(zip(edges, codes, strict=True)):
        if code in ("used", "confirmed") and not placed[edge.source]:
            code = "elsewhere"
        judged.append(dataclasses.replace(edge, code=code, used=code in ("used", "confirmed"), chi2=float(chi2[k])))
    home_node = PART if node == count else node
    return EdgeSelection(tuple(judged), final, island[:count], home_node, loops, rows, told.confirmed, by_steps)


def _initial_code(edge: Edge, size: float) -> EdgeCode:
    """Why an edge can be of no use, or "unconfirmed"."""
    if edge.level == "failed" or not edge.found:
        return "untried" if edge.code == "untried" else "no_pose"
    if edge.code in ("opposite_sides", "looked_through", "misfit", "ambiguous", "contradicts"):
        return edge.code
    covariance = edge.registration.covariance
    free = any(motion.is_free for motion in edge.registration.observability)
    if not free:
        turn, shift = np.sqrt(np.diag(covariance)[:3].max()), np.sqrt(np.diag(covariance)[3:].max())
        if not (turn <= MAX_LOOP_SIGMA_RAD and shift <= MAX_LOOP_SIGMA_SIZES * size):
            return "uncertain"
    return "unconfirmed"


def _inside(prior: PoseGraph | None, T: FloatArray, placed: BoolArray) -> PoseGraph | None:
    """The steps between placed scans that poses agree with."""
    if prior is None:
        return None
    there = placed[prior.targets] & placed[prior.sources]
    return prior.part(np.flatnonzero(there & (prior.chi2(T) <= CHI2_LIMIT)))


def _inliers(
    graph: PoseGraph, order: IntArray, told: Confirmation, prior: PoseGraph | None
) -> tuple[FloatArray, BoolArray]:
    """Poses and edges that agree with them: from the tree of the most trusted edges by graduated non-convexity.

    Refuted edges shape the poses only where nothing else joins the scans. The steps of a table, edges like others that
    may be wrong, take part between the scans of a tree.
    """
    tree = joined_by(graph, order)
    T = _along_tree(graph, tree)
    kept = np.zeros(len(graph.targets), dtype=bool)
    if not len(order):
        return T, kept
    part = graph.part(order)
    free = _without_roots(part, np.unique(np.r_[part.targets, part.sources]))
    asked = ~told.refuted[order] | np.isin(order, tree)
    if prior is not None:
        island = islands(graph, tree)
        prior = prior.part(np.flatnonzero(island[prior.targets] == island[prior.sources]))
    T = _graduated(graph.part(order[asked]).joined(prior), T, free)
    inside = part.chi2(T) <= CHI2_LIMIT
    whole = part.joined(prior)
    steps = np.zeros(0) if prior is None else np.where(prior.chi2(T) <= CHI2_LIMIT, 1.0, 1e-9)
    T = solve_graph(whole, T, free, np.r_[np.where(inside, 1.0, 1e-9), steps])
    # An edge much sharper than its neighbours lies outside until it takes part: loops have confirmed it.
    more = inside | told.confirmed[order]
    if (more & ~inside).any():
        trial = solve_graph(whole, T, free, np.r_[np.where(more, 1.0, 1e-9), steps])
        T = trial if (part.chi2(trial)[more] <= CHI2_LIMIT).all() else T
    kept[order[part.chi2(T) <= CHI2_LIMIT]] = True
    return T, kept


def _graduated(part: PoseGraph, T: FloatArray, free: IntArray) -> FloatArray:
    """Poses by graduated non-convexity."""
    chi2 = part.chi2(T)
    worst = float(chi2.max())
    mu = CHI2_LIMIT / max(2.0 * worst - CHI2_LIMIT, 1e-9 * CHI2_LIMIT)
    weights = _truncated(chi2, mu)
    for _ in range(MAX_ROUNDS if worst > CHI2_LIMIT else 1):
        T = solve_graph(part, T, free, np.maximum(weights, 1e-9))
        chi2 = part.chi2(T)
        weights = _truncated(chi2, mu)
        mu *= CONVEXITY_FACTOR
        if ((weights < 1e-6) | (weights > 1.0 - 1e-6)).all():
            break
    return T


def _disputed(graph: PoseGraph, kept: BoolArray, left_out: BoolArray, told: Confirmation) -> BoolArray:
    """Single threads between groups of confirmed scans that an edge left out contradicts, (m,).

    No loop tells which of the two is wrong. Without the thread the groups are islands, which the verdict names; a wrong
    thread would put all that lies beyond it to a wrong place.
    """
    group = islands(graph, np.flatnonzero(kept & told.confirmed))
    ends = group[graph.targets], group[graph.sources]
    threads = np.flatnonzero(kept & (ends[0] != ends[1]))
    found = np.zeros(len(kept), dtype=bool)
    if not len(threads):
        return found
    near: dict[int, list[tuple[int, int]]] = {}
    for row in threads.tolist():
        a, b = int(ends[0][row]), int(ends[1][row])
        near.setdefault(a, []).append((b, row))
        near.setdefault(b, []).append((a, row))
    for row in np.flatnonzero(left_out & (ends[0] != ends[1])).tolist():
        between = np.array(_threads_between(near, int(ends[0][row]), int(ends[1][row])), dtype=np.int64)
        found[between[told.trust[row] >= RIVAL_TRUST_SHARE * told.trust[between]]] = True
    return found


def _threads_between(near: Mapping[int, Sequence[tuple[int, int]]], first: int, last: int) -> list[int]:
    """Rows of the threads on the way between two groups with the fewest of them; none where there is no way."""
    came, layer = {first: (first, -1)}, [first]
    while layer and last not in came:
        further = []
        for group in layer:
            for other, row in near.get(group, ()):
                if other not in came:
                    came[other] = group, row
                    further.append(other)
        layer = further
    rows = []
    while last in came and last != first:
        last, row = came[last]
        rows.append(row)
    return rows


def _truncated(chi2: FloatArray, mu: float) -> FloatArray:
    """Weights of the truncated least squares of graduated non-convexity at a stage (Yang et al. 2020, eq. 14)."""
    low, high = mu / (mu + 1.0) * CHI2_LIMIT, (mu + 1.0) / mu * CHI2_LIMIT
    middle = np.sqrt(CHI2_LIMIT * mu * (mu + 1.0) / np.maximum(chi2, 1e-12 * CHI2_LIMIT)) - mu
    return np.where(chi2 <= low, 1.0, np.where(chi2 >= high, 0.0, np.clip(middle, 0.0, 1.0)))


def _along_tree(graph: PoseGraph, tree: IntArray) -> FloatArray:
    """Poses along spanning trees; each tree from its lowest node."""
    near: dict[int, list[tuple[int, FloatArray]]] = {k: [] for k in range(graph.count)}
    for row in tree:
        i, j = int(graph.targets[row]), int(graph.sources[row])
        near[i].append((j, graph.measured[row]))
        near[j].append((i, pose.inverse(graph.measured[row])))
    T = np.tile(np.eye(4), (graph.count, 1, 1))
    seen = set()
    for first in range(graph.count):
        stack = [] if first in seen else [first]
        while stack:
            k = stack.pop()
            seen.add(k)
            for other, measured in near[k]:
                if other not in seen:
                    T[other] = T[k] @ measured
                    stack.append(other)
    return T


def _without_roots(graph: PoseGraph, nodes: IntArray) -> IntArray:
    """Nodes without the first of each connected part, which stays."""
    island = islands(graph, np.arange(len(graph.targets)))
    _, firsts = np.unique(island[nodes], return_index=True)
    return np.delete(nodes, firsts)


def _anchored(island: IntArray, node: int, count: int, homes: Mapping[int, FloatArray]) -> int:
    """The node to hold: the one asked for, unless more than twice as many scans hang together without it."""
    sizes = np.bincount(island[:count], minlength=int(island.max()) + 1)
    if node == count or 2 * sizes[island[node]] >= sizes.max():
        return node
    largest = np.flatnonzero(island[:count] == int(sizes.argmax())).tolist()
    return int(next((k for k in largest if k in homes), largest[0]))


def _free(placed: BoolArray, node: int) -> IntArray:
    free = placed.copy()
    free[node] = False
    return np.flatnonzero(free)
