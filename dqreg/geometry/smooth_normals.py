"""Normals of the smooth surface that facets stand for: a turned shaft is round, whatever its file says."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.geometry.mesh import Mesh

# Faces that meet at less than this are facets of one smooth surface; a chamfer of 30 degrees is an edge.
SMOOTH_DEG = 25.0
# Corner normals that differ from their face's by less are equal to it but for rounding.
FLAT = 1e-12


class SmoothNormals:
    """Interpolated normals on a mesh, with its sharp edges left sharp.

    Faces that meet at a small angle form a group. In each corner the normals of the group's faces there are averaged,
    weighted by the corner's angle (Thuermer and Wuethrich 1998), and interpolated linearly across the face.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        groups = _groups(mesh)
        # One smooth corner is one vertex within one group.
        places = mesh.topology.corners[: len(mesh.faces)].ravel()
        _, corners = np.unique(places * len(groups) + np.repeat(groups, 3), return_inverse=True)
        weighted = np.repeat(mesh.face_normals, 3, axis=0) * _corner_angles(mesh).reshape(-1, 1)
        sums: FloatArray = np.column_stack([np.bincount(corners.ravel(), weighted[:, k]) for k in range(3)]).astype(
            float
        )
        self._corner_normals = _unit(sums[corners.ravel()]).reshape(-1, 3, 3)
        apart = np.abs(self._corner_normals - mesh.face_normals[:, None]).reshape(-1, 9).max(axis=1)
        self._round = apart > FLAT

    def at(self, places: FloatArray, faces: IntArray) -> FloatArray:
        """Normals at places on the mesh."""
        normals = np.take(self._mesh.face_normals, faces, axis=0)
        # Most of a machined part is flat, and there the face's own normal is the answer.
        rows = np.flatnonzero(self._round[faces])
        some = faces[rows]
        shares = _barycentric(np.take(places, rows, axis=0), np.take(self._mesh.corners, some, axis=0))
        normals[rows] = _unit(np.einsum("nk,nki->ni", shares, np.take(self._corner_normals, some, axis=0)))
        return normals


def _groups(mesh: Mesh) -> IntArray:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(mesh.faces)
    here, there = np.repeat(np.arange(count), 3), mesh.face_neighbours.ravel()
    cosines = np.einsum("ij,ij->i", mesh.face_normals[here], mesh.face_normals[there])
    smooth = cosines >= np.cos(np.deg2rad(SMOOTH_DEG))
    graph = coo_array((np.ones(np.count_nonzero(smooth)), (here[smooth], there[smooth])), shape=(count, count))
    groups: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return groups


def _corner_angles(mesh: Mesh) -> FloatArray:
    after = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    before = np.roll(mesh.corners, 1, axis=1) - mesh.corners
    sines = np.linalg.norm(np.cross(after, before), axis=2)
    angles: FloatArray = np.arctan2(sines, np.einsum("fki,fki->fk", after, before))
    return angles


def _barycentric(places: FloatArray, corners: FloatArray) -> FloatArray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = places - corners[:, 0]
    aa, ab, bb = (np.einsum("ni,ni->n", x, y) for x, y in ((a, a), (a, b), (b, b)))
    ao, bo = (np.einsum("ni,ni->n", x, offset) for x in (a, b))
    area = aa * bb - ab**2
    second, third = (bb * ao - ab * bo) / area, (aa * bo - ab * ao) / area
    # Rounding may leave the triangle by a hair.
    shares: FloatArray = np.clip(np.column_stack([1.0 - second - third, second, third]), 0.0, 1.0)
    return shares


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: FloatArray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit
