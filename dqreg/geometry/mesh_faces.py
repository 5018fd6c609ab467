"""The faces of a part: its mesh cut where it turns sharply or a large plane ends."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.mesh import Mesh

# Neighbouring triangles that turn by more than this are two faces of the part.
SHARP_DEG = 22.0
# Triangles within this of a plane that make up that share of the part's area are a flat face.
LEVEL_DEG, FLAT_AREA = 0.5, 0.02


def faces_of(mesh: Mesh) -> tuple[int, IntArray]:
    """Faces of a part: as its file tells them, else triangles connected without a sharp turn. Shapes: labels (f,)."""
    if mesh.regions is not None:
        # Numbers without gaps: a face of the file may have lost all its triangles.
        numbers, labels = np.unique(mesh.regions, return_inverse=True)
        return len(numbers), labels.astype(np.int64)
    ends, owners = weld_edges(mesh.vertices, mesh.faces)
    # Two triangles at an edge are neighbours; at an edge with one, three or more, the surface ends or branches.
    starts = np.flatnonzero(np.r_[True, (ends[1:] != ends[:-1]).any(axis=1)])
    pairs = starts[np.diff(np.r_[starts, len(ends)]) == 2]
    links = np.column_stack([owners[pairs], owners[pairs + 1]])
    turn = np.einsum("ij,ij->i", mesh.face_normals[links[:, 0]], mesh.face_normals[links[:, 1]])
    _, planes = _connected(links[turn > np.cos(np.deg2rad(LEVEL_DEG))], len(mesh.faces))
    areas = triangle_areas(mesh)
    flat = (np.bincount(planes, weights=areas) > FLAT_AREA * areas.sum())[planes]
    # A fillet runs smoothly into the planes beside it: large planes are faces of their own, whatever they run into.
    apart = flat[links[:, 0]] | flat[links[:, 1]]
    same = planes[links[:, 0]] == planes[links[:, 1]]
    smooth = turn > np.cos(np.deg2rad(SHARP_DEG))
    return _connected(links[np.where(apart, same, smooth)], len(mesh.faces))


def weld_edges(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Sides of all triangles, sorted so that equal ones follow each other; equal corners count as one.

    Shapes: ends (3 f, 2), owners (3 f,).
    """
    # Ranks of different vertices, column by column: a third of the time of sorting whole rows.
    order = np.lexsort(vertices.T[::-1])
    ranked = vertices[order]
    welded = np.zeros(len(vertices), dtype=np.int64)
    welded[order] = np.cumsum(np.r_[False, (ranked[1:] != ranked[:-1]).any(axis=1)])
    corners = welded[faces]
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(sides[:, 0] * len(vertices) + sides[:, 1], kind="stable")
    return sides[order], owners[order]


def areas_of(mesh: Mesh, of_face: IntArray) -> FloatArray:
    """Area of each face of a part. Shapes: of_face (f,)."""
    areas: FloatArray = np.bincount(of_face, weights=triangle_areas(mesh)).astype(np.float64)
    return areas


def triangle_areas(mesh: Mesh) -> FloatArray:
    """Area of each triangle. Shapes: returns (f,)."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _connected(links: IntArray, count: int) -> tuple[int, IntArray]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links), dtype=bool), (links[:, 0], links[:, 1])), shape=(count, count))
    number, labels = connected_components(graph, directed=False)
    return int(number), labels.astype(np.int64)
