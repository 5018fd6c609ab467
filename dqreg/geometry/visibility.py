"""Faces of a part that are visible from the scanner, and a surface made of those alone."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.raycasting import RayScene
from dqreg.geometry.surface import Closest, Hint
from dqreg.rigid import twist

# Sample points, distributed by area, and on each face at least: its middle, and one near each corner.
SAMPLE_POINTS, CORNER_WEIGHT = 40_000, 0.9
# Margin for a pose that is not final and for an instrument with two cameras: what is visible from a viewpoint rotated
# by so much about the part counts as visible.
MARGIN_RAD = float(np.deg2rad(2.0))
# Rays start outside, so many sizes before their point, and may end short of it by so much: float32 rounding.
RAY_LEAD_SIZES, RAY_ROUNDING_SIZES = 2.0, 2e-6


def visible_faces(mesh: Mesh, viewpoints: FloatArray) -> BoolArray:
    """Which faces are visible, at least in part, from any of some viewpoints.

    A face is seen from either side: a sheet may be meshed with one layer of faces.

    Shapes: returns (f,).
    """
    points, faces = _sample_points(mesh)
    unit = (points - mesh.centre) / mesh.diagonal
    scene = RayScene(mesh.vertices, mesh.faces, mesh.centre, mesh.diagonal)
    seen = np.zeros(len(mesh.faces), dtype=bool)
    for viewpoint in (viewpoints - mesh.centre) / mesh.diagonal:
        for eye in _around(viewpoint):
            left = ~seen[faces]
            rows = np.flatnonzero(left)
            seen[faces[rows[_is_visible(scene, eye, unit[rows], faces[rows])]]] = True
    return seen


def _sample_points(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """Sample points on all faces, (n, 3), and the face of each: the same for the same mesh."""
    rest = 0.5 * (1.0 - CORNER_WEIGHT)
    fixed = np.full((4, 3), 1.0 / 3.0)
    fixed[1:] = rest + (CORNER_WEIGHT - rest) * np.eye(3)
    count = len(mesh.faces)
    more = np.floor(SAMPLE_POINTS * mesh.face_areas / mesh.face_areas.sum()).astype(np.int64)
    faces = np.repeat(np.arange(count), more)
    # Two irrational steps fill the unit square evenly (the R2 sequence); folded, the triangle.
    g = 1.32471795724474602596
    u, v = np.modf(np.arange(1, len(faces) + 1)[:, None] * [1.0 / g, 1.0 / g**2])[0].T
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    shares = np.concatenate([np.tile(fixed, (count, 1)), np.column_stack([1.0 - u - v, u, v])])
    faces = np.concatenate([np.repeat(np.arange(count), 4), faces])
    points: FloatArray = np.einsum("ik,ikj->ij", shares, mesh.corners[faces])
    return points, faces


def _around(viewpoint: FloatArray) -> FloatArray:
    # The viewpoint itself, and four more: rotated about the middle of the part along two directions across the line of
    # sight. One in the very middle has no such line, and moves by as much instead.
    sight = viewpoint / max(float(np.linalg.norm(viewpoint)), 1e-12)
    first = np.cross(sight, np.eye(3)[np.argmin(np.abs(sight))])
    axes = [first / max(float(np.linalg.norm(first)), 1e-12)]
    axes.append(np.cross(sight, axes[0]))
    rotations = [
        twist.exp(np.r_[sign * MARGIN_RAD * axis, 0.0, 0.0, 0.0])[:3, :3] for axis in axes for sign in (1.0, -1.0)
    ]
    return np.array([viewpoint, *(rotation @ viewpoint for rotation in rotations)])


def _is_visible(scene: RayScene, eye: FloatArray, points: FloatArray, faces: IntArray) -> BoolArray:
    """Whether nothing stands between the eye and each point, in units of the part."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    away = points - eye
    lengths = np.linalg.norm(away, axis=1)
    rays = away / np.maximum(lengths, 1e-12)[:, None]
    # From far off, float32 would lose the digits: no ray starts farther out than just outside the part.
    lengths = np.minimum(lengths, RAY_LEAD_SIZES)
    first, met = scene.first_faces(np.column_stack([points - lengths[:, None] * rays, rays]))
    return np.asarray((first == faces) | (met >= lengths - RAY_ROUNDING_SIZES))


def blocked(mesh: Mesh, points: FloatArray, eyes: FloatArray, margin: float) -> BoolArray:
    """Whether the mesh stands between each point, (n, 3), and every eye, (k, 3), by more than a margin before it, (n,).

    The last part of each line of sight, as long as the margin, does not count.
    """
    scene = RayScene(mesh.vertices, mesh.faces, mesh.centre, mesh.diagonal)
    found = np.ones(len(points), dtype=bool)
    unit, short = (points - mesh.centre) / mesh.diagonal, margin / mesh.diagonal
    for eye in (eyes - mesh.centre) / mesh.diagonal:
        away = eye - unit
        lengths = np.linalg.norm(away, axis=1)
        rays = away / np.maximum(lengths, 1e-12)[:, None]
        _, met = scene.first_faces(np.column_stack([unit + short * rays, rays]))
        found &= met < lengths - short
    return found


class VisibleSurface(MeshSurface):
    """The faces of a mesh that were seen, as a surface; faces are numbered as in the whole mesh."""

    def __init__(self, mesh: Mesh, seen: BoolArray) -> None:
        super().__init__(mesh)
        self.rows = np.flatnonzero(seen)
        self._seen = MeshSurface(Mesh(mesh.vertices, mesh.faces[seen]))
        # Sizes stay those of the part: widths and tolerances refer to them.
        self._seen.diagonal, self._seen.centre = self.diagonal, self.centre

    @property
    def borders(self) -> MeshBoundary | None:
        """Where what was seen ends."""
        return self._seen.mesh.borders

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Closest point on the faces that were seen, for each query."""
        if hint is not None:
            places, before = hint
            hint = places, dataclasses.replace(before, elements=np.searchsorted(self.rows, before.elements))
        return self._in_whole(self._seen.closest(points, hint, within))

    def _closest_facing(
        self, points: FloatArray, directions: FloatArray, cosine: float, within: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Closest points on those faces that were seen and look to a direction each."""
        places, distances, faces = self._seen._closest_facing(points, directions, cosine, within)
        return places, distances, self._numbers(faces)

    def _distances_at(
        self, rotations: FloatArray, shifts: FloatArray, points: FloatArray, within: float, *, by_point: bool = False
    ) -> FloatArray:
        """Distances from the faces that were seen."""
        return self._seen._distances_at(rotations, shifts, points, within, by_point=by_point)

    def _in_whole(self, found: Closest) -> Closest:
        return dataclasses.replace(found, elements=self._numbers(found.elements))

    def _numbers(self, faces: IntArray) -> IntArray:
        return np.where(faces < 0, -1, self.rows[faces])
