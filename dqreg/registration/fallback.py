"""Doubts about where a given start has led: another pose from a search, and the flips and mirrorings of a part."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.icp import run_graduated, width_floor
from dqreg.icp.loop import Observer
from dqreg.icp.stopwatch import Deadline
from dqreg.registration.assess import Outcome, from_work
from dqreg.registration.initial_pose import Searching
from dqreg.registration.target_index import TargetIndex
from dqreg.rigid import pose
from dqreg.search.near_symmetry import flipped, gain_of_mirror
from dqreg.search.poses import Poses
from dqreg.search.scoring import score_poses
from dqreg.trust.records import Alternative

# Patches of points off the target, or points that face another way, beyond which the pose is doubted enough to look
# for another one.
DOUBT, DOUBT_BORDER = 0.1, 0.3
# And widths of the distances, in the scan's own noise.
MISFIT = 10.0
# A pose that explains the scan better by so much mean log-likelihood is taken, if it is within this turn and this
# share of the target's size of the start that was given: a start is rough, but it is meant.
BETTER = 0.02
MEANT_RAD, MEANT = np.deg2rad(40.0), 0.25
JUDGES = 10_000


def try_again(
    first: Outcome,
    T_start: FloatArray,
    searching: Searching,
    observe: Observer | None,
    deadline: Deadline,
) -> tuple[Outcome, tuple[Alternative, ...]]:
    """The better of a first outcome and of what a search from nothing finds, where the first is in doubt."""
    evidence = first.evidence
    # Two scans of one scene always differ somewhere, and their normals are guesses.
    doubt = DOUBT_BORDER if evidence.has_border else DOUBT
    doubted = (
        evidence.patches_off > doubt + evidence.strays
        or evidence.normals_apart > doubt
        or evidence.width > MISFIT * evidence.expected > 0.0
    )
    if not first.found or not doubted or deadline.is_over:
        return first, ()
    found = searching.candidates()
    if not found:
        return first, ()
    plan = dataclasses.replace(first.plan, first_width=searching.width)
    run, mixture = run_graduated(first.scan, first.surface, found[0].T_target_source, plan, deadline.watching(observe))
    history = first.run.history + tuple(
        dataclasses.replace(record, number=record.number + len(first.run.history)) for record in run.history
    )
    run = dataclasses.replace(run, history=history, status=deadline.status(run.status))
    second = dataclasses.replace(first, run=run, mixture=mixture)
    if not second.found:
        return first, ()
    gain, rms = _gain(first, second)
    if gain <= BETTER:
        return first, ()
    T = run.T_target_source
    turn = pose.angle_between(T, T_start)
    shift = pose.offset_between(T, T_start, at=np.zeros(3))
    if turn <= MEANT_RAD and shift <= MEANT * first.surface.diagonal:
        return second, ()
    return first, (Alternative(from_work(T, first.target.origin, first.source.origin), rms),)


def flips_of(outcome: Outcome, flips: FloatArray) -> tuple[Alternative, ...]:
    """Poses flipped by a turn that leaves most of the part in place, where they explain the scan about as well.

    Shapes: flips (k, 4, 4).
    """
    surface = outcome.surface
    limit, floor = 0.25 * outcome.plan.max_distance, width_floor(outcome.scan, surface)
    found = flipped(outcome.run.T_target_source, flips, outcome.scan, surface, limit, floor)
    return tuple(Alternative(from_work(T, outcome.target.origin, outcome.source.origin), rms) for T, rms in found)


def mirror_gain(outcome: Outcome, target: TargetIndex) -> float:
    """Mean log-likelihood that the scan gains when it is mirrored; asked only where some of it lies off the target."""
    if outcome.target.kind == "cloud" or not outcome.found or not outcome.evidence.patches_off > 0.0:
        return -np.inf
    surface = outcome.target.surface
    limit, floor = 0.25 * outcome.plan.max_distance, width_floor(outcome.scan, surface)
    return gain_of_mirror(outcome.run.T_target_source, target.near_reflections, outcome.scan, surface, limit, floor)


def _gain(first: Outcome, second: Outcome) -> tuple[float, float]:
    # Mean log-likelihood that the second pose gains, and its truncated distance.
    poses = np.stack([first.run.T_target_source, second.run.T_target_source])
    points = first.scan.points[sample_rows(len(first.scan), JUDGES)]
    surface = first.surface
    floor = width_floor(first.scan, surface)
    scores = score_poses(Poses.of(poses), points, surface, 0.25 * first.plan.max_distance, floor)
    means = scores.means
    return float(means[1] - means[0]), float(np.sqrt((scores.distances[1] ** 2).mean()))
