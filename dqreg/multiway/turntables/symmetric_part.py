"""Turns that leave the merged model as it is: found on the model alone, where no pair names a rival."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.multiway.scans.overlap import cell_numbers
from dqreg.rigid import DualQuaternion, pose

# Orders that are tried; a symmetry of one that is no prime has those of its primes.
PRIMES, MAX_ORDER = (2, 3, 5, 7, 11), 12
# Points that screen rotations and that refine them.
SCREENING_POINTS, FITTING_POINTS = 300, 1_000
# How many are refined, and in how many rounds.
MAX_REFINED, FITTING_ROUNDS = 12, 12
# The share of the nearest points that a round of it believes, and how many of those it takes.
BELIEVED_SHARE, MIN_BELIEVED_POINTS = 0.8, 12
# Directions of large faces that may be axes besides the principal ones, and the cosine of those that are one.
MAX_FACE_DIRECTIONS, SAME_DIRECTION_COS = 4, 0.98
# A turn refined has its angle within this, in radians, and slides along its axis by less than this, in sizes.
MAX_ANGLE_ERROR_RAD, MAX_SLIDE_SIZES = 0.02, 0.01
# Points of the model that may lie beside it rotated either way, as a share: 0.0033 at most for prisms, whose undersides
# were seen in part, 0.016 at least for a part that is nearly a wheel.
TELLING_POINTS, MAX_OFF_SHARE = 1_500, 0.008
# The same of few points first.
FIRST_TELLING_POINTS, FIRST_MAX_OFF_SHARE = 150, 0.06
# A point lies on the model within so many spacings of one of so many points,
NEAR_SPACINGS, NEAR_NEIGHBOURS = 3.0, 8
# at this cosine of the normals.
MIN_NORMAL_COS = 0.9


def symmetric_axis(
    points: FloatArray, normals: FloatArray, spacing: float, thick: float
) -> tuple[FloatArray, FloatArray, int] | None:
    """Axis, point on it and order of the highest symmetry of a model of scans; None without one.

    Whichever way it is turned must bring each point onto the model, unless nobody saw where it goes: of a turn and its
    inverse, one must do. Points lie on the model within ``thick`` along its normals. Shapes: points, normals (n, 3).
    """
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    first = np.unique(cell_numbers(points, 2.0 * spacing), return_index=True)[1]
    tree, best = NeighbourTree(points), None
    rows = np.linspace(0, len(points) - 1, min(len(points), TELLING_POINTS)).astype(np.int64)

    def beside(D: FloatArray, some: IntArray) -> float:
        off = np.ones(len(some), dtype=bool)
        for T in (D, pose.inverse(D)):
            moved, turned = pose.apply(T, points[some]), normals[some] @ T[:3, :3].T
            near, apart = tree.nearest(moved, NEAR_NEIGHBOURS)
            along = np.abs(np.einsum("ikj,ikj->ik", moved[:, None] - points[near], normals[near]))
            cosines = np.abs(np.einsum("ij,ikj->ik", turned, normals[near]))
            off &= ~((apart < NEAR_SPACINGS * spacing) & (along < thick) & (cosines > MIN_NORMAL_COS)).any(axis=1)
        return float(np.mean(off))

    for axis, point in candidate_turns(points[first], normals[first], size):
        for order in range(MAX_ORDER, 1 if best is None else best[2], -1):
            D = pose.about(pose.exp(np.r_[2.0 * np.pi / order * axis, np.zeros(3)]), point)
            if (
                beside(D, rows[:: max(1, len(rows) // FIRST_TELLING_POINTS)]) < FIRST_MAX_OFF_SHARE
                and beside(D, rows) < MAX_OFF_SHARE
            ):
                best = axis, point, order
                break
    return best


def candidate_turns(points: FloatArray, normals: FloatArray, size: float) -> list[tuple[FloatArray, FloatArray]]:
    """Axes with a point on each, (3,) and (3,), about which a turn by a prime order comes to lie best on the model.

    About the principal axes, which those of a symmetry are, and the directions of large faces, where two are as good.
    """
    rows = np.linspace(0, len(points) - 1, min(len(points), FITTING_POINTS)).astype(np.int64)
    tree, centre = NeighbourTree(points), points.mean(axis=0)
    few = points[rows[:: max(1, len(rows) // SCREENING_POINTS)]]
    screened = []
    for axis in _directions(points - centre, normals):
        for order in PRIMES:
            D = pose.about(pose.exp(np.r_[2.0 * np.pi / order * axis, np.zeros(3)]), centre)
            apart = tree.nearest(pose.apply(D, few), 1)[1][:, 0]
            screened.append((float(np.quantile(apart, BELIEVED_SHARE)), order, D))
    screened.sort(key=lambda each: each[0])
    found, inward = [], pose.from_parts(np.eye(3), -centre)
    for _, order, D in screened[:MAX_REFINED]:
        refined = _refined(D, points, normals, tree, rows)
        screw = DualQuaternion.from_matrix(inward @ refined @ pose.inverse(inward)).as_screw()
        if (
            abs(screw.angle_rad - 2.0 * np.pi / order) < MAX_ANGLE_ERROR_RAD
            and abs(screw.distance) < MAX_SLIDE_SIZES * size
        ):
            found.append((screw.axis, centre + screw.point))
    return found


def _directions(arms: FloatArray, normals: FloatArray) -> FloatArray:
    """Principal axes and directions of the largest faces, (k, 3)."""
    axes = list(np.linalg.eigh(arms.T @ arms)[1].T)
    left = normals[:: max(1, len(normals) // FITTING_POINTS)]
    for _ in range(MAX_FACE_DIRECTIONS):
        if not len(left):
            break
        alike = np.abs(left @ left.T) > SAME_DIRECTION_COS
        best = int(alike.sum(axis=1).argmax())
        group = left[alike[best]]
        axes.append(np.linalg.eigh(group.T @ group)[1][:, -1])
        left = left[~alike[best]]
    return np.array(axes)


def _refined(D: FloatArray, points: FloatArray, normals: FloatArray, tree: NeighbourTree, rows: IntArray) -> FloatArray:
    """The motion that brings the model onto its own planes, from one near it."""
    centre = points.mean(axis=0)
    for _ in range(FITTING_ROUNDS):
        moved = pose.apply(D, points[rows])
        nearest, apart = tree.nearest(moved, 1)
        near = nearest[:, 0]
        good = (apart[:, 0] <= np.quantile(apart[:, 0], BELIEVED_SHARE)) & (
            np.abs(np.einsum("ij,ij->i", normals[rows] @ D[:3, :3].T, normals[near])) > SAME_DIRECTION_COS
        )
        if np.count_nonzero(good) < MIN_BELIEVED_POINTS:
            break
        moved, n = moved[good], normals[near[good]]
        lines = np.hstack([np.cross(moved - centre, n), n])
        off = np.einsum("ij,ij->i", n, moved - points[near[good]])
        step = -np.linalg.lstsq(lines, off, rcond=1e-4)[0]
        D = pose.about(pose.exp(step), centre) @ D
    return D
