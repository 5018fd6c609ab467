"""Faces of a mesh as they are given: checked, and told apart by whether they have an area."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError

# Faces that one thread takes in one go.
CHUNK_FACES = 16_384


def checked_faces(value: Any, vertex_count: int) -> IntArray:
    """Three numbers of vertices a face, (f, 3)."""
    try:
        faces = np.asarray(value)
    except ValueError as error:
        raise InputError("faces must be integers of shape (f, 3); got rows of different lengths") from error
    if faces.size == 0:
        raise InputError("the mesh has no faces; a cloud of points goes in as an (n, 3) array or a PointCloud")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"faces must be integers of shape (f, 3); got {faces.dtype} of shape {faces.shape}")
    if faces.min() < 0 or faces.max() >= vertex_count:
        raise InputError(f"faces refer to vertices {faces.min()}..{faces.max()}, but there are {vertex_count}")
    return faces.astype(np.int64)


def checked_regions(value: Any, face_count: int) -> IntArray:
    """Number of the part's face that each triangle is of, (f,)."""
    regions = np.asarray(value)
    if regions.shape != (face_count,) or regions.dtype.kind not in "iu" or (regions < 0).any():
        raise InputError(f"regions must be one number from 0 for each of {face_count} faces; got shape {regions.shape}")
    return regions.astype(np.int64)


def solid_faces(vertices: FloatArray, faces: IntArray) -> tuple[BoolArray, FloatArray]:
    """Which faces have an area, (f,), and the lowest and highest corner of the box around all, (2, 3)."""
    from dqreg.kernels.meshes.mesh_faces import ENDS
    from dqreg.kernels.meshes.mesh_faces import solid_faces as write_solid
    from dqreg.kernels.threads import as_plain, over_chunks

    solid, ends = np.zeros(len(faces), dtype=bool), np.zeros(((len(faces) - 1) // CHUNK_FACES + 1, ENDS))
    # Below float64's own resolution of the face's coordinates, an "area" is rounding.
    given = as_plain(vertices), np.ascontiguousarray(faces), CHUNK_FACES, float(np.finfo(float).eps), solid, ends
    over_chunks(write_solid, len(faces), *given, chunk=CHUNK_FACES)
    if ends[:, 6].any():
        raise InputError("the mesh uses a vertex that is NaN or infinite; repair the mesh first")
    return solid, np.stack([ends[:, :3].min(axis=0), ends[:, 3:6].max(axis=0)])
