"""The search for a start: proposals from pairs, axes and matches, screened, refined in batches, ranked by a judge."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, Surface, prepare_scan
from dqreg.icp import COARSE, Plan
from dqreg.rigid import pose
from dqreg.search.grids import distinct
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Clock, Observer, Poses
from dqreg.search.problem import SCENE, Task
from dqreg.search.scoring import Judgement
from dqreg.search.stages import FEW, JUDGES, MORE_JUDGES, REACH, STAGES, proposed

# Points that judge at the end.
LAST_JUDGES = 20_000
# A mean log-likelihood this close to the best explains the scan as well; so does one within so many standard errors,
# but never one farther behind than the last number.
AS_GOOD, ERRORS, WORSE = 0.02, 2.0, 0.05
# Poses closer than this, in radians and sizes, are one.
APART = (0.04, 0.01)


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A start pose and how badly it explains the scan."""

    T_target_source: FloatArray  # (4, 4): The pose after short refinements
    surprise: float  # Mean negative log-likelihood of the distances; the lower the better
    rms: float  # Truncated root mean square distance, a length
    stage: str = "judged"  # The last stage that was finished: "judged", or what there was when the time was up
    # For a pose that is the first one followed by a symmetry of the part itself: that symmetry in words; else ""
    symmetry: str = ""


def search(
    scan: Scan,
    surface: Surface,
    target: PointCloud | Mesh,
    plan: Plan,
    table: Callable[[], PairTable],
    rng: np.random.Generator,
    *,
    time_limit: float | None = None,
    observe: Observer | None = None,
    now: Callable[[], float] | None = None,
) -> tuple[Candidate, ...]:
    """Start poses that explain the scan about as well as the best one, the best first."""
    clock = Clock(time_limit, observe, now)
    given = Task(scan, surface, target, plan, table, rng)
    task, back = _turned_round(given)
    poses, reached = proposed(task), "proposed"
    for name, stage in STAGES:
        if clock.is_up(reached, poses):
            return _best_so_far(given, back(_first(task, poses, reached)), reached)
        poses, reached = stage(task, poses), name
    clock.is_up(reached, poses)
    return _judged(given, back(poses))


def _turned_round(task: Task) -> tuple[Task, Callable[[Poses], Poses]]:
    """The task from the larger cloud to the smaller side, and what turns its poses back."""
    if isinstance(task.target, Mesh) or task.surface.diagonal <= SCENE * task.scan.diagonal:
        return task, lambda poses: poses
    # The smaller side has pairs and a grid of its own size, so it is what is looked for in the larger one.
    signed = task.scan.oriented and task.scan.fitted is None
    part = PointCloud(task.scan.points, task.scan.normals if signed else None)
    surface, scene = CloudSurface(part), prepare_scan(task.target, COARSE)
    turned = Task(scene, surface, part, task.plan, lambda: PairTable.of(part, surface), task.rng)
    return turned, lambda poses: poses.inverse


def _first(task: Task, poses: Poses, stage: str) -> Poses:
    """The best alone; only the proposed ones are in no order."""
    return poses[task.order(poses, FEW, REACH)[:1]] if stage == "proposed" else poses[np.arange(min(1, len(poses)))]


def _best_so_far(task: Task, poses: Poses, stage: str) -> tuple[Candidate, ...]:
    """The first pose alone: there was no time to compare."""
    if not len(poses):
        return ()
    first = poses[np.arange(1)]
    return (_candidate(first.matrix(0), task.judgement(first, JUDGES, task.last_width), 0, stage, ""),)


def _judged(task: Task, poses: Poses) -> tuple[Candidate, ...]:
    """All that explain the scan about as well as the best."""
    if not len(poses):
        return ()
    judgement = task.judgement(poses, LAST_JUDGES if len(poses) > 1 else MORE_JUDGES, task.last_width)
    order = np.argsort(-judgement.means, kind="stable")
    behind, error = judgement.behind(int(order[0]))
    as_good = behind <= np.clip(ERRORS * error, AS_GOOD, WORSE)
    if task.other_way is None:
        as_good &= ~judgement.told_apart(int(order[0]))
    symmetry = task.table.symmetry if isinstance(task.target, Mesh) else None
    found: list[Candidate] = []
    rows = order[as_good[order]]
    middle = task.scan.points.mean(axis=0)
    # What has not quite come to the same place is no other pose.
    for k in rows[distinct(poses.R[rows], poses.t[rows], middle, APART[0], APART[1] * task.size, len(rows))]:
        words = symmetry.words_between(found[0].T_target_source, poses.matrix(k)) if found and symmetry else ""
        found.append(_candidate(poses.matrix(k), judgement, int(k), "judged", words))
    return tuple(found)


def _candidate(T: FloatArray, judgement: Judgement, row: int, stage: str, words: str) -> Candidate:
    rms = float(np.sqrt((judgement.distances[row] ** 2).mean()))
    return Candidate(pose.from_parts(T[:3, :3], T[:3, 3]), float(-judgement.means[row]), rms, stage, words)
