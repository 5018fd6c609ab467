"""Exact closest points on triangles: Open3D finds the triangle in float32, the point is finished in float64."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.surface import Closest
from dqreg.open3d_gate import load_open3d

# Barycentric distance to an edge below which a float32 answer cannot tell inside from outside.
EDGE_MARGIN = 1e-3
# Faces walked from the one that float32 named; and the relative gain that is more than rounding.
WALK, CLOSER = 8, 1e-12


class MeshSurface:
    """A triangle mesh as a surface.

    Open3D's ray-casting scene works in float32, so the mesh is centred and scaled to unit size for it; only the
    number of the triangle is taken from there. The point on that triangle is computed in float64.

    Parameters
    ----------
    mesh : Mesh
        The target part.

    Examples
    --------
    >>> mesh = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    >>> MeshSurface(mesh).closest(np.array([[0.5, 0.5, 3.0], [-1.0, -1.0, 0.0]])).points.tolist()
    [[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]
    """

    oriented = True

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.diagonal = mesh.diagonal
        self.centre = mesh.centre

    @cached_property
    def _scene(self) -> Any:
        open3d = load_open3d()
        scene = open3d.t.geometry.RaycastingScene()
        unit = (self.mesh.vertices - self.centre) / self.diagonal
        scene.add_triangles(
            open3d.core.Tensor(unit.astype(np.float32)), open3d.core.Tensor(self.mesh.faces.astype(np.uint32))
        )
        return scene

    @cached_property
    def _first_corners(self) -> FloatArray:
        return np.ascontiguousarray(self.mesh.corners[:, 0])

    def closest(self, points: FloatArray) -> Closest:
        """Closest point on the triangles for each query.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the mesh's frame; n may be 0.

        Returns
        -------
        Closest
            Points, face normals, distances and face numbers.
        """
        if not len(points):
            return Closest(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64))
        open3d = load_open3d()
        query = ((points - self.centre) / self.diagonal).astype(np.float32)
        found = self._scene.compute_closest_points(open3d.core.Tensor(query))
        faces: IntArray = found["primitive_ids"].numpy().astype(np.int64)
        uv = found["primitive_uvs"].numpy()
        normals = np.take(self.mesh.face_normals, faces, axis=0)
        first = np.take(self._first_corners, faces, axis=0)
        height = np.einsum("ij,ij->i", points - first, normals)
        on_face = points - height[:, None] * normals
        # Near an edge the foot of the perpendicular may lie outside the triangle, and in float32 the triangle itself
        # may be the wrong one of two: only those take the long way.
        edge = np.flatnonzero((uv.min(axis=1) < EDGE_MARGIN) | (uv.sum(axis=1) > 1.0 - EDGE_MARGIN))
        on_face[edge], faces[edge] = self._across_edges(points[edge], faces[edge])
        normals[edge] = self.mesh.face_normals[faces[edge]]
        gaps = points - on_face
        distances = np.sqrt(np.einsum("ij,ij->i", gaps, gaps))
        return Closest(on_face, normals, distances, faces)

    def _across_edges(self, points: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
        """Closest points in float64, walking to a neighbouring face for as long as it is strictly closer."""
        best = closest_on_triangles(points, self.mesh.corners[faces])
        gaps = np.linalg.norm(points - best, axis=1)
        faces = faces.copy()
        rows = np.arange(len(points))
        for _ in range(WALK):
            improved = np.zeros(len(rows), dtype=bool)
            for other in self.mesh.face_neighbours[faces[rows]].T:
                candidate = closest_on_triangles(points[rows], self.mesh.corners[other])
                gap = np.linalg.norm(points[rows] - candidate, axis=1)
                closer = gap < gaps[rows] * (1.0 - CLOSER)
                improved |= closer
                chosen = rows[closer]
                best[chosen], gaps[chosen], faces[chosen] = candidate[closer], gap[closer], other[closer]
            rows = rows[improved]
            if not len(rows):
                break
        return best, faces


def closest_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Closest point of one triangle for each query, in float64.

    The foot of the perpendicular where it lies inside; else the nearest of the closest points on the three sides.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Queries.
    corners : ndarray, (n, 3, 3)
        The triangle of each query, one corner a row.

    Returns
    -------
    ndarray, (n, 3)
        Closest points.

    Examples
    --------
    >>> triangle = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]])
    >>> closest_on_triangles(np.array([[3.0, 3.0, 1.0]]), triangle).tolist()
    [[1.0, 1.0, 0.0]]
    """
    sides = np.roll(corners, -1, axis=1) - corners
    offsets = points[:, None, :] - corners
    along = np.einsum("nki,nki->nk", offsets, sides) / np.einsum("nki,nki->nk", sides, sides)
    on_sides = corners + np.clip(along, 0.0, 1.0)[:, :, None] * sides
    gaps = np.linalg.norm(points[:, None, :] - on_sides, axis=2)
    nearest = gaps.argmin(axis=1)
    closest: FloatArray = on_sides[np.arange(len(points)), nearest]
    normal = np.cross(sides[:, 0], -sides[:, 2])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Inside when the query is on the inner side of all three planes through a side along the normal.
    inside = (np.einsum("nki,nki->nk", np.cross(normal[:, None, :], sides), offsets) >= 0.0).all(axis=1)
    height = np.einsum("ni,ni->n", offsets[:, 0], normal)
    foot = points - height[:, None] * normal
    closest[inside] = foot[inside]
    return closest
