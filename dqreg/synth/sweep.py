"""One sweep of a scanner over a scene, before anything goes wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg.arrays import BoolArray, FloatArray, IntArray
from dqreg.synth.casting import cast, is_lit
from dqreg.synth.motion import Motion, poses_at
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.pattern import Pattern
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.view_checks import unit


@dataclass(frozen=True, eq=False)
class Sweep:
    """What each ray of a sweep meets, in the sensors' frame at the time of the ray.

    Attributes
    ----------
    image : (int, int, int)
        Views, rows and columns; their product is n.
    centre : ndarray, (3,)
        Centre of the part at the reference time.
    diagonal : float
        Diagonal of the part.
    sensors : ndarray, (k, 3)
        Sensor of each view.
    view_index : ndarray, (n,)
        View of each ray.
    times : ndarray, (n,)
        When each ray is read, in sweeps.
    points, normals : ndarray, (n, 3)
        Where each ray first meets the scene, and the face's normal there; NaN where it meets nothing.
    rays : ndarray, (n, 3)
        Unit vector from the sensor to the point.
    ranges, cosines : ndarray, (n,)
        Length of the ray, and cosine of its incidence angle.
    face_index : ndarray, (n,)
        Face of the scene, the part's faces first; -1 for nothing.
    is_lit : ndarray, (n,)
        Whether the projector, if there is one, sees the point too.
    """

    image: tuple[int, int, int]
    centre: FloatArray
    diagonal: float
    sensors: FloatArray
    view_index: IntArray
    times: FloatArray
    points: FloatArray
    normals: FloatArray
    rays: FloatArray
    ranges: FloatArray
    cosines: FloatArray
    face_index: IntArray
    is_lit: BoolArray

    @property
    def origins(self) -> FloatArray:
        """Sensor of each ray, (n, 3)."""
        return self.sensors[self.view_index]


def sweep(
    part: Mesh, scanner: Pattern, max_incidence_rad: float, *, motion: Motion | None, surroundings: Mesh | None
) -> Sweep:
    """Cast all rays of a scanner.

    Parameters
    ----------
    part : (vertices (v, 3), faces (f, 3))
        The part.
    scanner : Pattern
        The scanner.
    max_incidence_rad : float
        Beyond this angle a face gets no light from a projector.
    motion : Motion or None
        How the scene moves meanwhile.
    surroundings : (vertices, faces) or None
        What else there is.

    Returns
    -------
    Sweep
        One entry a ray.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> from dqreg.synth.views import Scanner
    >>> sweep(box(), Scanner(views=((0, 0, 1),), pixels=1), 1.5, motion=None, surroundings=None).points.tolist()
    [[0.0, 0.0, 0.5]]
    """
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

    Parameters
    ----------
    part : (vertices (v, 3), faces (f, 3))
        The first mesh.
    surroundings : (vertices (w, 3), faces (g, 3)), optional
        The second, or nothing.

    Returns
    -------
    vertices : ndarray, (v + w, 3)
        Float64.
    faces : ndarray, (f + g, 3)
        Int64.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> joined(box(), box())[1].shape
    (24, 3)
    """
    if surroundings is None:
        return part
    vertices = np.concatenate([part[0], surroundings[0]])
    return vertices, np.concatenate([part[1], surroundings[1] + len(part[0])])
