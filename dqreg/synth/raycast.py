"""First hits of rays on a mesh: Open3D's ray caster finds the triangle, float64 finds the point on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import FloatArray, IntArray, as_vectors
from dqreg.errors import InputError
from dqreg.open3d_gate import load_open3d


def check_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return the checked arrays of a triangle mesh.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Finite coordinates.
    faces : array_like, (f, 3)
        Whole numbers that index the vertices.

    Returns
    -------
    vertices : ndarray, (v, 3)
        Float64.
    faces : ndarray, (f, 3)
        Int64.

    Raises
    ------
    InputError
        If a shape, an index or a number is wrong, or the mesh has no extent.

    Examples
    --------
    >>> check_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])[1].dtype
    dtype('int64')
    """
    V, F = as_vectors(vertices, "vertices"), np.asarray(faces)
    if F.ndim != 2 or F.shape[1] != 3 or F.dtype.kind not in "iu":
        raise InputError(f"faces must be whole numbers of shape (f, 3); got {F.dtype} of shape {F.shape}")
    if not F.size or F.min() < 0 or F.max() >= len(V):
        raise InputError(f"faces must hold at least one row, and indices from 0 to {len(V) - 1}")
    if not np.ptp(V, axis=0).any():
        raise InputError("the mesh has no extent: all vertices are at one place")
    return V, F.astype(np.int64)


def centre_and_diagonal(vertices: FloatArray) -> tuple[FloatArray, float]:
    """Centre and diagonal of the bounding box, which stand for the place and the size of a part.

    Parameters
    ----------
    vertices : ndarray, (v, 3)
        Mesh vertices.

    Returns
    -------
    centre : ndarray, (3,)
        Middle of the bounding box.
    diagonal : float
        Its length from corner to corner.

    Examples
    --------
    >>> centre_and_diagonal(np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 8.0]]))
    (array([3., 0., 4.]), 10.0)
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def first_hits(
    vertices: FloatArray, faces: IntArray, origins: FloatArray, directions: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Face that each ray meets first, and the point where it does.

    Parameters
    ----------
    vertices : ndarray, (v, 3)
        Mesh vertices.
    faces : ndarray, (f, 3)
        Vertex indices.
    origins, directions : ndarray, (n, 3)
        Where each ray starts, and where it goes (any length above zero), in the mesh's frame and unit.

    Returns
    -------
    face_index : ndarray, (n,)
        Int64 index of the face, -1 where the ray meets nothing.
    points : ndarray, (n, 3)
        Float64 point on that face, NaN where the ray meets nothing.

    Notes
    -----
    The ray caster works in float32 and loses digits with size and distance from the origin, so it gets the
    mesh centred and scaled to unit size and is asked for the face only. Ray and plane of the face are then
    intersected in float64. Near an edge that point can lie beside the face by the caster's own error, about
    1e-7 of the size; its barycentric coordinates are then clipped, so that every point lies on the mesh.

    Examples
    --------
    >>> triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> rays = np.array([[0.25, 0.25, 2.0]]), np.array([[0.0, 0.0, -1.0]])
    >>> index, points = first_hits(triangle, np.array([[0, 1, 2]]), *rays)
    >>> index.tolist(), points.tolist()
    ([0], [[0.25, 0.25, 0.0]])
    """
    face_index = _first_faces(vertices, faces, origins, directions)
    points = np.full(origins.shape, np.nan)
    hit = face_index >= 0
    points[hit] = _on_faces(vertices[faces[face_index[hit]]], origins[hit], directions[hit])
    return face_index, points


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Compute the unit normal of each face by the right-hand rule.

    Parameters
    ----------
    vertices : ndarray, (v, 3)
        Mesh vertices.
    faces : ndarray, (f, 3)
        Vertex indices.

    Returns
    -------
    ndarray, (f, 3)
        Unit normals; NaN for a face without area.

    Examples
    --------
    >>> face_normals(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), np.nan)


def _first_faces(vertices: FloatArray, faces: IntArray, origins: FloatArray, directions: FloatArray) -> IntArray:
    o3d = load_open3d()
    centre, size = centre_and_diagonal(vertices)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(((vertices - centre) / size).astype(np.float32)),
        o3d.core.Tensor(faces.astype(np.uint32)),
    )
    rays = np.concatenate([(origins - centre) / size, directions], axis=1).astype(np.float32)
    found = scene.cast_rays(o3d.core.Tensor(rays))["primitive_ids"].numpy()
    return np.where(found == scene.INVALID_ID, -1, found.astype(np.int64))


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
