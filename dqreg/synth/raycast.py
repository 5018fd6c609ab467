"""First hits of rays on a mesh: Open3D's ray caster finds the triangle, float64 finds the point on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_vectors
from dqreg.errors import InputError
from dqreg.geometry.raycasting import RayScene


def check_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return the checked arrays of a triangle mesh."""
    V, F = as_vectors(vertices, "vertices"), np.asarray(faces)
    if F.ndim != 2 or F.shape[1] != 3 or F.dtype.kind not in "iu":
        raise InputError(f"faces must be whole numbers of shape (f, 3); got {F.dtype} of shape {F.shape}")
    if not F.size or F.min() < 0 or F.max() >= len(V):
        raise InputError(f"faces must hold at least one row, and indices from 0 to {len(V) - 1}")
    if not np.ptp(V, axis=0).any():
        raise InputError("the mesh has no extent: all vertices are at one place")
    return V, F.astype(np.int64)


def centre_and_diagonal(vertices: FloatArray) -> tuple[FloatArray, float]:
    """Centre and diagonal of the bounding box, which stand for the place and the size of a part."""
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
