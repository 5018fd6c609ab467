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

# Faces or points that one thread takes in one go.
CHUNK_ROWS = 16_384


def smooth_normals_of(mesh: Mesh, places: FloatArray, faces: IntArray, normals: FloatArray) -> FloatArray:
    """Normals of the smooth surface at places of faces whose own normals are given, which stay where none is round.

    Those of the corners of each face, see `FaceFans`, are interpolated linearly across it: sharp edges stay sharp.
    Shapes: places and normals (n, 3), faces (n,).
    """
    from dqreg.kernels.meshes.pseudo_normals import smooth_normals_at
    from dqreg.kernels.threads import as_plain, over_chunks

    fans = mesh._fans.find(faces)
    # Most of a machined part is flat, and there the face's own normal is the answer.
    if not np.take(fans.is_round, faces).any():
        return normals
    found = np.take(mesh.face_normals, faces, axis=0)
    asked = as_plain(places), as_whole(faces), fans.is_round, as_plain(mesh.corners), fans.corner_normals
    over_chunks(smooth_normals_at, len(faces), *asked, found, chunk=CHUNK_ROWS)
    return found


def _corner_angles(corners: FloatArray) -> FloatArray:
    """Angle at each corner of some faces, (f, 3), radians."""
    from dqreg.kernels.meshes.pseudo_normals import corner_angles
    from dqreg.kernels.threads import as_plain, over_chunks

    angles = np.zeros((len(corners), 3))
    over_chunks(corner_angles, len(corners), as_plain(corners), angles, chunk=CHUNK_ROWS)
    return angles


def _sums(rows: FloatArray, scales: FloatArray, places: IntArray) -> FloatArray:
    """Sums of rows, (n, 3), at the places that each serves, times a scale each. Shapes: scales, places (n k,)."""
    from dqreg.kernels.meshes.pseudo_normals import add_scaled_rows
    from dqreg.kernels.threads import as_plain

    sums = np.zeros((int(places.max()) + 1, 3))
    every = len(scales.ravel()) // len(rows)
    add_scaled_rows(as_plain(rows), every, as_plain(scales.ravel()), as_whole(places.ravel()), sums)
    return sums


def as_whole(values: IntArray) -> IntArray:
    """Numbers as kernels take them."""
    whole: IntArray = np.require(values, np.int64, ["C", "A", "W", "E"])
    return whole


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: FloatArray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit


# Barycentric coordinate above which a closest place is on its face, whatever the rounding.
ON_FACE = 1e-6
# Faces without area in a row through which a normal is handed on.
MAX_CHAIN_FACES = 8


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
        sums = _sums(shown.reshape(-1, 3), np.repeat(real.astype(float), 3), topology.edges)
        # Faces with an area first, then those without.
        corners = mesh.corners
        if len(mesh.flat):
            corners = np.concatenate([corners, np.take(mesh.vertices, mesh.flat, axis=0)])
        turned = _sums(own, _corner_angles(corners), topology.corners)
        return PseudoNormals(mesh, np.take(sums, topology.edges[:count], axis=0), turned)

    def signed(self, points: FloatArray, closest: Closest, outside: float = 1.0) -> FloatArray:
        """Distances of points from their closest places, negative inside; outside is -1 where faces look inwards.

        Distances and normals of the closest places are overwritten.
        """
        from dqreg.kernels.meshes.pseudo_normals import pseudo_normals_at
        from dqreg.kernels.threads import as_plain, over_chunks

        mesh, values, normals = self.mesh, as_plain(closest.distances), as_plain(closest.normals)
        asked = as_plain(points), as_plain(closest.points), as_whole(closest.elements), as_plain(mesh.corners)
        known = as_plain(self.sides), as_whole(mesh.topology.corners), as_plain(self.vertices)
        over_chunks(pseudo_normals_at, len(points), *asked, *known, ON_FACE, outside, normals, values, chunk=CHUNK_ROWS)
        return values


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
    for _ in range(MAX_CHAIN_FACES):
        met = shown.reshape(-1, 3)[mesh.topology.across[seams]]
        over = met[rows, longest]
        rest = met.sum(axis=1) - over
        length = np.linalg.norm(rest, axis=1, keepdims=True)
        shown[seams] = over[:, None, :]
        shown[seams, longest] = np.divide(rest, length, out=np.zeros_like(rest), where=length > 0.0)
        own[seams] = over
    return shown, own
