"""The triangles of one file as plain arrays, checked, with touching triangles sharing their vertices."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.files.opening import unreadable
from dqreg.geometry.weld import merge_identical


@dataclasses.dataclass(frozen=True)
class MeshData:
    """What a file says about a surface of triangles.

    Attributes
    ----------
    vertices : ndarray, (v, 3)
        Finite positions in the file's frame and unit; each one different and used by a face.
    faces : ndarray, (f, 3) int64
        Vertex indices of each triangle, f >= 1, counter-clockwise from outside if the file keeps to that.
    units : str or None
        Length unit ("m", "mm", ...), if the format states one.
    """

    vertices: FloatArray
    faces: IntArray
    units: str | None = None


def make_mesh(path: Path, vertices: FloatArray, faces: IntArray, units: str | None = None) -> MeshData:
    """Mesh of a file, its identical vertices merged.

    Formats without an index (STL) repeat a vertex in each triangle; only merging tells which triangles meet. Vertices
    merge if they differ by rounding only, relative to the size of the part.
    """
    if not len(faces):
        raise unreadable(path, f"{len(vertices)} vertices and no faces", "a mesh of triangles; was the file cut short?")
    faces = np.asarray(faces, dtype=np.int64)
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        stray = low if low < 0 else high
        expected = f"indices from 0 to {len(vertices) - 1}" if len(vertices) else "vertices"
        raise unreadable(path, f"a face that names vertex {stray}", expected)
    used, faces = np.unique(faces, return_inverse=True)
    corners = np.asarray(vertices, dtype=np.float64)[used]
    bad = int(np.count_nonzero(~np.isfinite(corners).all(axis=1)))
    if bad:
        raise unreadable(path, f"{bad} vertices of faces that are NaN or infinite", "finite vertices")
    corners, merged = merge_identical(corners)
    return MeshData(vertices=corners, faces=merged[faces.reshape(-1, 3)], units=units)
