"""Turns of a ring between two clouds: which of them explain both clouds as well, by what either shows inside the other.

What a turn loses of the overlap says nothing of it: another part of the ring was seen. So points count alone that lie
on the other cloud, or amid it: where its points are around them on all sides, and none near, as in a bolt's hole.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, median
from dqreg.geometry import CloudSurface
from dqreg.geometry.angles import gaps_around
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.near_places import ring_maps
from dqreg.registration.other_poses.rivals import NO_POSES
from dqreg.rigid import pose
from dqreg.search.rings import TEETH
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# Points of each cloud that compare turns, few at first.
FIRST_POINTS, COMPARED_POINTS = 600, 4_000
# Standard errors by the first beyond which a turn is hopeless.
HOPELESS_SIGMAS = 3.0
# Spacings beside a point up to which a cloud goes on in its tangent plane.
PLANE_REACH_SPACINGS = 3.0
# Points of a cloud that tell what lies amid it.
INTERIOR_POINTS = 1_500
# The nearest ones that surround a point, and the widest gap between their directions.
SURROUNDING_POINTS, MAX_GAP_RAD = 24, 2.1
# Least width of the distances, in sizes; widths beyond which farther is no worse.
MIN_WIDTH_DIAGONALS, MAX_WIDTHS = 5e-4, 4.0
# Blocks of neighbours.
NEIGHBOUR_BLOCKS = 60
# Standard errors of the mean log-likelihood within which a turn explains both clouds as well, and beyond which it does
# so better: of 33 pairs of a ring one lobe off none was without such a turn, of right poses 19 were.
EQUAL_SIGMAS, BETTER_SIGMAS = 1.0, 3.0
# Better turns that follow one another.
MAX_ROUNDS = 3


@dataclasses.dataclass(frozen=True, eq=False)
class _Cloud:
    points: FloatArray  # (n, 3)
    normals: FloatArray  # (n, 3)
    tree: NeighbourTree
    spacing: float

    @cached_property
    def spread(self) -> FloatArray:
        """Some of the points, as far apart as the holes are wide that a point may lie in, (m, 3)."""
        return self.points[sample_rows(len(self.points), INTERIOR_POINTS)]

    @cached_property
    def spread_tree(self) -> NeighbourTree:
        """Tree of these."""
        return NeighbourTree(self.spread)

    def heights(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, BoolArray]:
        """How far points with normals, (m, 3), lie off the cloud, and which of them lie on it or amid it, (m,)."""
        rows, apart = self.tree.nearest(points, 1)
        rows, apart = rows[:, 0], apart[:, 0]
        aside = np.abs(row_dots(points - self.points[rows], self.normals[rows]))
        beside = apart**2 - aside**2 <= (PLANE_REACH_SPACINGS * self.spacing) ** 2
        counted = beside & self.normals[rows].any(axis=1)
        away = np.flatnonzero(~beside & normals.any(axis=1))
        counted[away] = self._surrounds(points[away], normals[away])
        return np.where(beside, aside, apart), counted

    def _surrounds(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Which points with normals have the cloud around them on all sides, (m,)."""
        around = self.spread[self.spread_tree.nearest(points, SURROUNDING_POINTS)[0]] - points[:, None]
        one = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
        one /= np.linalg.norm(one, axis=1, keepdims=True)
        x, y = (np.einsum("ikj,ij->ik", around, axis) for axis in (one, np.cross(normals, one)))
        gaps = gaps_around(np.arctan2(y, x))[1]
        return np.asarray(gaps.max(axis=1, initial=0.0) < MAX_GAP_RAD)


def best_on_ring(fit: Fit, start: FloatArray | None, kernel_scale: float | None) -> tuple[Fit, FloatArray]:
    """The fit between two clouds, or that after a better turn of the ring they show; and turns that are as likely.

    An initial pose less than half a step off decides: no others are asked. Shapes: returns (k, 4, 4).
    """
    excess, poses = np.zeros(0), NO_POSES
    if not fit.found or fit.is_late or not fit.may_be_moved:
        return fit, NO_POSES
    for _ in range(MAX_ROUNDS):
        if fit.problem.watch.is_over or not len(turns := _not_meant(fit, start)):
            return fit, NO_POSES
        poses, excess = _compared(fit, turns @ fit.T_target_source)
        if excess.min(initial=np.inf) > -BETTER_SIGMAS:
            break
        other = fit.resumed(poses[int(excess.argmin())], kernel_scale)
        if not other.found:
            break
        fit = other
    return fit, poses[excess < EQUAL_SIGMAS]


def _not_meant(fit: Fit, start: FloatArray | None) -> FloatArray:
    """Turns of the ring that two clouds show, (k, 4, 4), unless an initial pose tells a pose from all of them."""
    if not fit.between_clouds:
        return NO_POSES
    off = np.inf if start is None else pose.angle_between(fit.T_target_source, start)
    if off < np.pi / TEETH[-1]:
        return NO_POSES
    turns = ring_maps(fit)
    # As many as there are steps but one.
    return turns if len(turns) and off > np.pi / (len(turns) + 1) else NO_POSES


def _compared(fit: Fit, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses that few points do not refute, (k, 4, 4), and by how many standard errors each explains less, (k,)."""
    poses = poses[_excess(fit, poses, FIRST_POINTS) < HOPELESS_SIGMAS]
    return poses, _excess(fit, poses, COMPARED_POINTS) if len(poses) else np.zeros(0)


def _excess(fit: Fit, poses: FloatArray, count: int) -> FloatArray:
    """By how many standard errors of the mean log-likelihood of so many points poses explain both clouds less, (k,)."""
    surface, scan = fit.prepared.surface, fit.prepared.scan
    assert isinstance(surface, CloudSurface)
    target = surface._distinct
    stands = _Cloud(target.points, np.nan_to_num(surface.normals), target.tree, target.spacing)
    moves = _Cloud(scan.points, np.nan_to_num(scan.normals), scan.tree, scan.spacing)
    poses = np.concatenate([fit.T_target_source[None], poses])
    sides = [_asked(moves, stands, poses, count), _asked(stands, moves, pose.inverse(poses), count)]
    away, counted = (np.concatenate(both, axis=1) for both in zip(*sides, strict=True))
    here = away[0, counted[0]]
    width = max(GAUSSIAN_MEDIAN * median(here) if len(here) else 0.0, MIN_WIDTH_DIAGONALS * surface.diagonal)
    costs = 0.5 * np.minimum(away / width, MAX_WIDTHS) ** 2
    both = counted[1:] & counted[0]
    return np.array([_errors((cost - costs[0])[rows]) for cost, rows in zip(costs[1:], both, strict=True)])


def _asked(cloud: _Cloud, other: _Cloud, poses: FloatArray, count: int) -> tuple[FloatArray, BoolArray]:
    """Heights of some points of a cloud at poses, (k, 4, 4), over another one, and which count, (k, m) each."""
    rows = sample_rows(len(cloud.points), count)
    points, normals = cloud.points[rows], cloud.normals[rows]
    found = [other.heights(pose.apply(T, points), normals @ T[:3, :3].T) for T in poses]
    away, counted = (np.stack(each) for each in zip(*found, strict=True))
    return away, counted


def _errors(excess: FloatArray) -> float:
    """Mean of what neighbouring points say over its standard error, by blocks of them; infinite where hardly any."""
    if len(excess) < 2 * NEIGHBOUR_BLOCKS:
        return np.inf
    means = np.add.reduceat(excess, np.arange(NEIGHBOUR_BLOCKS) * len(excess) // NEIGHBOUR_BLOCKS) / (
        len(excess) / NEIGHBOUR_BLOCKS
    )
    error = float(means.std(ddof=1) / np.sqrt(NEIGHBOUR_BLOCKS))
    return float(means.mean()) / max(error, np.finfo(float).tiny)
