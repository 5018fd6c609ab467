"""The axis and the step of a turntable, from the screws of its motions, and the pairs that begin there."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner
from dqreg.multiway.pairwise.pairs import Pair
from dqreg.multiway.pose_graph.edges import PART, Edge, better, is_refused, is_weak
from dqreg.multiway.scans.scans import typical_size
from dqreg.multiway.turntables.wobble import lines_of_rivals, wobble
from dqreg.rigid import DualQuaternion, pose

# Screws that agree: angle between axes, and difference of the steps.
SAME_AXIS_RAD, SAME_STEP_RAD = np.deg2rad(6.0), np.deg2rad(6.0)
# Distance of their axes, in sizes of the motion.
SAME_AXIS_SIZES = 0.1
# Agreeing pairs, at least: two may agree by chance.
MIN_AGREEING_PAIRS = 3
# Steps this many times as far from the middle one as half of them are others; so are pairs, and beyond this share of
# the way between two views: where the part looks nearly the same after a small motion.
OUTLYING_SCATTERS, OTHER_STEP_SHARE = 5.0, 0.02


@dataclasses.dataclass(frozen=True)
class TableStep:
    """A turntable: each view is the one before it, turned by one step about the axis."""

    step: DualQuaternion  # The motion T_k_(k+1) between neighbouring views, as one screw
    agreeing: int  # Pairs that it follows from
    scatter: float = np.inf  # Distance of a step from the middle one that half of them are within

    def contradicts(self, edge: Edge, places: int) -> bool:
        """Whether a pair so many places apart is far off, in view of how well the steps agree."""
        if not edge.found:
            return False
        said = (self.step ** float(places)).as_matrix()
        far = float(_distances(edge.registration.T_target_source[None], said)[0])
        return far > max(OUTLYING_SCATTERS * abs(places) * self.scatter, OTHER_STEP_SHARE)

    def between(self, i: int, j: int) -> FloatArray:
        """T_i_j that the table says of two places in the order, (4, 4)."""
        return (self.step ** float(j - i)).as_matrix()

    @property
    def step_deg(self) -> float:
        """Angle of a step, degrees."""
        return float(np.rad2deg(self.step.as_screw().angle_rad))


def step_of(steps: Sequence[tuple[int, Edge]], count: int) -> TableStep | None:
    """The step that most pairs of neighbours agree on; None where fewer than three do.

    ``steps`` are the numbers of places from target to source, with their edges. Each neighbour's motion is a
    hypothesis; those that agree with the best are averaged as dual quaternions, each by its verdict.
    """
    single = [edge.registration.T_target_source for n, edge in steps if n == 1 and edge.found]
    single += [pose.inverse(edge.registration.T_target_source) for n, edge in steps if n == -1 and edge.found]
    # The last view's neighbour is the first one, where the table went all the way round.
    single += [pose.inverse(e.registration.T_target_source) for n, e in steps if n == count - 1 > 1 and e.found]
    if len(single) < MIN_AGREEING_PAIRS:
        return None
    motions = np.array(single)
    size = float(np.median(np.linalg.norm(motions[:, :3, 3], axis=1))) + np.finfo(float).tiny
    best: list[int] = []
    for guess in motions:
        turned = pose.angle_between(motions, guess)
        shifted = np.linalg.norm(motions[:, :3, 3] - guess[:3, 3], axis=1)
        agrees = np.flatnonzero(
            (np.asarray(turned) <= SAME_STEP_RAD) & (shifted <= SAME_AXIS_SIZES * size + SAME_AXIS_RAD * size)
        )
        best = agrees.tolist() if len(agrees) > len(best) else best
    if len(best) < MIN_AGREEING_PAIRS:
        return None
    near = motions[best]
    apart = np.array([_distances(near, motion) for motion in near])
    middle = int(np.median(apart, axis=1).argmin())
    scatter = float(np.median(apart[middle]))
    near = near[apart[middle] <= max(OUTLYING_SCATTERS * scatter, np.finfo(float).eps)]
    return TableStep(mean_motion(near), len(near), scatter) if len(near) >= MIN_AGREEING_PAIRS else None


def step_by_axis(steps: Sequence[tuple[int, Edge]], size: float) -> TableStep | None:
    """The step by which the part's axis goes round, where pairs name other poses about it: they may be a tooth off."""
    told = wobble(lines_of_rivals([(edge, n == -1) for n, edge in steps if abs(n) == 1]), size)
    return None if told is None else TableStep(DualQuaternion.from_matrix(told.motion), told.agreeing, told.scatter)


def _distances(motions: FloatArray, motion: FloatArray) -> FloatArray:
    """Rotations, and translations as fractions of the way, by which motions differ from one, (n,)."""
    way = float(np.linalg.norm(motion[:3, 3])) + np.finfo(float).tiny
    shifts = np.linalg.norm(motions[:, :3, 3] - motion[:3, 3], axis=1) / way
    return np.asarray(np.asarray(pose.angle_between(motions, motion)) + shifts)


def mean_motion(motions: FloatArray) -> DualQuaternion:
    """The motion in the middle of several close ones: mean of their dual quaternions, back on the constraints."""
    all_of_them = [DualQuaternion.from_matrix(T) for T in motions]
    first = all_of_them[0]
    signs = [1.0 if float(dq.real @ first.real) >= 0.0 else -1.0 for dq in all_of_them]
    real = np.mean([sign * dq.real for sign, dq in zip(signs, all_of_them, strict=True)], axis=0)
    dual = np.mean([sign * dq.dual for sign, dq in zip(signs, all_of_them, strict=True)], axis=0)
    length = float(np.linalg.norm(real))
    real, dual = real / length, dual / length
    return DualQuaternion(real, dual - float(real @ dual) * real)


def on_turntable(runner: PairRunner, edges: list[Edge], usable: Sequence[int]) -> list[Edge]:
    """Neighbours that failed begin again one step of the table on, and so do those two steps apart.

    Scans that nothing accepted holds may be of something else: without them, their neighbours are one step apart.
    """
    place = {scan: k for k, scan in enumerate(usable)}
    steps = [(place[edge.source] - place[edge.target], edge) for edge in edges if edge.target != PART]
    table = step_of(steps, len(usable)) or step_by_axis(steps, typical_size(runner.views))
    if table is None:
        return edges
    odd = [ends for ends, places, edge in _neighbours(edges, place) if table.contradicts(edge, places)]
    edges = _by_steps(runner, edges, usable, table, odd)
    held = {scan for edge in edges if edge.level == "accepted" for scan in (edge.target, edge.source)}
    inner = [scan for scan in usable if scan in held]
    return _by_steps(runner, edges, inner, table) if 2 < len(inner) < len(usable) else edges


def _neighbours(edges: Sequence[Edge], place: Mapping[int, int]) -> Iterator[tuple[Pair, int, Edge]]:
    """Edges between scans one after the other: a scan of something else in between does not mislead there."""
    for edge in edges:
        if edge.target != PART and abs(place[edge.source] - place[edge.target]) in (1, len(place) - 1):
            yield (edge.target, edge.source), place[edge.source] - place[edge.target], edge


def _by_steps(
    runner: PairRunner, edges: Sequence[Edge], scans: Sequence[int], table: TableStep, odd: Sequence[Pair] = ()
) -> list[Edge]:
    """The edges with those of scans one and two steps apart, begun where the table says, where they were weak.

    So do the odd ones, which are elsewhere: a pose that nothing speaks against counts more where the table puts them.
    What ends elsewhere than it began at the table tells nothing.
    """
    count, found = len(scans), {(edge.target, edge.source): edge for edge in edges}
    jobs: dict[Pair, tuple[PairJob, int]] = {}
    for apart in (1, 2) if count > 4 else (1,):
        for k in range(count):
            i, j = sorted((k, (k + apart) % count))
            pair = scans[i], scans[j]
            if pair not in found or is_weak(found[pair]) or pair in odd:
                jobs[pair] = PairJob(*pair, table.between(i, j), near=True), j - i
    for edge, (pair, (_, places)) in zip(runner.run([job for job, _ in jobs.values()]), jobs.items(), strict=True):
        old = found.get(pair)
        if edge.found and table.contradicts(edge, places):
            continue
        as_good = edge.found and old is not None and (not is_refused(edge) or is_weak(old))
        found[pair] = edge if old is None or (pair in odd and as_good) else better(old, edge)
    return list(found.values())
