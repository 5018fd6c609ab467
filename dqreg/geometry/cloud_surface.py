"""A cloud as a surface: the nearest point, from Open3D's KD-tree in float64, with the normal fitted there."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dqreg.arrays import FloatArray, bounds
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.order import distinct_in_order
from dqreg.geometry.surface import Closest


class CloudSurface:
    """A cloud of points as a surface.

    Parameters
    ----------
    cloud : PointCloud
        The target; its normals are used where it has some, else they are fitted to 16 neighbours, sign unknown.
    fitted : ndarray, (m, 3), optional
        `normals` of an earlier surface of the same cloud, which saves fitting them again.

    Examples
    --------
    >>> surface = CloudSurface(PointCloud([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    >>> found = surface.closest(np.array([[0.9, 0.1, 2.0]]))
    >>> found.points.tolist(), np.abs(found.normals).tolist()
    ([[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    """

    def __init__(self, cloud: PointCloud, fitted: FloatArray | None = None) -> None:
        # Morton order keeps the answers to neighbouring queries close in memory; `elements` count in that order.
        self.order = distinct_in_order(cloud.points)
        self._points = cloud.points[self.order]
        self._known_normals = fitted if cloud.normals is None else cloud.normals[self.order]
        if self._known_normals is not None and self._known_normals.shape != self._points.shape:
            raise InputError(
                f"fitted normals must be one row per distinct point, {self._points.shape}; got "
                f"{self._known_normals.shape}. Take them from a surface of the same cloud"
            )
        self._tree = NeighbourTree(self._points)
        low, high = bounds(self._points)
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))
        self.oriented = cloud.normals is not None

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the distinct points in Morton order, (m, 3); zero where there is none."""
        if self._known_normals is not None:
            return self._known_normals
        # A point whose neighbours lie on a line has no normal: zero gives no direction and passes no angle test.
        return np.nan_to_num(fit_planes(self._tree, self._points, self._points).normals)

    def closest(self, points: FloatArray) -> Closest:
        """Nearest cloud point for each query.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the cloud's frame; n may be 0.

        Returns
        -------
        Closest
            Points, normals (zero where none is known), distances and rows of the cloud as it was given.
        """
        indices, distances = self._tree.nearest(points, 1)
        rows = indices[:, 0]
        return Closest(self._points[rows], self.normals[rows], distances[:, 0], self.order[rows])
