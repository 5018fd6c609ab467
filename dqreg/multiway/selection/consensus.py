"""Selections in doubt, judged anew: which scans fit together is asked of all of them, and no longer of pairs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner
from dqreg.multiway.pose_graph.edges import PART, Edge, EdgeCode
from dqreg.multiway.scans.overlap import overlap_matrix
from dqreg.multiway.selection.consistent_set import ConsistentSet, largest_consistent_set
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.selection.outlier_scans import Judge
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.solvers.motion_words import Motion
from dqreg.trust.code_sets import SETTLED_BY_LOOPS

# Scans that are compared: of fewer, a pair says as much; of more, the cloud of all is large.
MIN_SCANS, MAX_SCANS = 4, 40
# Scans that make a consistent set.
MIN_CONSISTENT_SCANS = 3
# Pairs that a scan gets whose motions are held by little.
PAIRS_PER_SCAN = 3


def by_consensus(runner: PairRunner, judge: Judge, selection: EdgeSelection) -> tuple[Judge, EdgeSelection]:
    """The selection; where scans are not placed or rest on doubted pairs alone, that of the largest consistent set."""
    usable = [k for k, view in enumerate(runner.views) if view.usable]
    few_or_many = not MIN_SCANS <= len(usable) <= MAX_SCANS
    if few_or_many or judge.home == PART or _seen(runner, usable) or not _in_doubt(selection, usable):
        return judge, selection
    if judge.steps is not None:
        # What stands in equal steps is no other object; a union of the two sides of a plate tells less.
        return judge, selection
    confirmed = frozenset(
        (selection.edges[row].target, selection.edges[row].source) for row in selection.rows[selection.confirmed]
    )
    asked = runner.views, selection.edges, judge.size, runner.effort, runner.seed
    consistent = largest_consistent_set(*asked, confirmed, runner.is_over, runner.count)
    if consistent is None or len(consistent.T) < MIN_CONSISTENT_SCANS or runner.is_over():
        return judge, selection
    if len(consistent.T) <= 0.5 * len(usable):
        # What did not grow to most of them can tell what is foreign to it, and no more.
        foreign = [edge for edge in selection.edges if edge.found and {edge.target, edge.source} & consistent.refused]
        judge = judge.without(foreign, "misfit")
        return judge, judge(selection.edges)
    for code, edges in _refuted(consistent, selection):
        judge = judge.without(edges, code)
    return judge, judge(_with_admitted(runner, consistent, selection))


def _seen(runner: PairRunner, usable: list[int]) -> bool:
    """Whether it is known from where all scans were taken: lines of sight tell then what stands where."""
    clouds = [runner.views[k].cloud for k in usable]
    return all(cloud is not None and cloud.viewpoint is not None for cloud in clouds)


def _in_doubt(selection: EdgeSelection, usable: list[int]) -> bool:
    """Whether a scan is not placed, or held by no accepted pair, no loops of pairs that all agree, and no table.

    A set of poses that were never refined together refuses right scans too: it is not asked where nobody disagrees.
    """
    used = [edge for edge in selection.edges if edge.used]
    sure = {k for edge in used if edge.level == "accepted" for k in (edge.target, edge.source)} | selection.on_steps
    if selection.is_unanimous:
        looped = set(selection.loops.nodes[selection.loops.closes].ravel().tolist())
        loose = [edge for edge in used if set(edge.registration.verdict.codes) <= SETTLED_BY_LOOPS]
        sure |= looped & {k for edge in loose for k in (edge.target, edge.source)}
    return not set(usable) <= sure


def _refuted(consistent: ConsistentSet, selection: EdgeSelection) -> Iterator[tuple[EdgeCode, list[Edge]]]:
    """Edges that contradict the set, and those of scans that it does not admit."""
    within = [edge for edge in selection.edges if edge.found and {edge.target, edge.source} <= set(consistent.T)]
    yield "contradicts", [edge for edge in within if not _agrees(consistent, edge)]
    across = [
        edge
        for edge in selection.edges
        if edge.found and (edge.target in consistent.T) != (edge.source in consistent.T)
    ]
    doubtful = [bool({edge.target, edge.source} & consistent.ambiguous) for edge in across]
    yield "ambiguous", [edge for edge, both in zip(across, doubtful, strict=True) if both]
    yield "misfit", [edge for edge, both in zip(across, doubtful, strict=True) if not both]


def _agrees(consistent: ConsistentSet, edge: Edge) -> bool:
    return consistent.close(
        edge.source, _between(consistent, edge.target, edge.source), edge.registration.T_target_source
    )


def _between(consistent: ConsistentSet, i: int, j: int) -> FloatArray:
    return np.asarray(pose.inverse(consistent.T[i]) @ consistent.T[j])


def _with_admitted(runner: PairRunner, consistent: ConsistentSet, selection: EdgeSelection) -> list[Edge]:
    """The edges, with one for each scan that was admitted and that no accepted pair of the set holds."""
    T = np.full((len(runner.views), 4, 4), np.nan)
    T[list(consistent.T)] = list(consistent.T.values())
    overlap = np.nan_to_num(overlap_matrix(runner.views, T, consistent.size))
    np.fill_diagonal(overlap, 0.0)
    found = {(edge.target, edge.source): edge for edge in selection.edges}
    held = {
        k
        for edge in selection.edges
        if edge.level == "accepted" and {edge.target, edge.source} <= set(consistent.T) and _agrees(consistent, edge)
        for k in (edge.target, edge.source)
    }
    jobs = []
    for k, (registration, against) in consistent.admitted.items():
        if k in held:
            continue
        near = [int(j) for j in np.argsort(-overlap[k], kind="stable")[:PAIRS_PER_SCAN] if overlap[k, j] > 0.0]
        if registration.verdict.level == "accepted" and near:
            found.pop((k, near[0]), None)
            found[near[0], k] = Edge(near[0], k, _in_frame(registration, consistent.T[near[0]], against))
        else:
            jobs += [PairJob(j, k, _between(consistent, j, k), near=True) for j in near]
    for edge in runner.run(jobs):
        if edge.found:
            found.pop((edge.source, edge.target), None)
            found[edge.target, edge.source] = edge
    return list(found.values())


def _in_frame(registration: Registration, T_set_scan: FloatArray, against: tuple[int, ...]) -> Registration:
    """A registration to the whole set as one to a scan of it: the same motion, covariance and axes in its frame."""
    T_j_set = pose.inverse(T_set_scan)
    R = np.zeros((6, 6))
    R[:3, :3] = R[3:, 3:] = T_j_set[:3, :3]
    held = []
    for motion in registration.observability:
        axis, point = T_j_set[:3, :3] @ motion.axis, pose.apply(T_j_set, np.array([motion.point]))[0]
        words = motion.words
        if motion.kind is not None and np.isfinite(axis).all():
            words = Motion(motion.kind, tuple(axis.tolist()), tuple(point.tolist())).words
        held.append(dataclasses.replace(motion, axis=tuple(axis.tolist()), point=tuple(point.tolist()), words=words))
    centre = np.asarray(registration.settings.get("centre", np.zeros(3)), dtype=np.float64)
    known = registration.partial_information
    return dataclasses.replace(
        registration,
        T_target_source=T_j_set @ registration.T_target_source,
        covariance=R @ registration.covariance @ R.T,
        partial_information=None if known is None else R @ known @ R.T,
        observability=tuple(held),
        alternatives=(),
        history=(),
        settings={
            **registration.settings,
            "centre": pose.apply(T_j_set, centre[None])[0].tolist(),
            "against": list(against),
        },
    )
