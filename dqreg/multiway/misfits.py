"""Scans that no accepted pair holds are tested against all others together; those left out are looked for there."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DqregError
from dqreg.geometry import PointCloud
from dqreg.multiway.believe import Belief
from dqreg.multiway.edges import Edge, centre_of
from dqreg.multiway.foreign import Judge, edges_at, ends_of, placed_of
from dqreg.multiway.merge import merged
from dqreg.multiway.overlap import overlap_matrix
from dqreg.multiway.scans import View
from dqreg.registration.options import Effort
from dqreg.registration.register import register
from dqreg.rigid import pose

# Scans that are put to the test, those that the others stand without, and scans that make a test.
TESTED, FEWEST = 8, 3
# What may be doubted of a scan that fits: how well its motions are known.
UNHELD = frozenset({"weakly_constrained", "unconstrained", "large_uncertainty"})
# Motion, in sizes of a scan, by which a pose may differ from that of its pairs.
MOVED = 0.05


def without_misfits(
    views: Sequence[View], judge: Judge, belief: Belief, effort: Effort, seed: int
) -> tuple[Judge, Belief]:
    """The belief without scans that suspect pairs alone hold, and that the others together do not accept.

    Suspect pairs confirm each other by loops, and those of another object do so too where its faces meet. All other
    scans together show more than each of them: a right scan fits there, by the verdict on a registration.
    """
    for k in _weak(judge, belief)[:TESTED]:
        T_scan = belief.T_world_scan[k]
        if not np.isfinite(T_scan).all():
            continue
        without = judge.without(edges_at(belief, k), "misfit")
        rest = without(belief.edges)
        if placed_of(rest) < max(placed_of(belief) - 1, FEWEST) or rest.anchor != belief.anchor:
            continue
        if not _fits(views, k, belief, rest, judge.size, effort, seed):
            judge, belief = without, rest
    return judge, belief


def regained(views: Sequence[View], judge: Judge, belief: Belief, effort: Effort, seed: int) -> tuple[Judge, Belief]:
    """The belief with scans that no pair places and that all others together accept, looked for from nothing.

    All others together show more than any of them. Where they accept a scan, it gets an edge to the one that it
    overlaps most, and what was held against its other edges is judged anew.
    """
    tried = 0
    for k, view in enumerate(views):
        lost = view.usable and not np.isfinite(belief.T_world_scan[k]).all()
        if not lost or tried == TESTED or placed_of(belief) < FEWEST:
            continue
        tried += 1
        edge = _edge_to_all(views, k, belief, judge, effort, seed)
        if edge is None:
            continue
        refuted = {ends: code for ends, code in judge.refuted.items() if k not in ends}
        trial = dataclasses.replace(judge, refuted=refuted)
        others = [old for old in belief.edges if ends_of(old) not in (ends_of(edge), ends_of(edge)[::-1])]
        after = trial([*others, edge])
        worse = np.count_nonzero(trial.contradictions(after)) > np.count_nonzero(judge.contradictions(belief))
        if placed_of(after) > placed_of(belief) and not worse:
            judge, belief = trial, after
    return judge, belief


def _edge_to_all(views: Sequence[View], k: int, belief: Belief, judge: Judge, effort: Effort, seed: int) -> Edge | None:
    """Edge of a scan to the one that it overlaps most, from all placed ones; None unless they accept it."""
    T, cloud = belief.T_world_scan[: len(views)].copy(), views[k].cloud
    assert cloud is not None
    try:
        found = register(cloud, _model(views, T), effort=effort, seed=seed, keep_inputs=False, units="ignore")
    except DqregError:
        return None
    if found.verdict.level != "accepted" or not np.isfinite(found.covariance).all():
        return None
    T[k] = found.T_target_source
    row = np.nan_to_num(overlap_matrix(views, T, judge.size)[k])
    row[k] = 0.0
    target = int(row.argmax())
    inward = pose.inverse(T[target])
    turn = pose.adjoint(pose.from_parts(inward[:3, :3], np.zeros(3)))
    moved = dataclasses.replace(
        found,
        T_target_source=inward @ T[k],
        covariance=turn @ found.covariance @ turn.T,
        observability=(),
        alternatives=(),
        history=(),
        settings={**found.settings, "centre": pose.apply(inward, centre_of(found)).tolist()},
    )
    return Edge(target, k, moved)


def _weak(judge: Judge, belief: Belief) -> list[int]:
    """Placed scans none of whose used edges is accepted by itself."""
    sure = {k for edge in belief.edges if edge.used and edge.level == "accepted" for k in (edge.target, edge.source)}
    placed = np.isfinite(belief.T_world_scan[: judge.count]).all(axis=(1, 2))
    return [k for k in np.flatnonzero(placed).tolist() if k not in sure and k != judge.home]


def _fits(views: Sequence[View], k: int, belief: Belief, rest: Belief, size: float, effort: Effort, seed: int) -> bool:
    """Whether nothing in all other scans together speaks against the pose of one, or one near by."""
    T, cloud = belief.T_world_scan[k], views[k].cloud
    assert cloud is not None
    others = _model(views, rest.T_world_scan[: len(views)])
    try:
        found = register(cloud, others, T, effort=effort, seed=seed, search="never", keep_inputs=False, units="ignore")
    except DqregError:
        return False
    if found.verdict.level != "accepted" and not set(found.verdict.codes) <= UNHELD:
        return False
    middle = cloud.points.mean(axis=0)[None]
    moved = np.linalg.norm(pose.apply(found.T_target_source, middle) - pose.apply(T, middle))
    return bool(moved <= MOVED * size)


def _model(views: Sequence[View], T_world_scan: FloatArray) -> PointCloud:
    """All placed scans as one cloud, with normals only where all their signs are known."""
    model = merged(views, T_world_scan, None)
    placed = [k for k, view in enumerate(views) if view.usable and np.isfinite(T_world_scan[k]).all()]
    return model if all(views[k].scan.oriented for k in placed) else PointCloud(model.points)
