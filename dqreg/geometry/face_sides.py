"""How far inside a face a place is: its distance from the planes through the face's three sides."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray


@dataclasses.dataclass(frozen=True)
class FaceSides:
    """Planes square to n faces through their sides, one face a query.

    Attributes
    ----------
    inward : ndarray, (3, 3, n)
        Unit normals in the face's plane that point inside: side (first to second corner, ...), axis, face.
    offsets : ndarray, (3, n)
        Their products with the sides' places.
    """

    inward: FloatArray
    offsets: FloatArray

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray) -> FaceSides:
        """Sides of faces.

        Parameters
        ----------
        corners : ndarray, (n, 3, 3)
            One corner a row.
        normals : ndarray, (n, 3)
            Unit normals by the right-hand rule over the corners.

        Returns
        -------
        FaceSides
            In the frame of the corners.
        """
        # By columns, (corner, axis, face): three numbers a row are too few for NumPy to be quick about.
        a = np.ascontiguousarray(corners.transpose(1, 2, 0))
        u, v, w = np.ascontiguousarray(normals.T)
        x, y, z = (a[[1, 2, 0]] - a).transpose(1, 0, 2)
        inward = np.stack([v * z - w * y, w * x - u * z, u * y - v * x], axis=1)
        inward /= np.sqrt(np.einsum("kin,kin->kn", inward, inward))[:, None]
        return FaceSides(inward, np.einsum("kin,kin->kn", inward, a))

    def inset(self, points: FloatArray) -> FloatArray:
        """Distance of each point from the nearest side of its face, negative outside, (n,).

        Parameters
        ----------
        points : ndarray, (n, 3)
            One for each face.

        Returns
        -------
        ndarray, (n,)
            Lengths in the plane of the face: the height above it does not count.

        Examples
        --------
        >>> triangle = np.array([[[0.0, 0, 0], [3, 0, 0], [0, 3, 0]]])
        >>> FaceSides.of(triangle, np.array([[0.0, 0, 1]])).inset(np.array([[1.0, 0.25, 9.0]])).tolist()
        [0.25]
        """
        columns = np.ascontiguousarray(points.T)
        insets: FloatArray = (np.einsum("kin,in->kn", self.inward, columns) - self.offsets).min(axis=0)
        return insets
