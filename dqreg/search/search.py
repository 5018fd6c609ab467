"""Global registration: pose hypotheses from pairs, axes and matches, screened, refined in batches, ranked by scores."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import SearchStage
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, Surface, prepare_scan
from dqreg.geometry.normals import sample_rows
from dqreg.icp import COARSE_POINTS, IcpSettings
from dqreg.kernels.threads import TimeUpError, until
from dqreg.rigid import pose
from dqreg.rigid.symmetry import Axis
from dqreg.search.axes import axis_hypotheses
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Poses
from dqreg.search.problem import PASSED_LOG_LIKELIHOOD, SCENE_RATIO, SearchProblem, Through
from dqreg.search.scoring import EQUAL_LOG_LIKELIHOOD, PoseScores
from dqreg.search.stages import (
    FINE_APART,
    FINE_SCORING_POINTS,
    SCORING_POINTS,
    SCREEN_POINTS,
    SCREEN_REACH_DIAGONALS,
    STAGES,
    Observer,
    StageWatch,
    propose,
)

# Proposed poses that are compared where there is no time for more; those of the principal axes are fewer.
HASTY_POSES, AXIS_POSES = 4_000, 48
# Points of either side whose principal axes stand for those of all, likewise.
HASTY_POINTS = 10_000
# Points that score at the end, where poses are compared.
LAST_SCORED = 20_000
# A pose at which rays passed through so many more of the points of two scans is not as likely as the best: half-turns
# of furnished rooms came to 0.05 and more, right poses to 0.006, and to 0.026 where things move.
RAY_CONFLICT_MARGIN = 0.03


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An initial pose and how well it explains the scan."""

    T_target_source: FloatArray  # (4, 4): The pose after short refinements
    mean_nll: float  # Mean negative log-likelihood of the distances; the lower the better
    rms: float  # Truncated root mean square distance, a length
    stage: SearchStage = "judged"  # The last stage that was finished
    # Whether it explains the scan about as well as the first one; in a scene the part may be where others explain more
    is_likely: bool = True
    # For a pose that is the first one followed by a symmetry of the part itself: its axis
    symmetry: Axis | None = None
    # Whether it explains a part's scan less well, but might as well where that lies on other sides of thin walls
    is_behind: bool = False


def search(
    scan: Scan,
    surface: Surface,
    target: PointCloud | Mesh,
    plan: IcpSettings,
    table: Callable[[], PairTable],
    rng: np.random.Generator,
    *,
    time_limit: float | None = None,
    observe: Observer | None = None,
    through: Through | None = None,
    known: FloatArray | None = None,
    behind: bool = False,
) -> tuple[Candidate, ...]:
    """Initial poses that are about equally likely, the best first; if asked, on a part those left that are behind too.

    Of two scans from known places those fall behind at which rays of one passed through what the other one shows. On a
    part poses may be known, (k, 4, 4), the best first: then those elsewhere that are about as likely as that.
    """
    watch = StageWatch(time_limit, observe)
    problem = SearchProblem(scan, surface, target, plan, table, rng, through)
    if known is not None and len(known):
        problem = dataclasses.replace(problem, known=Poses.of(known))
    searched = problem
    reached: SearchStage = "proposed"
    back: Callable[[Poses], Poses] = _as_they_are
    poses: Poses | None = None
    # Far within a stage too.
    with suppress(TimeUpError), until(watch.deadline):
        searched, back = _smaller_in_larger(problem)
        poses = propose(searched)
        for name, stage in STAGES:
            if watch.is_over(reached, poses):
                break
            poses, reached = searched.elsewhere(stage(searched, poses), FINE_APART), name
            if not len(poses) and len(problem.known):
                # What is left were the known ones.
                watch.is_over(reached, poses)
                return ()
        else:
            watch.is_over(reached, poses)
            return _equally_likely(problem, back(poses), behind)
    if poses is None:
        searched, back, poses = problem, _as_they_are, axis_hypotheses(_some_of(scan), _some_of(target))
    return _best_so_far(problem, back(_best(searched, poses, reached)), reached)


def _as_they_are(poses: Poses) -> Poses:
    return poses


def _some_of(shape: Scan | PointCloud | Mesh) -> PointCloud | Mesh:
    """Some points of a shape: to find the axes of all would take longer than there is."""
    if isinstance(shape, Mesh):
        return shape
    return PointCloud(shape.points[sample_rows(len(shape.points), HASTY_POINTS)])


def _smaller_in_larger(problem: SearchProblem) -> tuple[SearchProblem, Callable[[Poses], Poses]]:
    """The problem with the smaller cloud as the target, and what carries its poses back."""
    if isinstance(problem.target, Mesh) or problem.surface.diagonal <= SCENE_RATIO * problem.scan.diagonal:
        return problem, _as_they_are
    # The smaller cloud has pairs and a grid of its own size, so it is searched for in the larger one.
    signed = problem.scan.oriented and problem.scan.fitted is None
    part = PointCloud(problem.scan.points, problem.scan.normals if signed else None)
    surface, scene = CloudSurface(part, derived=True), prepare_scan(problem.target, COARSE_POINTS)
    through = problem.through
    back = None if through is None else lambda T, slack: through(np.linalg.inv(T), slack)
    swapped = SearchProblem(scene, surface, part, problem.plan, lambda: PairTable.of(part, surface), problem.rng, back)
    return swapped, lambda poses: poses.inverse


def _best(problem: SearchProblem, poses: Poses, stage: SearchStage) -> Poses:
    """The best alone; only the proposed ones are in no order, and of many a choice is compared."""
    if stage != "proposed":
        return poses.first(1)
    poses = poses[sample_rows(len(poses), HASTY_POSES)]
    if len(poses) > AXIS_POSES:
        # They were made from the table, so its grids are there.
        return poses[problem.order(poses, SCREEN_POINTS, SCREEN_REACH_DIAGONALS)[:1]]
    points = problem.scan.points[sample_rows(len(problem.scan), SCREEN_POINTS)]
    apart = problem.surface.closest(poses.apply(points).reshape(-1, 3)).distances / (
        SCREEN_REACH_DIAGONALS * problem.size
    )
    gains = np.maximum(1.0 - apart**2, 0.0).reshape(len(poses), len(points)).mean(axis=1)
    return poses[np.argsort(-gains, kind="stable")[:1]]


def _best_so_far(problem: SearchProblem, poses: Poses, stage: SearchStage) -> tuple[Candidate, ...]:
    """The first pose alone: there was no time to compare, nor is there any to score the target's points on the scan."""
    if not len(poses):
        return ()
    return (_candidate(poses, problem.scores_of_scan(poses, SCORING_POINTS, problem.last_width), 0, stage),)


def _equally_likely(problem: SearchProblem, poses: Poses, behind: bool) -> tuple[Candidate, ...]:
    """All that explain the scan about as well as the best; and, if asked, those behind."""
    if not len(poses):
        return ()
    scores = problem.scores(poses, LAST_SCORED if len(poses) > 1 else FINE_SCORING_POINTS, problem.last_width)
    passed = problem.passed(poses, problem.last_width)
    order = np.argsort(PASSED_LOG_LIKELIHOOD * passed - scores.means, kind="stable")
    likely = scores.as_likely(int(order[0]), EQUAL_LOG_LIKELIHOOD) & (passed <= passed[order[0]] + RAY_CONFLICT_MARGIN)
    if problem.other_way is None:
        likely &= ~scores.distinguishable(int(order[0]))
    # The faces of a part may explain more of a table than of the part: the others are asked about too.
    is_scene = problem.other_way is not None and isinstance(problem.target, Mesh)
    symmetry = problem.table.symmetry if isinstance(problem.target, Mesh) else None
    found: list[Candidate] = []
    behind &= isinstance(problem.target, Mesh) and not is_scene
    rows = order[likely[order]] if not is_scene and not behind else np.r_[order[likely[order]], order[~likely[order]]]
    # Poses that have nearly converged to each other are one.
    angle_rad, offset = FINE_APART
    middle = problem.middle
    for k in rows[poses[rows].distinct(middle, angle_rad, offset * problem.size, len(rows))]:
        if not k and len(problem.known):
            continue
        candidate = _candidate(poses, scores, int(k), "judged")
        candidate = dataclasses.replace(candidate, is_likely=bool(likely[k]), is_behind=behind and not likely[k])
        if found and symmetry:
            axis = symmetry.between(found[0].T_target_source, candidate.T_target_source, offset * problem.size)
            candidate = dataclasses.replace(candidate, symmetry=axis)
        found.append(candidate)
    return tuple(found)


def _candidate(poses: Poses, scores: PoseScores, row: int, stage: SearchStage) -> Candidate:
    rms = float(np.sqrt((scores.distances[row] ** 2).mean()))
    return Candidate(pose.from_parts(poses.R[row], poses.t[row]), float(-scores.means[row]), rms, stage)
