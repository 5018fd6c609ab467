"""How far inside a face a place is: its distance from the planes through the face's three sides."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray


@dataclasses.dataclass(frozen=True)
class FaceSides:
    """Planes square to n faces through their sides, one face a query."""

    # (3, 3, n): Unit normals in the face's plane that point inside: side (first to second corner, ...), axis, face
    inward: FloatArray
    offsets: FloatArray  # (3, n): Their products with the sides' places

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray) -> FaceSides:
        """Sides of faces.

        Shapes: corners (n, 3, 3).
        """
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
