"""One sweep of a scanner over a scene, before anything goes wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.synth.casting import cast, is_lit
from dqreg.synth.motion import Motion, poses_at
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.pattern import Pattern
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.view_checks import unit


@dataclass(frozen=True, eq=False)
class Sweep:
    """What each ray of a sweep meets, in the sensors' frame at the time of the ray."""

    image: tuple[int, int, int]  # Views, rows and columns; their product is n
    centre: FloatArray  # (3,): Centre of the part at the reference time
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


def sweep(
    part: Mesh, scanner: Pattern, max_incidence_rad: float, *, motion: Motion | None, surroundings: Mesh | None
) -> Sweep:
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
    return Sweep(
        image=(times.shape[0], times.shape[1], times.shape[2]),
        centre=centre,
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
    """One mesh of two, the first one's faces first.

    Shapes: vertices (v + w, 3), faces (f + g, 3).
    """
    if surroundings is None:
        return part
    vertices = np.concatenate([part[0], surroundings[0]])
    return vertices, np.concatenate([part[1], surroundings[1] + len(part[0])])
