"""Scans that no accepted pair holds: each is put to the test against all others together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg.errors import DqregError
from dqreg.multiway.believe import Belief
from dqreg.multiway.foreign import Judge, edges_at, placed_of
from dqreg.multiway.merge import merged
from dqreg.multiway.scans import View
from dqreg.registration.options import Effort
from dqreg.registration.register import register
from dqreg.rigid import pose

# Scans that are put to the test, those that the others stand without, and scans that make a test.
TESTED, FEWEST = 8, 3
# Motion, in sizes of a scan, by which a pose may differ from that of its pairs.
MOVED = 0.05


def without_misfits(
    views: Sequence[View], judge: Judge, belief: Belief, effort: Effort, seed: int
) -> tuple[Judge, Belief]:
    """The belief without scans that suspect pairs alone hold, and that the others together do not accept.

    Suspect pairs confirm each other by loops, and those of another object do so too where its faces meet. All other
    scans together show more than each of them: a right scan is accepted there, by the verdict on a registration.
    """
    for k in _weak(judge, belief)[:TESTED]:
        T_scan = belief.T_world_scan[k]
        if not np.isfinite(T_scan).all():
            continue
        without = judge.without(edges_at(belief, k), "misfit")
        rest = without(belief.edges)
        if placed_of(rest) < max(placed_of(belief) - 1, FEWEST) or rest.anchor != belief.anchor:
            continue
        if not _accepted(views, k, belief, rest, judge.size, effort, seed):
            judge, belief = without, rest
    return judge, belief


def _weak(judge: Judge, belief: Belief) -> list[int]:
    """Placed scans none of whose used edges is accepted by itself."""
    sure = {k for edge in belief.edges if edge.used and edge.level == "accepted" for k in (edge.target, edge.source)}
    placed = np.isfinite(belief.T_world_scan[: judge.count]).all(axis=(1, 2))
    return [k for k in np.flatnonzero(placed).tolist() if k not in sure and k != judge.home]


def _accepted(
    views: Sequence[View], k: int, belief: Belief, rest: Belief, size: float, effort: Effort, seed: int
) -> bool:
    """Whether all other scans together accept the pose of one, or one near by."""
    T, cloud = belief.T_world_scan[k], views[k].cloud
    assert cloud is not None
    others = merged(views, rest.T_world_scan[: len(views)], None)
    try:
        found = register(cloud, others, T, effort=effort, seed=seed, search="never", keep_inputs=False, units="ignore")
    except DqregError:
        return False
    if found.verdict.level != "accepted":
        return False
    middle = cloud.points.mean(axis=0)[None]
    moved = np.linalg.norm(pose.apply(found.T_target_source, middle) - pose.apply(T, middle))
    return bool(moved <= MOVED * size)
