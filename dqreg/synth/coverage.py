"""Fraction of a part's surface that a virtual scanner sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.synth.cameras import Pattern
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal, check_mesh, face_normals, first_hits, joined


def visible_share(
    vertices: ArrayLike,
    faces: ArrayLike,
    scanner: Pattern,
    *,
    max_incidence_rad: float = 0.5 * np.pi,
    samples: int = 20_000,
    surroundings: Mesh | None = None,
) -> float:
    """Fraction of a part's surface that at least one view sees.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Mesh vertices.
    faces : array_like, (f, 3)
        Vertex indices, outward normals by the right-hand rule.
    scanner : Scanner, StructuredLight or Lidar
        The views. Pixels and field of view do not matter here; where there is a projector, it must see a point too.
    max_incidence_rad : float
        Beyond this incidence angle a point does not count as seen.
    samples : int
        Number of random points on the surface; the fraction is good to about 0.5 / sqrt(samples).
    surroundings : (vertices (w, 3), faces (g, 3)), optional
        What else can hide the part.

    Returns
    -------
    float
        Between 0 and 1; always the same for the same arguments.

    Raises
    ------
    InputError
        If the mesh is malformed.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> from dqreg.synth.cameras import Scanner
    >>> round(visible_share(*box(), Scanner(views=((0, 0, 1),))), 2)
    0.17
    """
    V, F = check_mesh(vertices, faces)
    centre, diagonal = centre_and_diagonal(V)
    points, normals, _ = sample_surface(V, F, samples, np.random.default_rng(0))
    scene = joined((V, F), surroundings)
    sensors, projectors = (
        scanner.sensor_positions(centre, diagonal),
        scanner.projector_positions(centre, diagonal),
    )
    seen = np.zeros(samples, dtype=bool)
    for k, sensor in enumerate(sensors):
        sees = _sees(scene, sensor, points, normals, max_incidence_rad, diagonal)
        if projectors is not None:
            sees &= _sees(scene, projectors[k], points, normals, max_incidence_rad, diagonal)
        seen |= sees
    return float(seen.mean())


def sample_surface(
    vertices: FloatArray, faces: IntArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Random points on a mesh, uniform over its area. Shapes: points, normals (count, 3), face_index (count,)."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    index = rng.choice(len(faces), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    fold = u + v > 1.0  # the square onto the triangle
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    points = a[index] + u * (b - a)[index] + v * (c - a)[index]
    return points, face_normals(vertices, faces)[index], index.astype(np.int64)


def _sees(
    scene: Mesh, eye: FloatArray, points: FloatArray, normals: FloatArray, max_incidence_rad: float, diagonal: float
) -> BoolArray:
    rays = points - eye
    _, hits = first_hits(*scene, np.broadcast_to(eye, rays.shape), rays)
    cosine = -np.einsum("ni,ni->n", rays, normals) / np.linalg.norm(rays, axis=1)
    faces_eye = (cosine > 0.0) & (cosine >= np.cos(max_incidence_rad))
    sees: BoolArray = faces_eye & (np.linalg.norm(hits - points, axis=1) < 1e-4 * diagonal)
    return sees
