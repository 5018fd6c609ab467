"""Normals of the smooth surface that facets approximate: a turned shaft is round.

Angle-weighted pseudo-normals: on which side of a closed mesh a point lies, also beside edges and corners.

J. A. Baerentzen and H. Aanaes, "Signed distance computation using the angle weighted pseudonormal", IEEE Transactions
on Visualization and Computer Graphics 11 (2005). At a face its own normal decides, at an edge the sum of the normals
of its faces, at a vertex the sum weighted with the faces' angles there. The normal of any one face would be wrong
wherever the closest place is an edge or a corner of less than a right angle.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.surface import Closest

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
        weighted = np.repeat(mesh.face_normals, 3, axis=0) * _corner_angles(mesh.corners).reshape(-1, 1)
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
        shares = _clipped_barycentric(np.take(places, rows, axis=0), np.take(self._mesh.corners, some, axis=0))
        normals[rows] = _unit(np.einsum("nk,nki->ni", shares, np.take(self._corner_normals, some, axis=0)))
        return normals


def _groups(mesh: Mesh) -> IntArray:
    from dqreg.kernels.components import components

    count = len(mesh.faces)
    here, there = np.repeat(np.arange(count), 3), mesh.face_neighbours.ravel().astype(np.int64)
    cosines = np.einsum("ij,ij->i", mesh.face_normals[here], mesh.face_normals[there])
    smooth = cosines >= np.cos(np.deg2rad(SMOOTH_DEG))
    groups: IntArray = components(count, here[smooth], there[smooth])
    return groups


def _corner_angles(corners: FloatArray) -> FloatArray:
    """Angle at each corner of some faces, (f, 3), radians."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(ahead, back), axis=2)
    angles: FloatArray = np.arctan2(across, np.einsum("fki,fki->fk", ahead, back))
    return angles


def _clipped_barycentric(places: FloatArray, corners: FloatArray) -> FloatArray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = places - corners[:, 0]
    aa, ab, bb = (np.einsum("ni,ni->n", x, y) for x, y in ((a, a), (a, b), (b, b)))
    ao, bo = (np.einsum("ni,ni->n", x, offset) for x in (a, b))
    area = aa * bb - ab**2
    second, third = (bb * ao - ab * bo) / area, (aa * bo - ab * ao) / area
    # Rounding may leave the triangle.
    shares: FloatArray = np.clip(np.column_stack([1.0 - second - third, second, third]), 0.0, 1.0)
    return shares


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: FloatArray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit


# Barycentric coordinate above which a closest place is on its face, whatever the rounding.
ON_FACE = 1e-6
# Faces without area in a row through which a normal is handed on.
CHAIN = 8


@dataclasses.dataclass(frozen=True)
class PseudoNormals:
    """Normals of the faces, sides and vertices of a closed mesh; lengths other than one mean nothing."""

    mesh: Mesh  # The mesh
    sides: FloatArray  # (f, 3, 3): Sum of the unit normals of the faces that meet at each side of each face
    vertices: FloatArray  # (w, 3): Sum of the unit normals about each welded vertex, weighted with the angles, radians

    @staticmethod
    def of(mesh: Mesh) -> PseudoNormals:
        """Pseudo-normals of a mesh."""
        topology, count = mesh.topology, len(mesh.faces)
        shown, own = _shown(mesh)
        real = topology.real
        sums = np.zeros((int(topology.edges.max()) + 1, 3))
        np.add.at(sums, topology.edges[real].ravel(), shown[real].reshape(-1, 3))
        turned = np.zeros((int(topology.corners.max()) + 1, 3))
        # Faces with an area first, then those without.
        angles = _corner_angles(mesh.vertices[np.concatenate([mesh.faces, mesh.flat])])
        weighted = angles[:, :, None] * own[:, None, :]
        np.add.at(turned, topology.corners.ravel(), weighted.reshape(-1, 3))
        return PseudoNormals(mesh, sums[topology.edges[:count]], turned)

    def at(self, points: FloatArray, closest: Closest) -> FloatArray:
        """Pseudo-normal at the closest place of each point."""
        normals = closest.normals.copy()
        corners = self.mesh.corners[closest.elements]
        rim = np.flatnonzero(_barycentric(closest.points, corners, normals).min(axis=1) < ON_FACE)
        if len(rim):
            faces = closest.elements[rim]
            kind, which = _features(points[rim], corners[rim], normals[rim])
            side, corner = kind == 1, kind == 2
            normals[rim[side]] = self.sides[faces[side], which[side]]
            normals[rim[corner]] = self.vertices[self.mesh.topology.corners[faces[corner], which[corner]]]
        return normals


def _barycentric(places: FloatArray, corners: FloatArray, normals: FloatArray) -> FloatArray:
    """Barycentric coordinates, (n, 3); the third is what the other two leave."""
    ab, ac, ap = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], places - corners[:, 0]
    doubled_area = np.einsum("ni,ni->n", np.cross(ab, ac), normals)
    v = np.einsum("ni,ni->n", np.cross(ap, ac), normals) / doubled_area
    w = np.einsum("ni,ni->n", np.cross(ab, ap), normals) / doubled_area
    return np.stack([1.0 - v - w, v, w], axis=1)


def _features(points: FloatArray, corners: FloatArray, normals: FloatArray) -> tuple[IntArray, IntArray]:
    """What of its triangle is closest to each point: 0 the face, 1 a side, 2 a corner; and which of the three."""
    sides = np.roll(corners, -1, axis=1) - corners
    offsets = points[:, None, :] - corners
    inside = (np.einsum("nki,nki->nk", np.cross(normals[:, None, :], sides), offsets) >= 0.0).all(axis=1)
    along = np.einsum("nki,nki->nk", offsets, sides) / np.einsum("nki,nki->nk", sides, sides)
    clipped = np.clip(along, 0.0, 1.0)
    gaps = np.linalg.norm(offsets - clipped[:, :, None] * sides, axis=2)
    side = gaps.argmin(axis=1)
    share = clipped[np.arange(len(points)), side]
    at_end = (share == 0.0) | (share == 1.0)
    kind = np.where(inside, 0, np.where(at_end, 2, 1))
    return kind, np.where(share == 1.0, (side + 1) % 3, side)


def _shown(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Normal that each face shows through each of its sides, (f + k, 3, 3), and has at its corners, (f + k, 3).

    A face without area has no normal. It is a seam: through its longest side it shows what lies across the two
    others, and through those what lies across the longest, which is also what its corner between them touches.
    """
    count, flat = len(mesh.faces), len(mesh.flat)
    own = np.concatenate([mesh.face_normals, np.zeros((flat, 3))])
    shown = np.repeat(own[:, None, :], 3, axis=1)
    seams = count + np.flatnonzero(mesh.topology.real[count:])
    if not len(seams):
        return shown, own
    corners = mesh.vertices[mesh.flat[seams - count]]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
    rows = np.arange(len(seams))
    for _ in range(CHAIN):
        met = shown.reshape(-1, 3)[mesh.topology.across[seams]]
        over = met[rows, longest]
        rest = met.sum(axis=1) - over
        length = np.linalg.norm(rest, axis=1, keepdims=True)
        shown[seams] = over[:, None, :]
        shown[seams, longest] = np.divide(rest, length, out=np.zeros_like(rest), where=length > 0.0)
        own[seams] = over
    return shown, own
