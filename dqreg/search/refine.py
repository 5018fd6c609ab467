"""Refinement of many poses in one batch: point-to-plane steps with a rejector of normals and a falling kernel scale."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Surface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.surface import Hint
from dqreg.kernels.threads import ask_clock
from dqreg.search.grids import Edges, PlaneGrid
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses

# Normals farther apart than this belong to different faces.
MAX_NORMAL_ANGLE_RAD = np.deg2rad(60.0)
# Damping of unconstrained motions, relative to the mean diagonal of the normal equations; and at least, so that nothing
# moves where no point is near.
DAMPING_SHARE, LEAST_DAMPING = 1e-4, 1e-12
# Weight of all edge points together, where that of all points on faces is 1: they are less exact.
EDGE_WEIGHT = 0.3
# Widths beyond which a point weighs nothing: 1e-14 of one that is near.
REACH_WIDTHS = 8.0
# Points that are summed in one go.
CHUNK_POINTS = 8_192
# Points on which poses are refined, and the kernel scale that this ends with, in sizes: where nothing else is said.
SAMPLE_POINTS, LAST_SCALE_DIAGONALS = 1_000, 1e-3


@dataclasses.dataclass(frozen=True)
class Refinement:
    """How poses are refined: on so many points, in so many steps, at kernel scales that fall from first to last."""

    first: float  # Of the kernel scales, in sizes
    steps: int
    points: int = SAMPLE_POINTS
    last: float = LAST_SCALE_DIAGONALS

    def sample(self, points: FloatArray) -> OrientedPoints:
        """That many of some points, (n, 3), evenly taken; their normals are unknown."""
        return OrientedPoints.on_faces(points[sample_rows(len(points), self.points)])

    def widths(self, size: float) -> FloatArray:
        """A kernel scale for each step, (k,)."""
        return _falling(self.first, self.last, self.steps) * size


@lru_cache(maxsize=32)
def _falling(first: float, last: float, steps: int) -> FloatArray:
    return np.geomspace(first, last, steps)


def refined_on(
    T: FloatArray, points: FloatArray, surface: Surface, how: Refinement, unit: float | None = None
) -> FloatArray:
    """Poses, (k, 4, 4), refined on a sample of points, (n, 3).

    Kernel scales are in sizes of the surface, or in another unit: 1.0 where they are lengths.
    """
    widths = how.widths(surface.diagonal if unit is None else unit)
    return refine(Poses.of(T), how.sample(points), surface, widths).matrices


def refine(
    poses: Poses, sample: OrientedPoints, surface: Surface, widths: FloatArray, edges: Edges | None = None
) -> Poses:
    """Poses after one damped point-to-plane step for each width, (k,); without edges those of the sample are unused."""
    if not len(poses):
        return poses
    faces, at_edges = sample.faces, sample.edges
    middle = faces.points.mean(axis=0)
    lever = float(np.sqrt(((faces.points - middle) ** 2).sum(axis=1).mean()))
    before: Hint | None = None
    for width in widths:
        ask_clock()
        centre = poses.R @ middle + poses.t
        moved = poses.apply(faces.points)
        found = surface.closest(moved.reshape(-1, 3), before, REACH_WIDTHS * width)
        before = moved.reshape(-1, 3), found
        H, g = np.zeros((len(poses), 6, 6)), np.zeros((len(poses), 6))
        at = found.points, found.normals, found.distances
        _add_equations(poses, centre, faces, at, (width, lever, 1.0), (H, g))
        if edges is not None and len(at_edges):
            moved = poses.apply(at_edges.points).reshape(-1, 3)
            places, distances = edges.closest(moved, on_grid=isinstance(surface, PlaneGrid))
            at = places, np.zeros((0, 3)), distances
            _add_equations(poses, centre, at_edges, at, (width, lever, EDGE_WEIGHT), (H, g))
        poses = _stepped(poses, centre, (H, g), lever)
    return poses


def _add_equations(
    poses: Poses,
    centre: FloatArray,
    sample: OrientedPoints,
    at: tuple[FloatArray, FloatArray, FloatArray],
    lengths: tuple[float, float, float],
    sums: tuple[FloatArray, FloatArray],
) -> None:
    """Add the equations of the points to planes at places with normals, or to those that lead off them at an edge.

    Lengths are width and lever; the last number is the weight of all points together.
    """
    from dqreg.kernels.search.pose_steps import add_plane_steps
    from dqreg.kernels.threads import as_plain, over_chunks

    width, lever, weight = map(float, lengths)
    columns = poses.R, poses.t, centre, sample.points, sample.directions, *at
    numbers = width, float(np.cos(MAX_NORMAL_ANGLE_RAD)), lever, weight / len(sample)
    chunk = max(CHUNK_POINTS // len(sample), 1)
    over_chunks(add_plane_steps, len(poses), *map(as_plain, columns), *numbers, *sums, chunk=chunk)


def _stepped(poses: Poses, centre: FloatArray, sums: tuple[FloatArray, FloatArray], lever: float) -> Poses:
    """Poses after the damped steps that solve their equations, (n, 6, 6) and (n, 6), about their centres, (n, 3)."""
    from dqreg.kernels.search.pose_steps import take_damped_steps
    from dqreg.kernels.threads import as_plain, over_chunks

    stepped = Poses(np.zeros(poses.R.shape), np.zeros(poses.t.shape))
    columns = map(as_plain, (poses.R, poses.t, centre, *sums))
    over_chunks(take_damped_steps, len(poses), *columns, lever, DAMPING_SHARE, LEAST_DAMPING, stepped.R, stepped.t)
    return stepped
