"""The stages of a search for a start, each from poses to fewer and better ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg.geometry import Mesh, PointCloud
from dqreg.search.axes import propose_turns
from dqreg.search.fpfh import VOXEL, Described, match_hypotheses
from dqreg.search.pairs import hypotheses
from dqreg.search.poses import Poses
from dqreg.search.problem import KEPT_ANYWAY, Task, nearly_same
from dqreg.search.refine import Sample

# Screening: few points for all poses, more for the best; reach in sizes; poses kept.
FEW, MORE, REACH, SHORTLIST = 64, 400, 0.03, 1_500
# Distinct poses kept after each stage, and how far apart they stand: radians, sizes.
ROUGH_KEPT, FIT_KEPT, FINE_KEPT, LAST_KEPT = 160, 40, 12, 8
ROUGH_APART, FIT_APART, FINE_APART, LAST_APART = (0.15, 0.03), (0.06, 0.015), (0.04, 0.01), (0.03, 0.005)
# Widths of the refinement, in sizes: first, last, steps. Down to the second the grid knows enough.
ROUGH_WIDTHS, GRID_WIDTHS, FIT_WIDTHS = (0.03, 0.012, 5), (0.012, 0.008, 2), (0.006, 0.004, 2)
# Best poses that are also tried in all turns that leave most of the part in place; such poses in all.
TURNED, TURNS = 4, 64
# Points that judge; and how far behind the best, in mean log-likelihood, a pose is given up: after the refinement, and
# after the fine one.
JUDGES, MORE_JUDGES = 600, 4_000
HOPELESS, BEATEN = 0.7, 0.25
# The same for two clouds: judges after the rough refinement, widths there, after the next and after the fine one;
# poses kept that matches propose.
CLOUD_JUDGES, CLOUD_WIDTHS, MATCHED_KEPT = 200, (8e-3, 4e-3, 2e-3), 80


def proposed(task: Task) -> Poses:
    """Poses from pairs of oriented places and from the principal axes, in no order."""
    turns = np.array(propose_turns(task.scan, task.target))
    return Poses(*hypotheses(task.places, task.table, task.rng)) + Poses(turns[:, :3, :3], turns[:, :3, 3])


def screened(task: Task, poses: Poses) -> Poses:
    """The best on the grids; between clouds those that matches propose as well."""
    kept = _screened(task, poses, ROUGH_KEPT)
    # Matches that agree are many and alike: they have places of their own.
    return kept if isinstance(task.target, Mesh) else _screened(task, _matched(task, task.target), MATCHED_KEPT) + kept


def refined_roughly(task: Task, poses: Poses) -> Poses:
    """After steps on the planes of the grid."""
    poses = task.refined(poses, Sample.of(task.places, 160, task.rng), ROUGH_WIDTHS, task.table.grid)
    if isinstance(task.target, Mesh):
        return task.distinct(poses[task.order(poses, MORE, 0.02)], FIT_APART, FIT_KEPT)
    return task.distinct(task.ranked(poses, CLOUD_JUDGES, CLOUD_WIDTHS[0], np.inf), FIT_APART, FIT_KEPT)


def refined(task: Task, poses: Poses) -> Poses:
    """After steps on the target itself, ranked by likelihood."""
    poses = task.refined(poses, Sample.of(task.places, 400, task.rng), GRID_WIDTHS, task.table.grid)
    poses = task.refined(poses, Sample.of(task.places, 250, task.rng), FIT_WIDTHS)
    width = 1e-3 if isinstance(task.target, Mesh) else CLOUD_WIDTHS[1]
    return task.distinct(task.ranked(poses, JUDGES, width, HOPELESS, KEPT_ANYWAY), FINE_APART, FINE_KEPT)


def turned(task: Task, poses: Poses) -> Poses:
    """The best poses in all turns that leave most of the part in place, with all others."""
    near = task.table.symmetry.near if task.table.symmetry else np.zeros((0, 4, 4))
    if not len(near) or not len(poses):
        return poses
    count = max(1, min(TURNED, TURNS // len(near)))
    more = nearly_same(poses[np.arange(min(count, len(poses)))], near)
    more = task.refined(more, Sample.of(task.places, 200, task.rng), (0.01, 0.006, 2), task.table.grid)
    more = task.refined(more, Sample.of(task.places, 200, task.rng), (0.005, 0.004, 2))
    return task.distinct(task.ranked(poses + more, JUDGES, 1e-3, HOPELESS, KEPT_ANYWAY), FINE_APART, FINE_KEPT)


def refined_finely(task: Task, poses: Poses) -> Poses:
    """After steps of many points at the width of the scan's noise."""
    width = max(2.0 * task.scan.noise / task.size, 1e-3)
    poses = task.refined(poses, task.everywhere(1_000), (max(0.004, width), width, 4), rims=False)
    floor = 5e-4 if isinstance(task.target, Mesh) else CLOUD_WIDTHS[2]
    poses = task.distinct(task.ranked(poses, MORE_JUDGES, floor, BEATEN), LAST_APART, LAST_KEPT)
    # Where one pose is left there is nothing to compare: the loop that follows refines it.
    return poses if len(poses) < 2 else task.refined(poses, task.everywhere(4_000), (width, width, 3), rims=False)


# In their order, by the names that are reported.
STAGES: tuple[tuple[str, Callable[[Task, Poses], Poses]], ...] = (
    ("screened", screened),
    ("refined roughly", refined_roughly),
    ("refined", refined),
    ("turned", turned),
    ("refined finely", refined_finely),
)


def _screened(task: Task, poses: Poses, most: int) -> Poses:
    for count in (FEW, MORE):
        poses = poses[task.order(poses, count, REACH)[:SHORTLIST]]
    return task.distinct(poses, ROUGH_APART, most)


def _matched(task: Task, target: PointCloud) -> Poses:
    """Poses from features that both clouds have."""
    voxel = VOXEL * task.size
    signed = task.scan.normals if task.scan.oriented and task.scan.fitted is None else None
    sides = Described.of(task.scan.points, voxel, signed), Described.of(target.points, voxel, target.normals)
    known = signed is not None and target.normals is not None
    return Poses(*match_hypotheses(*sides, voxel, signs_known=known))
