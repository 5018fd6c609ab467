"""Stages of the global registration: each turns poses into fewer and better ones."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, bounds
from dqreg._statuses import SearchStage
from dqreg.geometry import Mesh, PointCloud
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.icp.history import Stage
from dqreg.search.axes import axis_hypotheses
from dqreg.search.fpfh import MAX_EXTENT_VOXELS, VOXEL_DIAGONALS, FpfhCloud, match_hypotheses
from dqreg.search.pairs import pair_hypotheses
from dqreg.search.poses import Poses
from dqreg.search.problem import SearchProblem

# Screening: points for all poses, where there are many, and the share of these that is left.
FIRST_SCREEN_POINTS, FIRST_SCREEN_SHARE = 20, 0.25
# Points for those and for the best of them; poses that are left.
SCREEN_POINTS, LAST_SCREEN_POINTS = 64, 400
SHORTLIST_POSES = 1_500
# Reach of the gain in sizes, and once the poses are refined roughly.
SCREEN_REACH_DIAGONALS, REFINED_REACH_DIAGONALS = 0.03, 0.02
# Share of the best gain below which a pose of a part is dropped, there and then: of 218 scans none had a pose near the
# answer below 0.70 and 0.75; 23 had none so near yet at the first of the two.
MIN_GAIN_SHARE = 0.6
# Distinct poses kept after each stage: rough, fit, fine, last.
ROUGH_KEPT = 160
FIT_KEPT = 40
FINE_KEPT = 12
LAST_KEPT = 8
# How far apart they are: radians, sizes.
ROUGH_APART = (0.15, 0.03)
FIT_APART = (0.06, 0.015)
FINE_APART = (0.04, 0.01)
LAST_APART = (0.03, 0.005)
# Points that refine: roughly, on the grid, on the target; of near symmetries; finely, and of the last poses.
ROUGH_POINTS = 160
GRID_POINTS = 400
FIT_POINTS = 250
NEAR_POINTS = 200
FINE_POINTS = 1_000
LAST_POINTS = 2_000
# Kernel scales of the refinement, in sizes: first, last, steps. Down to the second the grid is exact enough.
ROUGH_SCALES = (0.03, 0.012, 5)
GRID_SCALES = (0.012, 0.008, 2)
FIT_SCALES = (0.006, 0.004, 2)
# The same for near symmetries: on the grid, on the target.
NEAR_GRID_SCALES, NEAR_SCALES = (0.01, 0.006, 2), (0.005, 0.004, 2)
# The fine refinement begins at the first scale at most, ends at the second at least.
FINE_SCALES = (4e-3, 1e-3)
# Best poses that are followed by every near symmetry of the part; such poses in all; and how often at most.
NEAR_SEEDS = 4
MAX_NEAR_POSES = 64
MAX_NEAR_ROUNDS = 3
# Points that score, before and after the fine refinement; the smallest widths of their distances in sizes.
SCORING_POINTS, FINE_SCORING_POINTS = 600, 4_000
MIN_WIDTH_DIAGONALS, MIN_FINE_WIDTH_DIAGONALS = 1e-3, 5e-4
# How far behind the best, in mean log-likelihood, a pose is dropped, before and after it; so many are kept in any case
# before it.
DROP_LOG_LIKELIHOOD, FINE_DROP_LOG_LIKELIHOOD = 0.7, 0.25
MIN_KEPT = 3
# The same once near symmetries are there: the pose that was found lacked 0.014 at most.
NEAR_DROP_LOG_LIKELIHOOD = 0.35
# The same for two clouds: points after the rough refinement; widths there, after the next and after the fine one.
CLOUD_SCORING_POINTS = 200
CLOUD_WIDTHS_DIAGONALS = (8e-3, 4e-3, 2e-3)
# Poses kept that matches propose.
MATCHED_KEPT = 80


Observer = Callable[[Stage], object]


class StageWatch:
    """Reports the stages to an observer, and tells after each whether to stop."""

    def __init__(self, limit: float | None = None, observe: Observer | None = None) -> None:
        self._began = time.perf_counter()
        self._limit, self._observe = limit, observe

    @property
    def deadline(self) -> float:
        """When the limit is over, by `time.perf_counter`; infinite without one."""
        return np.inf if self._limit is None else self._began + self._limit

    def is_over(self, stage: SearchStage, poses: Poses) -> bool:
        """Report a finished stage; whether the search shall end here."""
        seconds = time.perf_counter() - self._began
        if self._observe is not None and self._observe(Stage(stage, len(poses), seconds)) is False:
            return True
        return self._limit is not None and seconds >= self._limit


def propose(problem: SearchProblem) -> Poses:
    """Hypotheses from pairs of oriented points and from the principal axes, in no order."""
    axes = axis_hypotheses(problem.scan, problem.target)
    return pair_hypotheses(problem.points, problem.table, problem.rng) + axes


def screen(problem: SearchProblem, poses: Poses) -> Poses:
    """The best on the grids; between clouds those that matches propose as well."""
    kept = _screened(problem, poses, ROUGH_KEPT)
    if isinstance(problem.target, Mesh):
        return kept
    # Matches that agree are many and alike: they are screened by themselves.
    return _screened(problem, _matched(problem, problem.target), MATCHED_KEPT) + kept


def refine_roughly(problem: SearchProblem, poses: Poses) -> Poses:
    """After steps on the planes of the grid."""
    poses = problem.refined(poses, problem.sample(ROUGH_POINTS), ROUGH_SCALES, problem.table.grid)
    if isinstance(problem.target, Mesh):
        return problem.distinct(
            poses[problem.order(poses, LAST_SCREEN_POINTS, REFINED_REACH_DIAGONALS, MIN_GAIN_SHARE)],
            FIT_APART,
            FIT_KEPT,
        )
    return problem.distinct(
        problem.ranked(poses, CLOUD_SCORING_POINTS, CLOUD_WIDTHS_DIAGONALS[0], np.inf), FIT_APART, FIT_KEPT
    )


def refine_on_target(problem: SearchProblem, poses: Poses) -> Poses:
    """After steps on the target itself, ranked by likelihood."""
    poses = problem.refined(poses, problem.sample(GRID_POINTS), GRID_SCALES, problem.table.grid)
    poses = problem.refined(poses, problem.sample(FIT_POINTS), FIT_SCALES)
    width = MIN_WIDTH_DIAGONALS if isinstance(problem.target, Mesh) else CLOUD_WIDTHS_DIAGONALS[1]
    return problem.distinct(
        problem.ranked(poses, SCORING_POINTS, width, DROP_LOG_LIKELIHOOD, MIN_KEPT), FINE_APART, FINE_KEPT
    )


def add_near_symmetric(problem: SearchProblem, poses: Poses) -> Poses:
    """All poses, and the best ones followed by the motions that leave most of the part in place.

    Again where that gave a better one: of the steps of a ring some may be missing, and two of them lead farther.
    """
    near = problem.table.symmetry.near if problem.table.symmetry else np.zeros((0, 4, 4))
    if not len(near):
        return poses
    angle_rad, offset = FINE_APART[0], FINE_APART[1] * problem.size
    for _ in range(MAX_NEAR_ROUNDS):
        before, poses = poses.first(1), _followed(problem, poses, near) if len(poses) else poses
        if not len(poses) or before.beside(poses.first(1), problem.middle, angle_rad, offset).any():
            break
    return poses


def _followed(problem: SearchProblem, poses: Poses, near: FloatArray) -> Poses:
    more = problem.unknown(poses, FINE_APART).first(max(1, min(NEAR_SEEDS, MAX_NEAR_POSES // len(near)))).then(near)
    more = problem.refined(more, problem.sample(NEAR_POINTS), NEAR_GRID_SCALES, problem.table.grid)
    more = problem.refined(more, problem.sample(NEAR_POINTS), NEAR_SCALES)
    return problem.distinct(
        problem.ranked(poses + more, SCORING_POINTS, MIN_WIDTH_DIAGONALS, NEAR_DROP_LOG_LIKELIHOOD, MIN_KEPT),
        FINE_APART,
        FINE_KEPT,
    )


def refine_finely(problem: SearchProblem, poses: Poses) -> Poses:
    """After steps of many points at the width of the scan's noise."""
    first, last = FINE_SCALES
    width = max(2.0 * noise_on(problem.scan, problem.surface) / problem.size, last)
    poses = problem.refined(poses, problem.sample_without_normals(FINE_POINTS), (max(first, width), width, 4))
    floor = MIN_FINE_WIDTH_DIAGONALS if isinstance(problem.target, Mesh) else CLOUD_WIDTHS_DIAGONALS[2]
    poses = problem.distinct(
        problem.ranked(poses, FINE_SCORING_POINTS, floor, FINE_DROP_LOG_LIKELIHOOD), LAST_APART, LAST_KEPT
    )
    # One pose alone need not be compared: the ICP that follows refines it.
    if len(poses) < 2:
        return poses
    return problem.refined(poses, problem.sample_without_normals(LAST_POINTS), (width, width, 3))


# In their order, by the names that are reported.
STAGES: tuple[tuple[SearchStage, Callable[[SearchProblem, Poses], Poses]], ...] = (
    ("screened", screen),
    ("refined roughly", refine_roughly),
    ("refined", refine_on_target),
    ("turned", add_near_symmetric),
    ("refined finely", refine_finely),
)


def _screened(problem: SearchProblem, poses: Poses, most: int) -> Poses:
    # Of a scan that shows more than the target hardly any of so few points may be on it.
    if FIRST_SCREEN_SHARE * len(poses) > SHORTLIST_POSES and problem.occupancy is None:
        poses = poses[
            problem.order(poses, FIRST_SCREEN_POINTS, SCREEN_REACH_DIAGONALS, most=int(FIRST_SCREEN_SHARE * len(poses)))
        ]
    for count, least in ((SCREEN_POINTS, 0.0), (LAST_SCREEN_POINTS, MIN_GAIN_SHARE)):
        poses = poses[problem.order(poses, count, SCREEN_REACH_DIAGONALS, least, SHORTLIST_POSES)]
    return problem.distinct(poses, ROUGH_APART, most)


def _matched(problem: SearchProblem, target: PointCloud) -> Poses:
    """Hypotheses from features that both clouds have."""
    voxel = VOXEL_DIAGONALS * problem.size
    extents = [float(np.subtract(*bounds(points)[::-1]).max()) for points in (problem.scan.points, target.points)]
    if not max(extents) < MAX_EXTENT_VOXELS * voxel:
        # One is a point beside the other.
        return Poses.of(np.zeros((0, 4, 4)))
    signed = problem.scan.normals if problem.scan.oriented and problem.scan.fitted is None else None
    sides = FpfhCloud.of(problem.scan.points, voxel, signed), FpfhCloud.of(target.points, voxel, target.normals)
    known = signed is not None and target.normals is not None
    return match_hypotheses(*sides, voxel, signs_known=known)
