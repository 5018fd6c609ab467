"""Signed distances of points from a face of the part, from its exact shape where it has one."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.spread import normals_of
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.scanned_part import ScannedPart


def face_deviations(part: ScannedPart, face: Face, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signed distances of points from a face, and its outward normals there. Shapes: (n,), (n, 3).

    From the exact shape where the face has one: the facets of a hole lie up to a chord's height inside of it.
    """
    found = part.surface.closest(points)
    normals = part.mesh.face_normals[found.elements]
    if face.feature is None or face.kind == "plane":
        return np.einsum("ij,ij->i", points - found.points, normals), normals
    shape = face.feature.shape
    outward = normals_of(face.feature.kind, shape, points)
    # Of a hole the material lies outside: the normals of its faces point to the axis.
    side = 1.0 if float(np.einsum("ij,ij->", outward, normals)) >= 0.0 else -1.0
    return side * distances(face.feature.kind, shape, points)[0], side * outward
