"""Exact closest points on triangles: Open3D finds the triangle in float32, the point is finished in float64."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.raycasting import RayScene
from dqreg.geometry.surface import Closest, Hint


@dataclasses.dataclass(frozen=True)
class FaceSides:
    """Planes square to n faces through their sides, one face a query."""

    # (3, 3, n): Unit normals in the face's plane that point inside: side (first to second corner, ...), axis, face
    inward: FloatArray
    offsets: FloatArray  # (3, n): Their products with the sides' places

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray) -> FaceSides:
        """Sides of faces. Shapes: corners (n, 3, 3)."""
        # By columns, (corner, axis, face): three numbers a row are too few for NumPy to be quick about.
        a = np.ascontiguousarray(corners.transpose(1, 2, 0))
        u, v, w = np.ascontiguousarray(normals.T)
        x, y, z = (a[[1, 2, 0]] - a).transpose(1, 0, 2)
        inward = np.stack([v * z - w * y, w * x - u * z, u * y - v * x], axis=1)
        inward /= np.sqrt(np.einsum("kin,kin->kn", inward, inward))[:, None]
        return FaceSides(inward, np.einsum("kin,kin->kn", inward, a))

    def inset(self, points: FloatArray) -> FloatArray:
        """Distance of each point from the nearest side of its face, negative outside, (n,)."""
        columns = np.ascontiguousarray(points.T)
        insets: FloatArray = (np.einsum("kin,in->kn", self.inward, columns) - self.offsets).min(axis=0)
        return insets


# Barycentric distance to an edge below which a float32 answer cannot tell inside from outside.
EDGE_MARGIN = 1e-3
# A query that has moved by less than this fraction of the size keeps its face, if the foot on it is farther from the
# face's sides than so many heights above it and so many motions: no face that meets it at 40 degrees or more is nearer.
STEP, HEIGHTS, STEPS = 1e-4, 3.0, 4.0
# Faces walked from the one that float32 named; and the relative gain of a squared distance that is more than rounding.
WALK, CLOSER = 8, 2e-12


class MeshSurface:
    """A triangle mesh as a surface.

    Open3D's ray-casting scene, in float32, gives the number of the triangle; the point on that triangle is computed in
    float64.

    Parameters
    ----------
    mesh : Mesh
        The target part.

    Attributes
    ----------
    oriented : bool
        True: the normals of faces point outwards.

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

    @property
    def borders(self) -> MeshBoundary | None:
        """Where the surface ends; None for a closed mesh."""
        return self.mesh.borders

    @cached_property
    def _scene(self) -> RayScene:
        return RayScene(self.mesh.vertices, self.mesh.faces, self.centre, self.diagonal)

    @cached_property
    def _first_corners(self) -> FloatArray:
        return np.ascontiguousarray(self.mesh.corners[:, 0])

    def closest(self, points: FloatArray, hint: Hint | None = None) -> Closest:
        """Closest point on the triangles for each query.

        With a hint, a query high above the inside of its face keeps the face, where it has moved by less than a
        ten-thousandth of the part. Between two sides of a sheet, that may be the farther one by as much as the query
        has moved.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the mesh's frame; n may be 0.
        hint : (ndarray, Closest), optional
            Earlier places of the same queries and the answer there.

        Returns
        -------
        Closest
            Points, face normals, distances and face numbers.
        """
        if not len(points):
            return Closest(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64))
        known = None if hint is None else self._closest_near(points, *hint)
        if known is not None:
            return known
        faces, uv = self._scene.closest_faces((points - self.centre) / self.diagonal)
        normals = np.take(self.mesh.face_normals, faces, axis=0)
        first = np.take(self._first_corners, faces, axis=0)
        height = np.einsum("ij,ij->i", points - first, normals)
        on_face = points - height[:, None] * normals
        # Near an edge the foot of the perpendicular may lie outside the triangle, and in float32 the triangle itself
        # may be the wrong one of two: only those take the long way.
        u, v = np.ascontiguousarray(uv.T)
        near = np.stack([v < EDGE_MARGIN, u + v > 1.0 - EDGE_MARGIN, u < EDGE_MARGIN])
        edge = np.flatnonzero(near.any(axis=0))
        distances = np.abs(height)
        if len(edge):
            beside = np.take(points, edge, axis=0)
            places, walked = self._across_edges(beside, faces[edge], near[:, edge])
            on_face[edge], faces[edge], normals[edge] = places, walked, np.take(self.mesh.face_normals, walked, axis=0)
            distances[edge] = np.sqrt(_squared(beside - places))
        return Closest(on_face, normals, distances, faces)

    def _closest_near(self, points: FloatArray, places: FloatArray, before: Closest) -> Closest | None:
        """Answer from faces known nearby; None where a query has moved too far."""
        moved = np.sqrt(_squared(points - places))
        if moved.max() > STEP * self.diagonal:
            return None
        corners = np.take(self.mesh.corners, before.elements, axis=0)
        height = np.einsum("ij,ij->i", points - corners[:, 0], before.normals)
        # Square to the face, the query itself is as far from the planes through the sides as its foot.
        clear = FaceSides.of(corners, before.normals).inset(points)
        asked = np.flatnonzero(clear <= HEIGHTS * np.abs(height) + STEPS * moved)
        found = self.closest(np.take(points, asked, axis=0))
        feet, normals = points - height[:, None] * before.normals, before.normals.copy()
        distances, faces = np.abs(height), before.elements.copy()
        feet[asked], normals[asked] = found.points, found.normals
        distances[asked], faces[asked] = found.distances, found.elements
        return Closest(feet, normals, distances, faces)

    def closest_again(self, points: FloatArray, before: Closest, places: FloatArray) -> Closest:
        """`closest` with the hint ``(places, before)``.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries.
        before : Closest
            What this surface answered for the same queries at other places.
        places : ndarray, (n, 3)
            Those places.

        Returns
        -------
        Closest
            As from `closest`.
        """
        return self.closest(points, (places, before))

    def _across_edges(self, points: FloatArray, faces: IntArray, near: BoolArray) -> tuple[FloatArray, IntArray]:
        """Closest points in float64, walking to a neighbouring face for as long as it is strictly closer.

        ``near``, (3, n), says which sides of its face each query is near to; at first only what lies across is tried.
        """
        best = np.empty_like(points)
        faces = faces.copy()
        rows = np.arange(len(points))
        for _ in range(WALK):
            # A face and its neighbours at once; the face itself wins a draw.
            sides, of = np.nonzero(near)
            tried = np.r_[faces[rows], self.mesh.face_neighbours[faces[rows[of]], sides]]
            queries = np.take(points, np.r_[rows, rows[of]], axis=0)
            candidates = closest_on_triangles(queries, np.take(self.mesh.corners, tried, axis=0))
            squared = _squared(queries - candidates)
            apart, place = np.full((4, len(rows)), np.inf), np.zeros((4, len(rows)), dtype=np.int64)
            apart[0], place[0] = squared[: len(rows)], np.arange(len(rows))
            apart[1 + sides, of], place[1 + sides, of] = squared[len(rows) :], np.arange(len(rows), len(tried))
            closer = apart.min(axis=0) < apart[0] * (1.0 - CLOSER)
            kept = place[np.where(closer, apart.argmin(axis=0), 0), np.arange(len(rows))]
            best[rows], faces[rows] = candidates[kept], tried[kept]
            rows = rows[closer]
            if not len(rows):
                break
            near = np.ones((3, len(rows)), dtype=bool)
        return best, faces


def closest_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Closest point of one triangle for each query, in float64.

    The foot of the perpendicular where it lies inside; else the nearest of the closest points on the three sides.

    Shapes: corners (n, 3, 3).
    """
    # By columns, (corner, axis, query): three numbers a row are too few for NumPy to be quick about.
    a, p = np.ascontiguousarray(corners.transpose(1, 2, 0)), np.ascontiguousarray(points.T)
    sides = a[[1, 2, 0]] - a
    offsets = p - a
    along = np.einsum("kin,kin->kn", offsets, sides) / np.einsum("kin,kin->kn", sides, sides)
    on_sides = a + np.minimum(np.maximum(along, 0.0), 1.0)[:, None] * sides
    gaps = p - on_sides
    first, second, third = np.einsum("kin,kin->kn", gaps, gaps)
    closest = np.where(second < first, on_sides[1], on_sides[0])
    closest = np.where(third < np.minimum(first, second), on_sides[2], closest)
    normal = np.empty_like(p)
    _cross(sides[2], sides[0], normal)
    normal /= np.sqrt(np.einsum("in,in->n", normal, normal))
    # Inside when the query is on the inner side of all three planes through a side along the normal.
    inward = np.empty_like(sides)
    _cross(normal[:, None], sides.transpose(1, 0, 2), inward.transpose(1, 0, 2))
    inside = np.einsum("kin,kin->kn", inward, offsets).min(axis=0) >= 0.0
    foot = p - np.einsum("in,in->n", offsets[0], normal) * normal
    return np.ascontiguousarray(np.where(inside, foot, closest).T)


def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    # Of columns, (3, ...).
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]


def _squared(gaps: FloatArray) -> FloatArray:
    squared: FloatArray = np.einsum("ij,ij->i", gaps, gaps)
    return squared
