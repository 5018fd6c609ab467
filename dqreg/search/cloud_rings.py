"""Rings among clouds: turns that put most of a cloud onto itself, about an axis that no moments of a partial view name.

The normal of a large plane is the direction of the axis, and it runs where the normals of the rest pass by it. One step
is refined, which tells axis and order: all multiples of it may be other poses.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface
from dqreg.geometry.normals import sample_rows
from dqreg.rigid import pose, twist
from dqreg.rigid.rotations import angle_of
from dqreg.search.plane_maps import PLANE_POINTS, Planes
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.rings import RING_POINTS, Ring, ring_steps
from dqreg.search.tangent_planes import TangentPlanes

# Share of the points in the planes across an axis, at least; mean distance at which the normals pass it, in shares of
# that of the points: rings of 24 and 40 lobes came to 0.05 to 0.2.
MIN_PLANE_SHARE, MAX_AXIS_DISTANCE_SHARE = 0.08, 0.25
# Directions that are tried.
TRIED_DIRECTIONS = 3
# Rounds of the median of those distances and the least weighed one, in sizes.
MEDIAN_ROUNDS, MIN_DISTANCE_DIAGONALS = 6, 1e-3
# Refinement of one step of a ring.
REFINEMENT = Refinement(first=0.01, steps=10)
# The order of a ring is a whole number within this: holes of another order draw the refinement of a step a little to
# none. It moves nothing along the axis by more, in sizes.
ORDER_TOLERANCE, MAX_AXIAL_DIAGONALS = 0.4, 5e-3


def ring_turns(surface: CloudSurface, tangent: TangentPlanes) -> FloatArray:
    """Turns of a cloud by all multiples of one step of the ring that it shows, (k, 4, 4); none where it shows none."""
    none = np.zeros((0, 4, 4))
    points, normals, _ = surface._distinct.sampled(PLANE_POINTS)
    normals = np.nan_to_num(normals)
    axis_and_point = _axis(points, normals, surface.diagonal)
    if axis_and_point is None:
        return none
    axis, centre = axis_and_point
    arms = points[sample_rows(len(points), RING_POINTS)] - centre
    steps = ring_steps(Ring(axis, centre, np.eye(3), arms, tangent))
    if not steps:
        return none
    step = pose.from_parts(steps[0], centre - steps[0] @ centre)
    return _multiples(refined_on(step[None], surface._distinct.points, surface, REFINEMENT)[0], surface.diagonal)


def _axis(points: FloatArray, normals: FloatArray, size: float) -> tuple[FloatArray, FloatArray] | None:
    """Direction and point of the axis that the normals pass nearest by, across large planes; None for none."""
    planes = Planes.of(points, normals, size)
    best, found = MAX_AXIS_DISTANCE_SHARE, None
    for axis, shares in list(zip(planes.directions, planes.shares, strict=True))[:TRIED_DIRECTIONS]:
        if shares.sum() < MIN_PLANE_SHARE:
            continue
        centre = _point_of(axis, points, normals, size)
        lever = float(np.linalg.norm(np.cross(axis, points - centre), axis=1).mean())
        aside = float(np.abs(np.einsum("ij,ij->i", np.cross(normals, axis), points - centre)).mean())
        if aside < best * lever:
            best, found = aside / lever, (axis, centre)
    return found


def _point_of(axis: FloatArray, points: FloatArray, normals: FloatArray, size: float) -> FloatArray:
    """Point of the axis along a direction for which the sum of distances at which the normals pass it is least."""
    across = np.linalg.svd(axis[None])[2][1:]
    rows = np.cross(normals, axis)
    columns, aside = rows @ across.T, np.einsum("ij,ij->i", rows, points)
    weights, found = np.ones(len(points)), np.zeros(2)
    for _ in range(MEDIAN_ROUNDS):
        weighted = columns * weights[:, None]
        found = np.linalg.lstsq(weighted.T @ columns, weighted.T @ aside, rcond=1e-9)[0]
        weights = 1.0 / np.maximum(np.abs(aside - columns @ found), MIN_DISTANCE_DIAGONALS * size)
    return np.asarray(found @ across)


def _multiples(step: FloatArray, size: float) -> FloatArray:
    """All turns but none by multiples of a step, about its axis, (k, 4, 4); none where it is no part of a turn."""
    angle = angle_of(step[:3, :3])
    order = round(2.0 * np.pi / angle) if angle > 0.1 else 0
    if order < 2 or abs(2.0 * np.pi / angle - order) > ORDER_TOLERANCE:
        return np.zeros((0, 4, 4))
    motion = twist.log(step)
    along = motion[:3] @ motion[3:] / angle**2 * motion[:3]
    if np.linalg.norm(along) > MAX_AXIAL_DIAGONALS * size:
        return np.zeros((0, 4, 4))
    motion = 2.0 * np.pi / (order * angle) * np.r_[motion[:3], motion[3:] - along]
    return np.array([twist.exp(k * motion) for k in range(1, order)])
