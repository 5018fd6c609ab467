"""Least squares fits of ideal shapes: orthogonal distances, to the last digits that the points allow."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.features.models import PARAMETERS, FeatureKind, Shape, distances
from dqreg.inspection.features.starts import starts_of

# Steps at most, and the step, in sizes of the points, below which nothing improves.
MAX_STEPS, MIN_STEP_SIZES = 100, 4.0 * np.finfo(float).eps
# A cost that rises by that share has not changed; steps below that end when they no longer halve.
SAME_COST_SHARE, SMALL_STEP_SIZES = 1e-12, 1e-11
# With normals the axis is nearly known: a start whose cost is that many times the best one's is another basin.
MAX_START_COST_RATIO = 100.0
# A rejected step is damped by that factor, an accepted one released by it.
DAMPING_FACTOR = 10.0


def fit_gauss(kind: FeatureKind, points: FloatArray, normals: FloatArray | None = None) -> Shape:
    """The shape with the least sum of squared distances. Shapes: points (n, 3), normals (n, 3).

    The fit runs about the mean of the points with their size as the unit, from each start; the best is kept.
    """
    centre = points.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)))) or 1.0
    scaled = (points - centre) / size
    starts = starts_of(kind, scaled, normals)
    if normals is not None:
        costs = [_cost(kind, shape, scaled) for shape in starts]
        starts = [shape for shape, cost in zip(starts, costs, strict=True) if cost <= MAX_START_COST_RATIO * min(costs)]
    # Points that hold no such shape let it grow beyond all numbers; the caller asks whether they hold it.
    with np.errstate(over="ignore", invalid="ignore"):
        found = [_refined(kind, shape, scaled) for shape in starts]
    best = min(found, key=lambda shape: _cost(kind, shape, scaled))
    return placed(best, centre, size, scaled)


def placed(shape: Shape, centre: FloatArray, size: float, scaled: FloatArray) -> Shape:
    """A shape of scaled points in the frame of the points, its point beside their middle."""
    point = shape.point
    if shape.radius and np.abs(shape.frame - np.eye(3)).max() > 0.0:
        along = float((scaled.mean(axis=0) - point) @ shape.axis)
        shape = along_axis(shape, along)
        point = shape.point
    return Shape(centre + size * point, shape.frame, size * shape.radius, shape.half_angle, size * shape.half_length)


def along_axis(shape: Shape, distance: float) -> Shape:
    """The same shape, named by another point of its axis; a cone's radius is that at the point."""
    radius = shape.radius + distance * float(np.tan(shape.half_angle))
    return Shape(shape.point + distance * shape.axis, shape.frame, radius, shape.half_angle, shape.half_length)


def _cost(kind: FeatureKind, shape: Shape, points: FloatArray) -> float:
    return float(np.sum(distances(kind, shape, points)[0] ** 2))


def _refined(kind: FeatureKind, shape: Shape, points: FloatArray) -> Shape:
    """Levenberg's steps about the shape itself, so that no parameter is ever singular."""
    damping, cost, last = 0.0, _cost(kind, shape, points), np.inf
    for _ in range(MAX_STEPS):
        residuals, slopes = distances(kind, shape, points)
        count = len(PARAMETERS[kind])
        scale = np.linalg.norm(slopes, axis=0) + np.finfo(float).tiny
        rows = np.vstack([slopes / scale, np.sqrt(damping) * np.eye(count)])
        step, *_ = np.linalg.lstsq(rows, np.concatenate([-residuals, np.zeros(count)]), rcond=1e-13)
        step = step / scale
        moved = shape.moved(kind, step)
        new = _cost(kind, moved, points)
        size = float(np.abs(step).max())
        # Where a cost no longer changes by its own rounding, steps still do: they end when they shrink no more.
        if new <= cost * (1.0 + SAME_COST_SHARE):
            shape, cost, damping = moved, new, damping / DAMPING_FACTOR if damping > 1e-9 else 0.0
            if size < MIN_STEP_SIZES or (size < SMALL_STEP_SIZES and size > 0.5 * last):
                break
            last = size
        elif size < MIN_STEP_SIZES or damping > 1e9:
            break
        else:
            damping = max(DAMPING_FACTOR * damping, 1e-6)
    return shape
