"""What the rays of a scanner meet: Open3D finds the triangle, float64 the point on it; at rest or in motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, IntArray, as_vectors
from dqreg.errors import InputError
from dqreg.geometry.raycasting import RayScene
from dqreg.rigid import pose
from dqreg.synth.cameras import Pattern, unit
from dqreg.synth.motion import Motion, moved_each, poses_at, turned_each
from dqreg.synth.parts.plain import Mesh


def check_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return the checked arrays of a triangle mesh."""
    V, given = as_vectors(vertices, "vertices"), as_vectors(faces, "faces")
    F = np.asarray(faces)
    if F.dtype.kind not in "iu":
        raise InputError(f"faces must be whole numbers of shape (f, 3); got {F.dtype} of shape {given.shape}")
    if not F.size or F.min() < 0 or F.max() >= len(V):
        raise InputError(f"faces must hold at least one row, and indices from 0 to {len(V) - 1}")
    if not np.ptp(V, axis=0).any():
        raise InputError("the mesh has no extent: all vertices are at one point")
    return V, F.astype(np.int64)


def centre_and_diagonal(vertices: FloatArray) -> tuple[FloatArray, float]:
    """Centre and diagonal of the bounding box, as the position and the size of a part."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def first_hits(
    vertices: FloatArray, faces: IntArray, origins: FloatArray, directions: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Face that each ray meets first, and the point where it does.

    The ray caster is asked for the face only; ray and plane of the face are then intersected in float64.
    Near an edge that point can lie beside the face by the caster's own error, about 1e-7 of the size; its barycentric
    coordinates are then clipped, so that every point lies on the mesh.
    """
    face_index = _first_faces(vertices, faces, origins, directions)
    points = np.full(origins.shape, np.nan)
    hit = face_index >= 0
    points[hit] = _on_faces(vertices[faces[face_index[hit]]], origins[hit], directions[hit])
    return face_index, points


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Compute the unit normal of each face by the right-hand rule."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), np.nan)


def _first_faces(vertices: FloatArray, faces: IntArray, origins: FloatArray, directions: FloatArray) -> IntArray:
    centre, size = centre_and_diagonal(vertices)
    scene = RayScene(vertices, faces, centre, size)
    return scene.first_faces(np.concatenate([(origins - centre) / size, directions], axis=1))[0]


def _on_faces(corners: FloatArray, origins: FloatArray, directions: FloatArray) -> FloatArray:
    """Where each ray meets the plane of its triangle (corners: (n, 3, 3)), clipped to the triangle."""
    a = corners[:, 0]
    e, f = corners[:, 1] - a, corners[:, 2] - a
    # Moeller and Trumbore (1997): barycentric coordinates straight from the ray.
    p = np.cross(directions, f)
    determinant = np.einsum("ni,ni->n", e, p)
    from_corner = origins - a
    q = np.cross(from_corner, e)
    scale = 1.0 / np.where(determinant == 0.0, np.inf, determinant)
    u = np.clip(np.einsum("ni,ni->n", from_corner, p) * scale, 0.0, 1.0)
    v = np.clip(np.einsum("ni,ni->n", directions, q) * scale, 0.0, 1.0)
    excess = np.maximum(u + v, 1.0)
    points: FloatArray = a + (u / excess)[:, None] * e + (v / excess)[:, None] * f
    return points


# What lies this close before a point, over the length of the ray, is the point's own face.
_OWN_FACE = 1e-6


@dataclass(frozen=True, eq=False)
class Hits:
    """First meeting of each ray with the scene, in the sensors' frame at the time of the ray."""

    face_index: IntArray  # (n,): Face of the scene, -1 where the ray meets nothing
    points: FloatArray  # (n, 3): Where it is met, NaN where the ray meets nothing
    normals: FloatArray  # (n, 3): Normal of the face; of no meaning where the ray meets nothing
    poses: FloatArray | None  # (n, 4, 4): Motion of the scene since the reference time; None at rest


def cast(scene: Mesh, origins: FloatArray, rays: FloatArray, poses: FloatArray | None) -> Hits:
    """Meet the scene with rays. Shapes: poses (n, 4, 4)."""
    if poses is None:
        face_index, points = first_hits(*scene, origins, rays)
        return Hits(face_index, points, face_normals(*scene)[face_index], None)
    back = pose.inverse(poses)
    face_index, points = first_hits(*scene, moved_each(back, origins), turned_each(back, rays))
    normals = turned_each(poses, face_normals(*scene)[face_index])
    return Hits(face_index, moved_each(poses, points), normals, poses)


def is_lit(scene: Mesh, hits: Hits, projectors: FloatArray, max_incidence_rad: float) -> BoolArray:
    """Whether each point is seen from a second position as well."""
    met = np.flatnonzero(hits.face_index >= 0)
    ways = hits.points[met] - projectors[met]
    length = np.linalg.norm(ways, axis=1)
    cosine = -np.einsum("ni,ni->n", ways, hits.normals[met]) / length
    poses = None if hits.poses is None else hits.poses[met]
    first = cast(scene, projectors[met], ways / length[:, None], poses)
    reached = np.linalg.norm(first.points - projectors[met], axis=1)  # NaN where the light misses an edge
    lit = np.zeros(len(hits.face_index), dtype=bool)
    lit[met] = (cosine > np.cos(max_incidence_rad)) & (reached >= (1.0 - _OWN_FACE) * length)
    return lit


@dataclass(frozen=True, eq=False)
class SweepHits:
    """What each ray of a sweep meets, in the sensors' frame at the time of the ray."""

    image: tuple[int, int, int]  # Views, rows and columns; their product is n
    diagonal: float  # Diagonal of the part
    sensors: FloatArray  # (k, 3): Sensor of each view
    view_index: IntArray  # (n,): View of each ray
    times: FloatArray  # (n,): When each ray is read, in sweeps
    # points, normals: (n, 3): Where each ray first meets the scene, and the face's normal there; NaN where it meets
    # nothing
    points: FloatArray
    normals: FloatArray
    rays: FloatArray  # (n, 3): Unit vector from the sensor to the point
    # ranges, cosines: (n,): Length of the ray, and cosine of its incidence angle
    ranges: FloatArray
    cosines: FloatArray
    face_index: IntArray  # (n,): Face of the scene, the part's faces first; -1 for nothing
    is_lit: BoolArray  # (n,): Whether the projector, if there is one, sees the point too

    @property
    def origins(self) -> FloatArray:
        """Sensor of each ray, (n, 3)."""
        return self.sensors[self.view_index]


def cast_sweep(
    part: Mesh, scanner: Pattern, max_incidence_rad: float, *, motion: Motion | None, surroundings: Mesh | None
) -> SweepHits:
    """Cast all rays of a scanner."""
    centre, diagonal = centre_and_diagonal(part[0])
    sensors, times = scanner.sensor_positions(centre, diagonal), scanner.times()
    view_index = np.repeat(np.arange(len(sensors)), times[0].size)
    origins, flat_times = sensors[view_index], times.ravel()
    poses = None
    if motion is not None:
        poses = poses_at(motion.twist(centre, diagonal), flat_times - motion.reference)
    scene = joined(part, surroundings)
    hits = cast(scene, origins, scanner.ray_directions().reshape(-1, 3), poses)
    rays = unit(hits.points - origins)  # where a point was clipped to its face, the ray that goes there
    projectors = scanner.projector_positions(centre, diagonal)
    lit = np.ones(len(rays), dtype=bool)
    if projectors is not None:
        lit = is_lit(scene, hits, projectors[view_index], max_incidence_rad)
    return SweepHits(
        image=(times.shape[0], times.shape[1], times.shape[2]),
        diagonal=diagonal,
        sensors=sensors,
        view_index=view_index,
        times=flat_times,
        points=hits.points,
        normals=hits.normals,
        rays=rays,
        ranges=np.linalg.norm(hits.points - origins, axis=1),
        cosines=-np.einsum("ni,ni->n", rays, hits.normals),
        face_index=hits.face_index,
        is_lit=lit,
    )


def joined(part: Mesh, surroundings: Mesh | None) -> Mesh:
    """One mesh of two, the first one's faces first. Shapes: vertices (v + w, 3), faces (f + g, 3)."""
    if surroundings is None:
        return part
    vertices = np.concatenate([part[0], surroundings[0]])
    return vertices, np.concatenate([part[1], surroundings[1] + len(part[0])])
