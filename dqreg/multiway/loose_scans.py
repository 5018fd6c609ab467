"""Doubts about how scans hang together: on pairs that nothing confirms, or that others contradict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import BoolArray, IntArray
from dqreg.multiway.pose_graph.edges import PART, Edge, is_refused
from dqreg.multiway.scan_names import named, pairs_named
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.trust.records import Reason

# Loops that confirm a scan none of whose edges is accepted.
MIN_CONFIRMING_LOOPS = 2
# Accepted pairs left out that agree on another place of a scan, as a share of those used at it, from which on nobody
# can tell which of them are wrong.
MAX_RIVAL_PAIRS_SHARE = 0.8


def used_loops(selection: EdgeSelection) -> BoolArray:
    """Which loops close on used edges alone, (l,)."""
    used = np.array([selection.edges[row].used for row in selection.rows], dtype=bool)
    loops = selection.loops
    return loops.closes & used[loops.edges].all(axis=1) if len(loops.edges) else np.zeros(0, dtype=bool)


def has_alternatives(edge: Edge) -> bool:
    """Whether other poses explain a pair about as well."""
    return bool(edge.registration.alternatives)


def weakly_held(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Scans that hang on suspect edges alone, which too few loops confirm, or on edges with other likely poses."""
    closing = selection.loops.counts(used_loops(selection), len(selection.rows))
    confirmed = {int(row): int(n) for row, n in zip(selection.rows, closing, strict=True)}
    sure, ambiguous = set(), []
    for row, edge in enumerate(selection.edges):
        if edge.used and (edge.level == "accepted" or confirmed.get(row, 0) >= MIN_CONFIRMING_LOOPS):
            sure |= {edge.source, edge.target}
    weak = [k for k in placed if k not in sure]
    assumed = [k for k in weak if k in selection.on_steps]
    if assumed:
        yield Reason(
            f"{named(views, assumed)}: no pair is accepted by itself, and that they stand where equal steps of the "
            "table, or the starts, put them confirms the pose: what their pairs do not hold is assumed; scan more "
            "overlap there",
            "unconfirmed_scan",
        )
    weak = [k for k in weak if k not in assumed]
    if weak and len(placed) > 1:
        yield Reason(
            f"{named(views, weak)}: no pair is accepted by itself and fewer than {MIN_CONFIRMING_LOOPS} loops confirm "
            "the pose",
            "unconfirmed_scan",
        )
    for k in placed:
        own = [edge for edge in selection.edges if edge.used and k in (edge.source, edge.target)]
        if own and all(has_alternatives(edge) for edge in own):
            ambiguous.append(k)
    if ambiguous:
        yield Reason(
            f"{named(views, ambiguous)}: each pair has other poses that are equally likely (a symmetric part, or too "
            "little shape in the overlap)",
            "alternative_poses",
        )


def put_elsewhere(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Scans that about as many accepted pairs, left out, put to one other place: they close loops with used pairs."""
    edges = [selection.edges[row] for row in selection.rows]
    used = np.array([edge.used for edge in edges], dtype=bool)
    left_out = np.array([edge.code == "contradicts" and edge.level == "accepted" for edge in edges], dtype=bool)
    triples = selection.loops.edges[selection.loops.closes]
    agree = (left_out[triples].sum(axis=1) == 2) & used[triples].any(axis=1)
    others: dict[int, set[int]] = {}
    for triple in triples[agree].tolist():
        pair = [row for row in triple if left_out[row]]
        one, other = ({edges[row].target, edges[row].source} for row in pair)
        others.setdefault((one & other).pop(), set()).update(pair)
    held = [sum(edge.used and k in (edge.target, edge.source) for edge in edges) for k in range(len(views))]
    doubted = [k for k in placed if len(others.get(k, ())) > MAX_RIVAL_PAIRS_SHARE * held[k]]
    if doubted:
        yield Reason(
            f"{named(views, doubted)}: about as many accepted pairs as hold them agree on another place; scan more "
            "overlap there, or leave out the pairs that are wrong",
            "alternative_poses",
        )


def unconfirmed(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Pairs that nothing else makes up for, and that no closing loop confirms or whose own verdicts doubt them.

    Doubted pairs confirm each other where all are wrong alike: the two sides of a sheet on each other, from every side.
    """
    if len(placed) + (selection.anchor == PART) > 2:
        confirmed = set(selection.rows[selection.confirmed].tolist())
        sound = [edge for row, edge in enumerate(selection.edges) if edge.used and row in confirmed]
        yield from _single_links(views, selection, sound, "no closing loop confirms these pairs")
    sound = [edge for edge in selection.edges if edge.used and not is_refused(edge)]
    yield from _single_links(views, selection, sound, "the registration of each of these pairs is doubted")


def _single_links(views: Sequence[View], selection: EdgeSelection, sound: Sequence[Edge], why: str) -> Iterator[Reason]:
    """Used edges between groups of scans that sound ones do not join."""
    group = _joined(sound, len(views))
    alone = [edge for edge in selection.edges if edge.used and group[edge.target] != group[edge.source]]
    if alone:
        words = pairs_named(views, [(edge.target, edge.source) for edge in alone])
        yield Reason(f"{words}: {why}, and nothing else joins their scans: scan more overlap there", "unconfirmed_edge")


def _joined(edges: Sequence[Edge], count: int) -> IntArray:
    """Number of the connected part of each scan, and of the part in the last place, (n + 1,)."""
    ends = np.array([(edge.target % (count + 1), edge.source) for edge in edges]).reshape(-1, 2).astype(np.int64)
    links = sparse.coo_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(count + 1, count + 1))
    return np.asarray(sparse.csgraph.connected_components(links, directed=False)[1], dtype=np.int64)
