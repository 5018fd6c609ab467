"""Views of a part that looks the same however it is turned: pairs hold five motions, and the sixth is agreed upon.

The angles about the axis are those of the starts, or those of a turntable (from how the axis wobbles on it, else equal
steps of a full turn), or those at which the pairs happen to overlap. All pairs are laid at them; what is handed out
leaves that motion free.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner
from dqreg.multiway.pairwise.pairs import Order, Pair
from dqreg.multiway.pose_graph.edges import PART, Edge, graph_of, is_refused
from dqreg.multiway.pose_graph.loop_confirmation import joined_by
from dqreg.multiway.refinement.refine import Refined
from dqreg.multiway.scans.scans import typical_size
from dqreg.multiway.turntables.wobble import Line, moved_line, wobble
from dqreg.rigid import DualQuaternion, pose
from dqreg.trust.code_sets import HARDLY_HELD

# Share of the pairs that must leave the rotation about one axis next to unheld, and pairs at least.
MIN_FREE_SHARE, MIN_PAIRS = 0.5, 3
# Axes that are one: angle, and distance in sizes of a scan.
SAME_AXIS_RAD, SAME_AXIS_SIZES = np.deg2rad(6.0), 0.05
# Share of them that must agree.
MIN_AGREEING_SHARE = 0.7
# All steps that come this close to a full turn, as a share of it, are one.
FULL_TURN_SHARE = 0.05
# Variance of an angle of which nothing is known.
UNKNOWN_ANGLE_VARIANCE = np.pi**2 / 3.0

Agreed = Literal["starts", "wobble", "step", "pairs"]


@dataclasses.dataclass(frozen=True)
class RoundPart:
    """The axis of a round part in the frames of its scans, and where the angles about it come from."""

    lines: tuple[tuple[int, Line], ...]  # Scan and axis
    agreed: Agreed
    step_rad: float = 0.0

    def axis(self, T_world_scan: FloatArray) -> Line:
        """The axis in the world frame, of the placed scans."""
        there = [(T_world_scan[k], line) for k, line in self.lines if np.isfinite(T_world_scan[k]).all()]
        return _mean([(T[:3, :3] @ axis, pose.apply(T, point[None])[0]) for T, (axis, point) in there])

    def freed(self, edges: Iterable[Edge]) -> list[Edge]:
        """The edges, of which those that leave the rotation unheld say that it is free."""
        return [_freed(edge) if edge.found and _line_of(edge) is not None else edge for edge in edges]

    def widened(self, joint: Refined, anchor: int) -> Refined:
        """The poses with any angle about the axis in their covariance, but for the scan that is held."""
        axis, point = self.axis(joint.T_world_scan)
        along = np.r_[axis, np.cross(axis, joint.centre - point)]
        covariance = joint.covariance.copy()
        for k, T in enumerate(joint.T_world_scan):
            if k != anchor and np.isfinite(T).all():
                covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += UNKNOWN_ANGLE_VARIANCE * np.outer(along, along)
        return dataclasses.replace(joint, covariance=covariance)


def laid_by_angles(
    runner: PairRunner, edges: list[Edge], known: Sequence[FloatArray | None], order: Order
) -> tuple[list[Edge], RoundPart | None]:
    """The edges, at angles that fit together where the part looks round; else as they are."""
    lines = [(edge, line) for edge in edges if (line := _line_of(edge)) is not None]
    found = [edge for edge in edges if edge.found and edge.target != PART]
    if len(lines) < MIN_PAIRS or len(lines) <= MIN_FREE_SHARE * len(found) or len(found) < len(edges) * MIN_FREE_SHARE:
        return edges, None
    size = typical_size(runner.views)
    own = [(edge.target, line) for edge, line in lines]
    own += [(e.source, moved_line(pose.inverse(e.registration.T_target_source), line)) for e, line in lines]
    if _agreement(own, size) < MIN_AGREEING_SHARE:
        return edges, None
    pairs = [(edge.target, edge.source) for edge in edges if edge.target != PART]
    usable = [k for k, view in enumerate(runner.views) if view.usable]
    if all(known[k] is not None for k in usable):
        starts = {k: T for k in usable if (T := known[k]) is not None}
        # Loops need pairs two places apart too, where neighbours alone were asked for.
        pairs = list(dict.fromkeys(pairs if order == "any" else [*pairs, *_neighbours(usable)]))
        return _laid(runner, pairs, starts, own), RoundPart(tuple(own), "starts")
    if order == "turntable":
        place = {scan: k for k, scan in enumerate(usable)}
        M = _step_by_wobble([each for each in lines if place[each[0].source] - place[each[0].target] == 1], size)
        if M is not None:
            step = _whole(M, len(usable))
            turns = {scan: (step ** float(k)).as_matrix() for k, scan in enumerate(usable)}
            return _laid(runner, _neighbours(usable), turns, own), RoundPart(tuple(own), "wobble")
        if _share_alike([line for _, line in own], size) >= MIN_AGREEING_SHARE:
            return _by_full_turn(runner, own, usable)
    return _laid(runner, pairs, _along_surest(lines, len(runner.views)), own), RoundPart(tuple(own), "pairs")


def _by_full_turn(runner: PairRunner, own: list[tuple[int, Line]], usable: list[int]) -> tuple[list[Edge], RoundPart]:
    """Equal steps of a full turn about the common axis, the way that more points agree with."""
    axis, point = _mean([line for _, line in own])
    trials = []
    for step in (2.0 * np.pi / len(usable), -2.0 * np.pi / len(usable)):
        turns = {
            scan: pose.about(pose.exp(np.r_[k * step * axis, np.zeros(3)]), point) for k, scan in enumerate(usable)
        }
        edges = _laid(runner, _neighbours(usable), turns, own)
        agreeing = sum(edge.registration.inlier_fraction for edge in edges if edge.found and not is_refused(edge))
        trials.append((agreeing, edges, step))
    _, edges, step = max(trials, key=lambda trial: trial[0])
    return edges, RoundPart(tuple(own), "step", step)


def _neighbours(usable: Sequence[int]) -> list[Pair]:
    """Pairs one and two places apart, all the way round."""
    count = len(usable)
    places = [sorted((k, (k + apart) % count)) for apart in (1, 2) for k in range(count)]
    return list(dict.fromkeys((usable[i], usable[j]) for i, j in places if i != j))


def _step_by_wobble(edges: Sequence[tuple[Edge, Line]], size: float) -> FloatArray | None:
    """The motion from one view of a turntable to the next, of neighbours with their axes."""
    told = wobble([(line, moved_line(pose.inverse(e.registration.T_target_source), line)) for e, line in edges], size)
    return None if told is None else told.motion


def _whole(M: FloatArray, count: int) -> DualQuaternion:
    """The step, so that all steps make a full turn where they nearly do."""
    step = DualQuaternion.from_matrix(M)
    share = 2.0 * np.pi / count / float(np.linalg.norm(pose.log(M)[:3]))
    return step**share if abs(share - 1.0) <= FULL_TURN_SHARE else step


def _laid(
    runner: PairRunner, pairs: Sequence[Pair], T: Mapping[int, FloatArray], own: Sequence[tuple[int, Line]]
) -> list[Edge]:
    """Pairs registered from poses, and turned back to the angle that these had."""
    axes = {scan: _mean([line for k, line in own if k == scan]) for scan in {k for k, _ in own}}
    jobs = [PairJob(i, j, pose.inverse(T[i]) @ T[j], near=True) for i, j in pairs if i in T and j in T and i in axes]
    return [_turned_back(edge, job.start, axes[job.target]) for job, edge in zip(jobs, runner.run(jobs), strict=True)]


def _turned_back(edge: Edge, start: FloatArray | None, line: Line) -> Edge:
    """The edge at the angle of its start about the axis; an accepted one that stayed near holds its own."""
    if start is None or not edge.found:
        return edge
    T = edge.registration.T_target_source
    slid = float(pose.log(T @ pose.inverse(start))[:3] @ line[0])
    if edge.level == "accepted" and abs(slid) <= SAME_AXIS_RAD:
        return edge
    back = pose.about(pose.exp(np.r_[-slid * line[0], np.zeros(3)]), line[1])
    return dataclasses.replace(edge, registration=dataclasses.replace(edge.registration, T_target_source=back @ T))


def _along_surest(lines: Sequence[tuple[Edge, Line]], count: int) -> dict[int, FloatArray]:
    """Poses along the tree of the pairs that overlap most, from the first scan."""
    edges = [edge for edge, _ in lines]
    order = np.argsort([-edge.registration.inlier_fraction for edge in edges], kind="stable")
    tree = [edges[row] for row in joined_by(graph_of(edges, count), order)]
    T = {tree[0].target: np.eye(4)}
    for _ in tree:
        for edge in tree:
            T_edge = edge.registration.T_target_source
            if edge.target in T and edge.source not in T:
                T[edge.source] = T[edge.target] @ T_edge
            elif edge.source in T and edge.target not in T:
                T[edge.target] = T[edge.source] @ pose.inverse(T_edge)
    return T


def _line_of(edge: Edge) -> Line | None:
    """The axis, in the target's frame, about which next to nothing holds a pair that is right else."""
    said = edge.registration
    loose = HARDLY_HELD & set(said.verdict.codes)
    if not edge.found or edge.target == PART or not loose or is_refused(edge) or not said.observability:
        return None
    motion = said.observability[0]
    axis, point = np.array(motion.axis), np.array(motion.point)
    return (axis, point) if motion.kind == "rotation" and np.isfinite([axis, point]).all() else None


def _freed(edge: Edge) -> Edge:
    """The edge with any angle about its axis in its covariance: its inverse holds the five other motions as before."""
    said = edge.registration
    motion = said.observability[0]
    centre = np.asarray(said.settings.get("centre", np.zeros(3)), dtype=np.float64)
    along = np.r_[motion.axis, np.cross(motion.axis, centre - np.array(motion.point))]
    covariance = said.covariance + UNKNOWN_ANGLE_VARIANCE * np.outer(along, along)
    sigma = float(np.sqrt(UNKNOWN_ANGLE_VARIANCE)) * 0.5 * float(said.settings["diagonal"])
    held = (dataclasses.replace(motion, strength=0.0, sigma=sigma), *said.observability[1:])
    return dataclasses.replace(edge, registration=dataclasses.replace(said, covariance=covariance, observability=held))


def _agreement(own: Sequence[tuple[int, Line]], size: float) -> float:
    """Share of the axes that agree with most of those in the frame of the same scan."""
    scans = sorted({k for k, _ in own})
    shares = [(len(lines), _share_alike(lines, size)) for k in scans if len(lines := [x for j, x in own if j == k]) > 1]
    total = sum(count for count, _ in shares)
    return sum(count * share for count, share in shares) / total if total else 0.0


def _share_alike(lines: Sequence[Line], size: float) -> float:
    """Largest share of lines that are one with one of them."""
    axes, points = (np.array([line[row] for line in lines]) for row in (0, 1))
    shares = []
    for axis, point in lines:
        turned = np.arccos(np.clip(np.abs(axes @ axis), 0.0, 1.0))
        apart = np.linalg.norm(np.cross(points - point, axis), axis=1)
        shares.append(float(np.mean((turned <= SAME_AXIS_RAD) & (apart <= SAME_AXIS_SIZES * size))))
    return max(shares)


def _mean(lines: Sequence[Line]) -> Line:
    """The line in the middle of lines that are about one."""
    axes, points = (np.array([line[row] for line in lines]) for row in (0, 1))
    axes = axes * np.where(axes @ axes[0] < 0.0, -1.0, 1.0)[:, None]
    axis = np.median(axes, axis=0)
    axis = axis / np.linalg.norm(axis)
    across = points - np.outer(points @ axis, axis)
    return axis, np.median(across, axis=0) + axis * float(np.median(points @ axis))
