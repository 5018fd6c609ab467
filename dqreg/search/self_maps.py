"""Symmetries of a part, from its mesh alone: turns that leave it as it is, told apart from mirror images.

A turn that leaves the part as it is gives a second pose that no scan can tell from the first; a mirror symmetry does
not, because a rigid part cannot be mirrored. Both leave the centre of the surface where it is, so only rotations about
it are searched: a few thousand of them on the distance grid, the best refined, and every one checked on dense points.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Mesh, Surface, sample_mesh
from dqreg.rigid.rotations import about_axis
from dqreg.search.axes import moments, principal_axes
from dqreg.search.grids import PlaneGrid, distinct
from dqreg.search.refine import Sample, refine
from dqreg.search.rotations import SAME_AXIS_RAD, all_round, angle_of, axis_of, canonical, keeps_axis
from dqreg.search.symmetry import Axis, Symmetry

# Largest distance from the part after a symmetric turn, in sizes: the facets of a round hole are no feature.
SAME = 2e-3
# Rotations tried on the grid, the best of them refined; points for either, and for the check.
TRIED, REFINED, SCREENED, FITTED, CHECKED = 4_000, 80, 150, 200, 2_000
# Reach of the screening and first and last width of the refinement, in sizes.
REACH, WIDE, FINE, NARROW, STEPS = 0.06, 0.04, 6e-3, 5e-4, 6
# A turn is worth the exact surface with this score on the grid, at this reach beyond a cell, in sizes.
FINE_REACH, LIKELY = 0.01, 0.55
# Highest order that is looked for about the principal axes; above it a part is as good as round.
HIGHEST = 72
# An angle that is a fraction of no turn of interest: what survives it is round.
ODD_RAD = 1.0
# A turn leaves most of the part in place where this share of it comes this close, in sizes; turns kept, and how far
# apart they are.
MOST, NEARLY, NEAR_KEPT, NEAR_RAD = 0.7, 5e-3, 24, 0.1


def find_symmetry(mesh: Mesh, surface: Surface, grid: PlaneGrid) -> Symmetry:
    """Symmetries of a mesh from itself alone."""
    part = _Part.of(mesh, surface, grid)
    turns, shifts = _candidates(part, grid, 1.0)
    near = part.nearly_same(turns, shifts)
    main = part.principal
    # What survives an odd angle is round: its orders need not be asked for.
    odd = np.array([about_axis(axis, ODD_RAD) for axis in main.T])
    is_round = part.same(odd)
    orders = range(2, HIGHEST + 1)
    by_order = [about_axis(axis, 2.0 * np.pi / k) for axis in main.T[~is_round] for k in orders]
    turns = np.concatenate([turns, np.array(by_order).reshape(-1, 3, 3)])
    turns = np.concatenate([turns[part.same(turns)], odd[is_round]])
    turns = turns[[k for k in range(len(turns)) if angle_of(turns[k]) > SAME_AXIS_RAD]]
    axes = _axes(part, turns)
    others = np.array([R for R in turns if not any(a.order is None and keeps_axis(R, a.direction) for a in axes)])
    others = _unlike(others.reshape(-1, 3, 3), axes)
    poses = np.tile(np.eye(4), (len(others), 1, 1))
    poses[:, :3, :3] = others
    poses[:, :3, 3] = part.centre - others @ part.centre
    mirrored, _ = _candidates(part, grid, -1.0)
    mirrored = mirrored[part.same(mirrored)]
    # A reflection in a plane is its own inverse; the other improper turns are not reflections.
    normals = [np.linalg.eigh(0.5 * (Q + Q.T))[1][:, 0] for Q in mirrored if abs(np.trace(Q) - 1.0) < 1e-3]
    kept: list[FloatArray] = []
    for normal in normals:
        if all(np.arccos(min(abs(float(normal @ other)), 1.0)) > SAME_AXIS_RAD for other in kept):
            kept.append(canonical(normal))
    return Symmetry(axes, np.array(kept).reshape(-1, 3), poses, near, part.centre)


@dataclasses.dataclass(frozen=True)
class _Part:
    """What the tests need of the part: its surface, its centre and axes, points to fit and points to check."""

    surface: Surface
    grid: PlaneGrid
    centre: FloatArray
    principal: FloatArray
    points: FloatArray
    normals: FloatArray
    checks: FloatArray

    @staticmethod
    def of(mesh: Mesh, surface: Surface, grid: PlaneGrid) -> _Part:
        rng = np.random.default_rng(0)
        centre, principal = principal_axes(*moments(mesh))
        sample = sample_mesh(mesh, CHECKED, rng)
        # Small features have small areas but many corners.
        corners = mesh.vertices[np.unique(mesh.faces)]
        corners = corners[rng.permutation(len(corners))[:CHECKED]]
        normals = np.asarray(sample.normals)
        return _Part(surface, grid, centre, principal, sample.points, normals, np.concatenate([corners, sample.points]))

    def same(self, turns: FloatArray) -> BoolArray:
        """Which of n orthogonal matrices, applied about the centre, leave the part as it is; few points first."""
        alive = np.ones(len(turns), dtype=bool)
        arms = self.checks - self.centre
        # No place is nearer than its node, but for the way between them.
        limit, some = SAME * self.surface.diagonal, arms[:: max(1, len(arms) // FITTED)]
        known = np.append(self.grid.distances, np.float32(np.inf))
        for k, R in enumerate(turns):
            alive[k] = known[self.grid.nodes(some @ R.T + self.centre)].max() < limit + self.grid.cell
        for few in (60, 600, len(arms)):
            rows = np.flatnonzero(alive)
            if len(rows):
                some = arms[:: max(1, len(arms) // few)]
                moved = some @ turns[rows].transpose(0, 2, 1) + self.centre
                found = self.surface.closest(moved.reshape(-1, 3)).distances.reshape(len(rows), -1)
                alive[rows] = found.max(axis=1) < limit
        return alive

    def nearly_same(self, R: FloatArray, t: FloatArray) -> FloatArray:
        """The distinct poses, (k, 4, 4), that leave most of the part in place, but for the identity."""
        some = self.points[:: max(1, len(self.points) // FITTED)]
        moved = some @ R.transpose(0, 2, 1) + t[:, None, :]
        found = self.surface.closest(moved.reshape(-1, 3)).distances.reshape(len(R), -1)
        share = (found < NEARLY * self.surface.diagonal).mean(axis=1)
        rows = np.argsort(-share, kind="stable")
        rows = rows[(share[rows] > MOST) & (np.trace(R[rows], axis1=1, axis2=2) < 3.0 - NEAR_RAD**2)]
        rows = rows[distinct(R[rows], t[rows], self.centre, NEAR_RAD, 0.02 * self.surface.diagonal, NEAR_KEPT)]
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = R[rows], t[rows]
        return poses


def _candidates(part: _Part, grid: PlaneGrid, sign: float) -> tuple[FloatArray, FloatArray]:
    """Orthogonal matrices of determinant ``sign``, and shifts, that may leave the part as it is, refined."""
    rng = np.random.default_rng(0)
    size = part.surface.diagonal
    R = all_round(TRIED)
    points = part.centre + sign * (part.points - part.centre)
    normals = sign * part.normals
    t = part.centre - R @ part.centre
    some = points[rng.choice(len(points), size=min(SCREENED, len(points)), replace=False)]
    best = np.argsort(-grid.scores(R, t, some, REACH * size), kind="stable")[: 8 * REFINED]
    R, t = R[best], t[best]
    kept = distinct(R, t, part.centre, np.deg2rad(10.0), np.inf, REFINED)
    rows = rng.choice(len(points), size=min(FITTED, len(points)), replace=False)
    sample = Sample(points[rows], normals[rows], np.zeros((0, 3)), np.zeros((0, 3)))
    R, t, nothing = R[kept], t[kept], points[:0]
    R, t = refine(R, t, sample, grid, None, np.geomspace(WIDE, FINE, STEPS) * size, nothing)
    # Few are worth the exact surface.
    likely = grid.scores(R, t, sample.points, FINE_REACH * size + grid.cell) > LIKELY
    R, t = R[likely], t[likely]
    R, t = refine(R, t, sample, part.surface, None, np.geomspace(FINE, NARROW, STEPS) * size, nothing)
    return sign * R, t


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
        order: int | None = round(2.0 * np.pi / min(angles))
        if part.same(about_axis(direction, ODD_RAD)[None])[0]:
            order = None
        found.append(Axis(direction, part.centre, order))
    round_axes = [axis for axis in found if axis.order is None]
    if round_axes:
        # About a round axis the half-turns across it are one family: one stands for all.
        across = [a for a in found if a.order is not None and a.order == 2]
        return (*round_axes, *across[:1])
    return tuple(sorted(found, key=lambda axis: -(axis.order or 0)))


def _unlike(turns: FloatArray, axes: tuple[Axis, ...]) -> FloatArray:
    """Each turn once; about a round axis, turns that differ by a turn about it are one."""
    around = [axis.direction for axis in axes if axis.order is None]
    kept: list[FloatArray] = []
    for R in turns:
        if around:
            alike = any(np.linalg.norm(R @ around[0] - other @ around[0]) < SAME_AXIS_RAD for other in kept)
        else:
            alike = any(angle_of(R @ other.T) < SAME_AXIS_RAD for other in kept)
        if not alike:
            kept.append(R)
    return np.array(kept).reshape(-1, 3, 3)
