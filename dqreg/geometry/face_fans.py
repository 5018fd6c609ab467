"""What is around those faces of a mesh that are asked for, as far as it is needed, and kept.

A registration asks for a few thousand faces, of a part of millions too.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.topology import SameNodes

# Faces that meet at less than this are facets of one smooth surface; a chamfer of 30 degrees is an edge.
SMOOTH_DEG = 25.0
# Corner normals that differ from their face's by less are equal to it but for rounding.
FLAT = 1e-12
# Faces that one thread takes in one go.
CHUNK = 1_024


class FaceFans:
    """Neighbours of faces, and smooth normals of their corners.

    What is found depends on the mesh alone, so that threads that meet here write the same.

    Attributes
    ----------
    neighbours : ndarray, (f, 3)
        Face across each side, see `Mesh.face_neighbours`; only of faces that were asked for.
    corner_normals : ndarray, (f, 3, 3)
        In each corner the mean of the normals of the faces that a chain of smooth sides at that corner joins, weighted
        by the corner's angle (Thuermer and Wuethrich 1998). Only of round faces.
    is_round : ndarray, (f,)
        Whether one of them differs from the face's own normal.
    """

    def __init__(self, faces: IntArray, same: SameNodes, corners: FloatArray, face_normals: FloatArray) -> None:
        self._given = faces, *same.corner_lists(faces), corners, face_normals
        count = len(faces)
        self._known = np.zeros(count, dtype=bool)
        # Memory that nobody writes to is not taken.
        self.neighbours = np.zeros((count, 3), dtype=np.int64)
        self.corner_normals, self.is_round = np.zeros((count, 3, 3)), np.zeros(count, dtype=bool)

    def find(self, faces: IntArray) -> FaceFans:
        """Itself, with what is around some faces, (n,); a negative number is none."""
        unknown = faces[~np.take(self._known, faces)]
        unknown = unknown[unknown >= 0]
        if len(unknown):
            self._find(np.unique(unknown))
        return self

    def _find(self, faces: IntArray) -> None:
        from dqreg.kernels.face_fans import fans_of_faces
        from dqreg.kernels.threads import over_chunks

        limits, known = (float(np.cos(np.deg2rad(SMOOTH_DEG))), FLAT), (self.neighbours, self.corner_normals)
        over_chunks(fans_of_faces, len(faces), faces, *self._given, *limits, *known, self.is_round, chunk=CHUNK)
        self._known[faces] = True
