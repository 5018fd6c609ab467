"""Symmetries of a part, from its mesh alone.

A rotation that leaves the part as it is gives a second pose that no scan can tell from the first; a mirror symmetry
does not, because a rigid part cannot be mirrored. It leaves the centre of the surface where it is, so only rotations
about that are searched: a few thousand of them on the distance grid, the best refined, and every one checked on dense
points.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Mesh, Surface, sample_mesh
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis, angle_of, axis_of, evenly_spread
from dqreg.rigid.symmetry import SAME_AXIS_RAD, Axis, Symmetry
from dqreg.search.axes import moments, principal_axes
from dqreg.search.grids import PlaneGrid
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refine
from dqreg.solvers.motion_words import axis_words

# Distance from the part, in sizes, within which a point lies on it: the facets of a round hole are no feature.
ON_PART_DIAGONALS = 2e-3
# A motion leaves most of the part in place where this fraction of its surface comes this close, in sizes.
NEAR_SYMMETRY_FRACTION, NEAR_SYMMETRY_DIAGONALS = 0.7, 5e-3
# Near symmetries that are kept, and how far apart they are: radians, sizes.
NEAR_KEPT, NEAR_APART = 24, (0.1, 0.02)
# Rotations tried on the grid, the best of them refined, and how far apart these are.
TRIED_ROTATIONS, REFINED_ROTATIONS = 4_000, 80
APART_RAD = np.deg2rad(10.0)
# Points that screen, refine, check.
SCREEN_POINTS = 150
FIT_POINTS = 200
CHECK_POINTS = 2_000
# Reach of the gain in the screening, in sizes.
SCREEN_REACH_DIAGONALS = 0.06
# Refinement on the grid, and from where that ends on the surface.
ON_GRID = Refinement(first=0.04, last=6e-3, steps=6, points=FIT_POINTS)
ON_SURFACE = Refinement(first=ON_GRID.last, last=5e-4, steps=6, points=FIT_POINTS)
# Rotations are refined on the surface with this mean gain on the grid, at this reach beyond a cell, in sizes.
FINE_REACH_DIAGONALS, MIN_FINE_GAIN = 0.01, 0.55
# Highest order that is looked for about the principal axes; above it a part is as good as round.
MAX_ORDER = 72
# No multiple of the angle of an order up to the highest: an axis about which it is a symmetry is round.
ROUND_TEST_RAD = 1.0


def find_symmetry(mesh: Mesh, surface: Surface, grid: PlaneGrid) -> Symmetry:
    """Symmetries of a mesh from itself alone; the poses besides the identity are not rotations about a round axis."""
    part = _Part.of(mesh, surface, grid)
    candidates = _candidates(part, grid)
    near = part.nearly_same(candidates)
    main = part.principal
    # An axis about which the odd angle is a symmetry is round: its orders need not be tried.
    odd = np.array([about_axis(axis, ROUND_TEST_RAD) for axis in main.T])
    is_round = part.same(odd)
    by_order = [about_axis(axis, 2.0 * np.pi / k) for axis in main.T[~is_round] for k in range(2, MAX_ORDER + 1)]
    turns = np.concatenate([candidates.R, np.array(by_order).reshape(-1, 3, 3)])
    # Many candidates are the identity, which would be checked on all points.
    turns = turns[[k for k in range(len(turns)) if angle_of(turns[k]) > SAME_AXIS_RAD]]
    turns = np.concatenate([turns[part.same(turns)], odd[is_round]])
    axes = _axes(part, turns)
    round_axes = [axis for axis in axes if axis.order is None]
    others = [R for R in turns if not any(axis.is_kept_by(R) for axis in round_axes)]
    unlike = np.array([np.eye(3), *_unlike(others, round_axes)])
    return Symmetry(pose.from_parts(unlike, part.centre - unlike @ part.centre), near, axes, part.centre)


def symmetry_words(axis: Axis, units: str | None = None, size: float = 0.0) -> str:
    """The symmetry about an axis in a sentence."""
    rotation = "any rotation" if axis.order is None else f"a rotation of {360.0 / axis.order:.4g} degrees"
    return f"the part looks the same after {rotation} about {axis_words(axis.point, axis.direction, units, size)}"


@dataclasses.dataclass(frozen=True)
class _Part:
    """What the tests need of the part: its surface, its centre and axes, points to fit and points to check."""

    surface: Surface
    grid: PlaneGrid
    centre: FloatArray
    principal: FloatArray
    sample: OrientedPoints
    checks: FloatArray

    @staticmethod
    def of(mesh: Mesh, surface: Surface, grid: PlaneGrid) -> _Part:
        rng = np.random.default_rng(0)
        centre, principal = principal_axes(*moments(mesh))
        sample = sample_mesh(mesh, CHECK_POINTS, rng)
        # Small features have small areas but many corners.
        corners = mesh.vertices[np.unique(mesh.faces)]
        corners = corners[rng.permutation(len(corners))[:CHECK_POINTS]]
        oriented = OrientedPoints.on_faces(centre + (sample.points - centre), np.asarray(sample.normals))
        return _Part(surface, grid, centre, principal, oriented, np.concatenate([corners, sample.points]))

    def same(self, turns: FloatArray) -> BoolArray:
        """Which of n rotations about the centre leave the part as it is; few points first."""
        arms = self.checks - self.centre
        # No point is nearer than its node, but for the way between them.
        limit, some = ON_PART_DIAGONALS * self.surface.diagonal, arms[:: max(1, len(arms) // FIT_POINTS)]
        about = Poses(turns, np.tile(self.centre, (len(turns), 1)))
        alive = self.grid.are_within(about, some, limit + self.grid.cell)
        for few in (60, 600, len(arms)):
            rows = np.flatnonzero(alive)
            if len(rows):
                some = arms[:: max(1, len(arms) // few)]
                moved = about[rows].apply(some).reshape(-1, 3)
                found = self.surface.closest(moved, within=2.0 * limit).distances.reshape(len(rows), -1)
                alive[rows] = found.max(axis=1) < limit
        return alive

    def nearly_same(self, poses: Poses) -> FloatArray:
        """The distinct poses, (k, 4, 4), that leave most of the part in place, but for the identity."""
        moved = poses.apply(self.sample.points[:: max(1, len(self.sample) // FIT_POINTS)])
        found = self.surface.closest(moved.reshape(-1, 3)).distances.reshape(len(poses), -1)
        fraction = (found < NEAR_SYMMETRY_DIAGONALS * self.surface.diagonal).mean(axis=1)
        angle_rad, offset = NEAR_APART
        rows = np.argsort(-fraction, kind="stable")
        rows = rows[
            (fraction[rows] > NEAR_SYMMETRY_FRACTION) & (np.trace(poses.R[rows], axis1=1, axis2=2) < 3.0 - angle_rad**2)
        ]
        # What a motion leaves in place its inverse does: each is followed by that.
        near, twice = poses[rows] + poses[rows].inverse, np.arange(2 * len(rows)).reshape(2, -1).T.ravel()
        near = near[twice]
        return near[near.distinct(self.centre, angle_rad, offset * self.surface.diagonal, NEAR_KEPT)].matrices


def _candidates(part: _Part, grid: PlaneGrid) -> Poses:
    """Poses that may leave the part as it is, refined."""
    rng = np.random.default_rng(0)
    size = part.surface.diagonal
    R = _matrices(evenly_spread(TRIED_ROTATIONS))
    poses = Poses(R, part.centre - R @ part.centre)
    count = len(part.sample)
    some = part.sample.points[rng.choice(count, size=min(SCREEN_POINTS, count), replace=False)]
    poses = poses[
        np.argsort(-grid.scores(poses, some, SCREEN_REACH_DIAGONALS * size), kind="stable")[: 8 * REFINED_ROTATIONS]
    ]
    sample = part.sample[rng.choice(count, size=min(FIT_POINTS, count), replace=False)]
    poses = poses[poses.distinct(part.centre, APART_RAD, np.inf, REFINED_ROTATIONS)]
    poses = refine(poses, sample, grid, ON_GRID.widths(size))
    poses = poses[
        np.flatnonzero(grid.scores(poses, sample.points, FINE_REACH_DIAGONALS * size + grid.cell) > MIN_FINE_GAIN)
    ]
    return refine(poses, sample, part.surface, ON_SURFACE.widths(size))


def _matrices(q: FloatArray) -> FloatArray:
    # `quaternion.to_matrix` to rounding, in the order of operations that past results came from.
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _axes(part: _Part, turns: FloatArray) -> tuple[Axis, ...]:
    groups: list[tuple[FloatArray, list[float]]] = []
    for R in turns:
        direction = axis_of(R)
        for known, angles in groups:
            if abs(float(direction @ known)) > np.cos(SAME_AXIS_RAD):
                angles.append(angle_of(R))
                break
        else:
            groups.append((direction, [angle_of(R)]))
    found = []
    for direction, angles in groups:
        is_round = part.same(about_axis(direction, ROUND_TEST_RAD)[None])[0]
        found.append(Axis(direction, part.centre, None if is_round else round(2.0 * np.pi / min(angles))))
    round_axes = [axis for axis in found if axis.order is None]
    if round_axes:
        # About a round axis the half-turns across it are one family: one stands for all.
        across = [axis for axis in found if axis.order == 2]
        return (*round_axes, *across[:1])
    return tuple(sorted(found, key=lambda axis: -(axis.order or 0)))


def _unlike(turns: list[FloatArray], round_axes: list[Axis]) -> list[FloatArray]:
    """Each rotation once; about a round axis, those that differ by a rotation about it are one."""
    kept: list[FloatArray] = []
    for R in turns:
        if round_axes:
            around = round_axes[0].direction
            alike = any(np.linalg.norm(R @ around - other @ around) < SAME_AXIS_RAD for other in kept)
        else:
            alike = any(angle_of(R @ other.T) < SAME_AXIS_RAD for other in kept)
        if not alike:
            kept.append(R)
    return kept
