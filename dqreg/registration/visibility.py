"""Registration to what the scanner could see: hidden faces of a part do not attract."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.visibility import VisibleSurface
from dqreg.icp import Observer, run_graduated
from dqreg.icp.stopwatch import Deadline
from dqreg.registration.assess import Outcome
from dqreg.registration.source import CentredSource
from dqreg.registration.target_index import TargetIndex
from dqreg.registration.visible_target import require_mesh, seen_target
from dqreg.rigid import pose

# Runs at most: each begins with what can be seen at the pose of the last one.
TURNS = 3
# Width of the kernel to begin with, in widths of the last run and in sizes of the part: the hidden faces may have held
# the pose off by the thickness of a wall.
WIDER, WIDEST = 3.0, 0.01


def in_centred_frame(viewpoints: FloatArray, source: CentredSource) -> FloatArray:
    """Places in the centred source frame."""
    return source.scale * viewpoints - source.origin


def seen_from(source: CentredSource, viewpoints: FloatArray, target: TargetIndex) -> CentredSource:
    """The source with the signs of its normals told by a single viewpoint."""
    require_mesh(target)
    if len(viewpoints) > 1 or source.cloud.normals is not None:
        return source
    place = in_centred_frame(viewpoints, source)[0]
    return dataclasses.replace(source, cloud=dataclasses.replace(source.cloud, viewpoint=place))


def look_again(outcome: Outcome, viewpoints: FloatArray, observe: Observer | None, deadline: Deadline) -> Outcome:
    """Register again, to what can be seen at the pose found, until that stays the same."""
    places, whole = in_centred_frame(viewpoints, outcome.source), outcome.target
    for _ in range(TURNS):
        if not outcome.found or deadline.is_over or outcome.run.status == "stopped by observer":
            break
        target = seen_target(whole, pose.apply(outcome.run.T_target_source, places))
        if _same(target, outcome.target):
            break
        outcome = _again(dataclasses.replace(outcome, target=target, surface=target.surface), observe, deadline)
    return outcome


def _same(one: TargetIndex, other: TargetIndex) -> bool:
    mine, others = one.surface, other.surface
    if isinstance(mine, VisibleSurface) and isinstance(others, VisibleSurface):
        return np.array_equal(mine.rows, others.rows)
    return mine is others


def _again(outcome: Outcome, observe: Observer | None, deadline: Deadline) -> Outcome:
    surface, first, plan = outcome.surface, outcome.run, outcome.plan
    width = max(WIDER * outcome.mixture.scale, WIDEST * surface.diagonal)
    near = dataclasses.replace(plan, first_width=None if plan.fine is None else width)
    run, mixture = run_graduated(outcome.scan, surface, first.T_target_source, near, deadline.watching(observe))
    told = tuple(dataclasses.replace(record, number=record.number + len(first.history)) for record in run.history)
    T, status = outcome.known.held(run.T_target_source), deadline.status(run.status)
    run = dataclasses.replace(run, T_target_source=T, status=status, history=first.history + told)
    return dataclasses.replace(outcome, run=run, mixture=mixture)
