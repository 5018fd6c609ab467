"""Points on the surface of a mesh, for a mesh that is the source."""

from __future__ import annotations

import numbers

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh


def sample_mesh(mesh: Mesh, count: int, rng: np.random.Generator) -> PointCloud:
    """Points spread over the faces in proportion to their areas, with the faces' normals.

    Parameters
    ----------
    mesh : Mesh
        Where to sample.
    count : int
        How many points.
    rng : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    PointCloud
        Oriented points in the frame of the mesh.

    Raises
    ------
    InputError
        If the count is not a whole number above 0.

    Examples
    --------
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> cloud = sample_mesh(triangle, 100, np.random.default_rng(0))
    >>> len(cloud), bool((cloud.points.sum(axis=1) <= 1.0).all())
    (100, True)
    """
    given: object = count
    if not isinstance(given, numbers.Integral) or int(given) < 1:
        raise InputError(f"count must be a whole number of points above 0; got {count!r:.80}")
    points, faces = places_on(mesh, int(count), rng)
    return PointCloud(points, mesh.face_normals[faces], units=mesh.units)


def places_on(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """The same points, (n, 3), and the face of each, without a cloud of them, which takes as long again."""
    # What `Generator.choice` draws with these shares, without adding them up each time.
    faces = mesh._shares_before.searchsorted(rng.random(count), side="right")
    # The square root makes the distance from the first corner uniform in area (Turk 1990).
    across, along = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    corners = np.take(mesh.corners, faces, axis=0)
    a, b, c = (corners[:, k] for k in range(3))
    return (1.0 - across) * a + across * (1.0 - along) * b + across * along * c, faces
