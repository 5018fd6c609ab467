"""What the rays of a scanner meet: a part in its surroundings, at rest or in motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.rigid import pose
from dqreg.synth.motion import moved_each, turned_each
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import face_normals, first_hits

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
    """Meet the scene with rays.

    Shapes: poses (n, 4, 4).
    """
    if poses is None:
        face_index, points = first_hits(*scene, origins, rays)
        return Hits(face_index, points, face_normals(*scene)[face_index], None)
    back = pose.inverse(poses)
    face_index, points = first_hits(*scene, moved_each(back, origins), turned_each(back, rays))
    normals = turned_each(poses, face_normals(*scene)[face_index])
    return Hits(face_index, moved_each(poses, points), normals, poses)


def is_lit(scene: Mesh, hits: Hits, projectors: FloatArray, max_incidence_rad: float) -> BoolArray:
    """Whether each point is seen from a second place as well.

    >>> from dqreg.synth.parts import box
    >>> hits = cast(box(), np.array([[0.0, 0, 9]]), np.array([[0.0, 0, -1]]), None)
    >>> [bool(is_lit(box(), hits, np.array([[3.0, 0, z]]), 1.5)[0]) for z in (9.0, -9.0)]
    [True, False]
    """
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
