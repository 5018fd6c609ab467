"""In which order pairs are registered, and where each begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner
from dqreg.multiway.pairwise.pairs import Order, Pair, alike_pairs
from dqreg.multiway.pairwise.starts import OTHER_POSE_RAD, OTHER_POSE_SIZES
from dqreg.multiway.pose_graph.edges import PART, Edge, better, is_refused, is_weak
from dqreg.multiway.scans.overlap import overlap_matrix
from dqreg.multiway.scans.scans import typical_size
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.turntables.turntable import on_turntable
from dqreg.rigid import pose

# Scans that overlap by less are not worth a registration from where the others put them.
MIN_OVERLAP = 0.2
# Rounds in which they are tried, and pairs of one scan.
MAX_ROUNDS, PAIRS_PER_SCAN = 2, 6


def first_edges(
    runner: PairRunner, pairs: Sequence[Pair], known: Sequence[FloatArray | None], order: Order, *, automatic: bool
) -> list[Edge]:
    """All edges that do not ask where other edges put the scans."""
    usable = [k for k, view in enumerate(runner.views) if view.usable]
    jobs = [] if runner.part is None else [PairJob(PART, k, known[k]) for k in usable]
    if automatic and order == "any" and not pairs:
        pairs = alike_pairs(runner.views, runner.seed)
    jobs += [PairJob(i, j, _between(known, i, j, order)) for i, j in pairs]
    edges = runner.run(jobs)
    # A start that led nowhere is no reason to give up.
    again = [
        k for k, (job, edge) in enumerate(zip(jobs, edges, strict=True)) if job.start is not None and is_weak(edge)
    ]
    searched = runner.run([PairJob(jobs[k].target, jobs[k].source) for k in again])
    for k, edge in zip(again, searched, strict=True):
        edges[k] = better(edges[k], edge)
    edges = _held_by_starts(runner, jobs, edges, known)
    # Given poses say where each scan is, and a table cannot say it better.
    if order == "turntable" and any(known[k] is None for k in usable):
        edges = on_turntable(runner, edges, usable)
    return edges


def _held_by_starts(
    runner: PairRunner, jobs: Sequence[PairJob], edges: list[Edge], known: Sequence[FloatArray | None]
) -> list[Edge]:
    """The edges; where a search led far from given poses, those near by if nothing speaks against these.

    A part that looks nearly the same elsewhere is accepted there too: of the two, the one that was given is meant.
    """
    far = [
        k
        for k, (job, edge) in enumerate(zip(jobs, edges, strict=True))
        if edge.found and job.start is not None and _given(known, job) and _is_far(runner, edge, job.start)
    ]
    near = runner.run([dataclasses.replace(jobs[k], near=True) for k in far])
    for k, edge in zip(far, near, strict=True):
        start = jobs[k].start
        if edge.found and not is_refused(edge) and start is not None and not _is_far(runner, edge, start):
            edges[k] = edge
    return edges


def _given(known: Sequence[FloatArray | None], job: PairJob) -> bool:
    return known[job.source] is not None and (job.target == PART or known[job.target] is not None)


def _is_far(runner: PairRunner, edge: Edge, start: FloatArray) -> bool:
    cloud, T = runner.views[edge.source].cloud, edge.registration.T_target_source
    assert cloud is not None
    shift = float(pose.offset_between(start, T, at=cloud.points.mean(axis=0)))
    return float(pose.angle_between(start, T)) > OTHER_POSE_RAD or shift > OTHER_POSE_SIZES * typical_size(runner.views)


def _between(known: Sequence[FloatArray | None], i: int, j: int, order: Order) -> FloatArray | None:
    T_i, T_j = known[i], known[j]
    if T_i is not None and T_j is not None:
        return pose.inverse(T_i) @ T_j
    return np.eye(4) if order == "sequence" and abs(i - j) == 1 else None


def with_overlapping_pairs(
    runner: PairRunner, selection: EdgeSelection, judged: Callable[[Sequence[Edge]], EdgeSelection], size: float
) -> EdgeSelection:
    """The selection after pairs that overlap, and are not joined, were registered from where the others put them."""
    tried: set[Pair] = set()
    for _ in range(MAX_ROUNDS):
        T = selection.T_world_scan[: len(runner.views)]
        wanted = [pair for pair in _overlapping(runner, selection, T, size) if pair not in tried]
        if not wanted or runner.stopped:
            return selection
        tried |= set(wanted)
        edges = list(selection.edges)
        rows = {(edge.target, edge.source): k for k, edge in enumerate(edges)}
        for edge in runner.run([PairJob(i, j, pose.inverse(T[i]) @ T[j], near=True) for i, j in wanted]):
            pair = edge.target, edge.source
            if pair not in rows:
                edges.append(edge)
            elif edge.found and (edge.level == "accepted" or not edges[rows[pair]].used):
                edges[rows[pair]] = edge
        selection = judged(edges)
    return selection


def _overlapping(runner: PairRunner, selection: EdgeSelection, T: FloatArray, size: float) -> list[Pair]:
    """Pairs that overlap and have no used edge, for each scan those that overlap most."""
    overlap = np.nan_to_num(overlap_matrix(runner.views, T, size))
    joined = {
        (e.target, e.source) for e in selection.edges if e.used or (e.code == "contradicts" and e.level == "accepted")
    }
    found: dict[Pair, None] = {}
    for k in range(len(T)):
        row = overlap[k].copy()
        row[k] = 0.0
        for other in np.argsort(-row, kind="stable")[:PAIRS_PER_SCAN]:
            pair = min(k, int(other)), max(k, int(other))
            if row[other] >= MIN_OVERLAP and pair not in joined and pair[::-1] not in joined:
                found[pair] = None
    return list(found)
