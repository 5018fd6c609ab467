"""The step of a turntable from how the part's own axis goes round on it: pairs turned about that axis tell it too.

Of a round part pairs hold every motion but one, and of a part with many like teeth or holes they may stand a tooth off:
either way points of the axis are the same in both scans of a pair.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.multiway.pose_graph.edges import Edge, centre_of, is_refused
from dqreg.rigid import DualQuaternion, pose
from dqreg.solvers import solve

Line = tuple[FloatArray, FloatArray]  # Unit vector, and a point

# Pairs, at least, that must agree, and of most of them.
MIN_PAIRS, MIN_AGREEING_SHARE = 3, 0.5
# Distance in sizes of a scan at which the ends of an axis, half a size from its middle, agree.
SAME_AXIS_SIZES = 0.05
# Error of a step, and least step, that a wobbling axis may leave.
MAX_STEP_ERROR_RAD, MIN_STEP_RAD = np.deg2rad(4.0), np.deg2rad(2.0)
# A pose and its rival stand a rotation apart: by this angle at least, and this slide in sizes at most.
MIN_RIVAL_TURN_RAD, MAX_RIVAL_SLIDE_SIZES = np.deg2rad(5.0), 0.01


def moved_line(T: FloatArray, line: Line) -> Line:
    """The line in another frame."""
    return T[:3, :3] @ line[0], pose.apply(T, line[1][None])[0]


@dataclasses.dataclass(frozen=True)
class Wobble:
    """The motion from one view of a turntable to the next."""

    motion: FloatArray  # (4, 4)
    scatter: float  # Angle by which the axes miss it
    agreeing: int  # Pairs whose axes do not


def wobble(lines: Sequence[tuple[Line, Line]], size: float) -> Wobble | None:
    """The motion that most axes agree with; None where they tell none.

    Lines are of neighbours: the part's axis in the frame of the first, and in that of the second. Pairs that have it
    elsewhere are left out.
    """
    if len(lines) < MIN_PAIRS:
        return None
    there, here = (
        np.array([point + np.outer([-0.5 * size, 0.5 * size], axis) for axis, point in each])
        for each in zip(*lines, strict=True)
    )
    best = np.zeros(len(lines), dtype=bool)
    for two in combinations(range(len(lines)), 2):
        M = _motion(here[list(two)], there[list(two)])
        agree = best if M is None else _missed(M, here, there) <= SAME_AXIS_SIZES * size
        best = agree if agree.sum() > best.sum() else best
    if best.sum() < max(MIN_PAIRS, MIN_AGREEING_SHARE * len(lines)):
        return None
    here, there = here[best], there[best]
    M = _motion(here, there)
    if M is None:
        return None
    missed = float(np.sqrt(np.mean(_missed(M, here, there) ** 2)))
    screw = DualQuaternion.from_matrix(M).as_screw()
    turn = float(screw.angle_rad)
    # Ends on the table's own axis tell nothing, wherever along it they are.
    levers = float(np.sqrt(np.mean(np.sum(np.cross(there.reshape(-1, 3) - screw.point, screw.axis) ** 2, axis=1))))
    told = missed / np.sqrt(len(here)) <= MAX_STEP_ERROR_RAD * levers and turn > MIN_STEP_RAD
    return Wobble(M, missed / levers, len(here)) if told else None


def lines_of_rivals(steps: Sequence[tuple[Edge, bool]]) -> list[tuple[Line, Line]]:
    """Axes of neighbouring views, about which pairs name other poses; whether a pair is from the second to the first.

    A pair that names none has the axis that another one names in one of its scans.
    """
    sound = [(edge, back) for edge, back in steps if edge.found and not is_refused(edge)]
    own = [(edge, back, line) for edge, back in sound if (line := _line_to_rival(edge)) is not None]
    known = {edge.source: _line_there(edge, line) for edge, _, line in own}
    known |= {edge.target: line for edge, _, line in own}
    told = {id(edge) for edge, _, _ in own}
    for edge, back in sound:
        if id(edge) in told:
            continue
        if edge.target in known:
            own.append((edge, back, known[edge.target]))
        elif edge.source in known:
            own.append((edge, back, moved_line(edge.registration.T_target_source, known[edge.source])))
    ends = [(line, _line_there(edge, line), back) for edge, back, line in own]
    return [(there, here) if back else (here, there) for here, there, back in ends]


def _line_there(edge: Edge, line: Line) -> Line:
    """A line of the target's frame, in the source's."""
    return moved_line(pose.inverse(edge.registration.T_target_source), line)


def _line_to_rival(edge: Edge) -> Line | None:
    """The axis, in the target's frame, of the rotation from a pair's pose to the first rival that is one."""
    centre = centre_of(edge.registration)
    for rival in edge.registration.alternatives:
        D = rival.T_target_source @ pose.inverse(edge.registration.T_target_source)
        inward = pose.from_parts(np.eye(3), -centre)
        screw = DualQuaternion.from_matrix(inward @ D @ pose.inverse(inward)).as_screw()
        slide = abs(float(screw.distance)) / float(edge.registration.settings["diagonal"])
        if float(screw.angle_rad) > MIN_RIVAL_TURN_RAD and slide <= MAX_RIVAL_SLIDE_SIZES:
            return screw.axis, centre + screw.point
    return None


def _motion(source: FloatArray, target: FloatArray) -> FloatArray | None:
    try:
        return np.asarray(solve(source.reshape(-1, 3), target.reshape(-1, 3)).T_target_source)
    except DegenerateGeometryError:
        # One line in all views: the table's own axis.
        return None


def _missed(M: FloatArray, source: FloatArray, target: FloatArray) -> FloatArray:
    """Distance of the ends of each line, (n,)."""
    moved = pose.apply(M, source.reshape(-1, 3)).reshape(source.shape)
    return np.asarray(np.sqrt(np.mean(np.sum((moved - target) ** 2, axis=2), axis=1)))
