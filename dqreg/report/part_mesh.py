"""The part's mesh for drawing: fewer triangles, sharp edges, sides that triangles share."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg._open3d import load_open3d

# Edges of the part are drawn where it turns by that much; a rough mesh, where a quarter of all are, shows none.
EDGE_DEG, ROUGH = 25.0, 0.25
# Cells that corners are put together in, in sizes of the mesh; larger ones follow until there are few enough.
FIRST_CELL = 0.0025


def fewer_triangles(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """The mesh, simplified where it has too many triangles to be mailed."""
    if len(faces) <= most:
        used, numbers = np.unique(faces, return_inverse=True)
        return vertices[used], numbers.reshape(-1, 3)
    open3d = load_open3d()
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    # Corners are put together cell by cell where their planes meet, which keeps edges sharp; collapsing edges one by
    # one is finer, and takes a minute for a million triangles.
    planes = open3d.geometry.SimplificationContraction.Quadric
    cell = float(np.linalg.norm(np.ptp(vertices, axis=0))) * FIRST_CELL
    simple = mesh.simplify_vertex_clustering(cell, planes)
    while len(simple.triangles) > most:
        cell *= 1.3
        simple = mesh.simplify_vertex_clustering(cell, planes)
    return np.asarray(simple.vertices).copy(), np.asarray(simple.triangles).astype(np.int64)


def sharp_edges(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Both ends of each edge where the surface turns sharply or ends.

    Shapes: returns (k, 2, 3).
    """
    ends, owners = weld_edges(vertices, faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    starts = np.flatnonzero(np.r_[True, (ends[1:] != ends[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(ends)])
    twin = np.minimum(starts + 1, len(ends) - 1)
    turn = np.einsum("ij,ij->i", normals[owners[starts]], normals[owners[twin]])
    sharp = starts[(counts != 2) | (turn < np.cos(np.deg2rad(EDGE_DEG)))]
    if len(sharp) > ROUGH * len(starts) and len(starts) > 500:
        return np.zeros((0, 2, 3))
    places = np.unique(vertices, axis=0)
    edges: FloatArray = places[ends[sharp]]
    return edges


def weld_edges(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Sides of all triangles, sorted so that equal ones follow each other; equal corners count as one.

    Shapes: ends (3 f, 2), owners (3 f,).
    """
    _, welded = np.unique(vertices, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[faces]
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    return sides[order], owners[order]
