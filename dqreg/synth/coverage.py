"""How much of a part a virtual scanner sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg.synth.raycast import centre_and_diagonal, check_mesh, face_normals, first_hits
from dqreg.synth.views import Scanner


def visible_share(
    vertices: ArrayLike,
    faces: ArrayLike,
    scanner: Scanner,
    *,
    max_incidence_rad: float = 0.5 * np.pi,
    samples: int = 20_000,
) -> float:
    """Share of a part's surface that at least one view sees.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Mesh vertices.
    faces : array_like, (f, 3)
        Vertex indices, outward normals by the right-hand rule.
    scanner : Scanner
        The views. Pixels and field of view do not matter here.
    max_incidence_rad : float
        Beyond this incidence angle a point does not count as seen.
    samples : int
        Number of random points on the surface; the share is good to about 0.5 / sqrt(samples).

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
    >>> round(visible_share(*box(), Scanner(views=((0, 0, 1),))), 2)
    0.17
    """
    V, F = check_mesh(vertices, faces)
    centre, diagonal = centre_and_diagonal(V)
    rng = np.random.default_rng(0)
    a, b, c = np.moveaxis(V[F], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    index = rng.choice(len(F), samples, p=area / area.sum())
    u, v = rng.random((2, samples, 1))
    u, v = (
        np.where(u + v > 1.0, 1.0 - u, u),
        np.where(u + v > 1.0, 1.0 - v, v),
    )  # fold the square onto the triangle
    points = a[index] + u * (b - a)[index] + v * (c - a)[index]
    normals = face_normals(V, F)[index]
    seen = np.zeros(samples, dtype=bool)
    for sensor in scanner.sensor_positions(centre, diagonal):
        rays = points - sensor
        _, hits = first_hits(V, F, np.broadcast_to(sensor, rays.shape), rays)
        cosine = -np.einsum("ni,ni->n", rays, normals) / np.linalg.norm(rays, axis=1)
        faces_sensor = (cosine > 0.0) & (cosine >= np.cos(max_incidence_rad))
        seen |= faces_sensor & (np.linalg.norm(hits - points, axis=1) < 1e-4 * diagonal)
    return float(seen.mean())
