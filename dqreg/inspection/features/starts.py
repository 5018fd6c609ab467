"""Where a fit of an ideal shape begins: found from the points and, where they have them, their normals."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.features.models import FeatureKind, Shape, distances

# Directions of an axis that are tried where no normals tell it: even over half a sphere, by the golden angle.
TRIED_AXES, GOLDEN_ANGLE_RAD = 64, np.pi * (3.0 - 5.0**0.5)
# The best of them that are refined.
REFINED_STARTS = 4


def starts_of(kind: FeatureKind, points: FloatArray, normals: FloatArray | None) -> list[Shape]:
    """Shapes from which a fit begins, the best first. Shapes: points (n, 3) about their mean, normals (n, 3)."""
    _, _, axes = np.linalg.svd(points, full_matrices=False)
    if kind == "plane":
        return [Shape(np.zeros(3), frame_along(axes[2]))]
    if kind == "line":
        return [Shape(np.zeros(3), frame_along(axes[0]))]
    if kind == "sphere":
        return [_sphere(points)]
    if kind == "circle":
        return [_round("circle", points, axes[2])]
    if kind == "slot":
        tried = _directions("cylinder", axes, normals)
        return [_slot(points, axis) for axis in tried[: REFINED_STARTS if normals is None else 1]]
    found = [_round(kind, points, axis) for axis in _directions(kind, axes, normals)]
    found.sort(key=lambda shape: float(np.sum(distances(kind, shape, points)[0] ** 2)))
    return found[:REFINED_STARTS]


def frame_along(axis: FloatArray) -> FloatArray:
    """A rotation whose third column is the axis, (3, 3).

    >>> frame_along(np.array([0.0, 0.0, 2.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    z = axis / np.linalg.norm(axis)
    x = np.zeros(3)
    x[int(np.argmin(np.abs(z)))] = 1.0
    x -= (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _directions(kind: FeatureKind, axes: FloatArray, normals: FloatArray | None) -> FloatArray:
    if normals is not None:
        # Normals of a cylinder lie in a plane through the origin, those of a cone in one that may miss it.
        middle = normals.mean(axis=0) if kind == "cone" else np.zeros(3)
        _, _, spread = np.linalg.svd(normals - middle, full_matrices=False)
        return np.vstack([spread[2:], axes])
    k = np.arange(TRIED_AXES) + 0.5
    z = 1.0 - k / TRIED_AXES
    across = np.sqrt(1.0 - z**2)
    even = np.column_stack([across * np.cos(GOLDEN_ANGLE_RAD * k), across * np.sin(GOLDEN_ANGLE_RAD * k), z])
    return np.vstack([axes, even])


def _sphere(points: FloatArray) -> Shape:
    # |p|^2 = 2 c.p + (r^2 - |c|^2) is linear in c and the bracket.
    centre, bracket = _linear(np.column_stack([2.0 * points, np.ones(len(points))]), np.sum(points**2, axis=1))
    return Shape(centre, np.eye(3), math.sqrt(max(bracket + float(centre @ centre), 0.0)))


def _round(kind: FeatureKind, points: FloatArray, axis: FloatArray) -> Shape:
    """A circle, cylinder or cone about a given direction: linear in its centre and size."""
    frame = frame_along(axis)
    x, y, z = (points @ frame).T
    one = np.ones_like(x)
    columns = [2.0 * x, 2.0 * y, one]
    if kind != "cone":
        centre, bracket = _linear(np.column_stack(columns), x**2 + y**2)
        return Shape(frame[:, :2] @ centre, frame, math.sqrt(max(bracket + float(centre @ centre), 0.0)))
    # The squared radius of a cone is quadratic in the height; its root at the middle and its slope there.
    solved, *_ = np.linalg.lstsq(np.column_stack([*columns, z, z**2]), x**2 + y**2, rcond=None)
    radius = math.sqrt(max(float(solved[2] + solved[:2] @ solved[:2]), 1e-12))
    angle = float(np.arctan(0.5 * solved[3] / radius))
    return Shape(frame[:, :2] @ solved[:2], frame, radius, angle)


def _slot(points: FloatArray, axis: FloatArray) -> Shape:
    """A slot about a given direction: the box of the points across it."""
    frame = frame_along(axis)
    flat = points @ frame[:, :2]
    # Points lie along the outline: the direction of its longest extent, tried by degrees.
    turns = np.deg2rad(np.arange(0.0, 180.0, 1.0))
    extents = np.ptp(flat @ np.stack([np.cos(turns), np.sin(turns)]), axis=0)
    turn = turns[int(np.argmax(extents))]
    x = np.cos(turn) * frame[:, 0] + np.sin(turn) * frame[:, 1]
    frame = np.column_stack([x, np.cross(frame[:, 2], x), frame[:, 2]])
    across = points @ frame[:, :2]
    middle = 0.5 * (across.min(axis=0) + across.max(axis=0))
    long, short = 0.5 * np.ptp(across, axis=0)
    return Shape(frame[:, :2] @ middle, frame, float(short), half_length=float(max(long - short, 1e-3 * long)))


def _linear(matrix: FloatArray, wanted: FloatArray) -> tuple[FloatArray, float]:
    solved: FloatArray = np.linalg.lstsq(matrix, wanted, rcond=None)[0].astype(np.float64)
    return solved[:-1], float(solved[-1])
