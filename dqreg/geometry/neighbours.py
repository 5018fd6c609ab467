"""Open3D's KD-tree over points, in float64: the one place that builds and asks it."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqreg.arrays import FloatArray, IntArray, bounds
from dqreg.open3d_gate import load_open3d

# Neighbours of its own points that a tree remembers: what normals and rims of a cloud are read from.
AROUND = 24


class NeighbourTree:
    """KD-tree of points; built once, read-only afterwards.

    Always ``knn_search``: asking for one neighbour within a radius (``hybrid_search``) takes 25 times as long.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Points, n >= 1; far-away coordinates are fine, the tree works about their middle.

    Examples
    --------
    >>> tree = NeighbourTree(np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]]))
    >>> indices, distances = tree.nearest(np.array([[1.5, 0.0, 0.0]]), 2)
    >>> indices.tolist(), distances.tolist()
    ([[1, 0]], [[0.5, 1.5]])
    """

    def __init__(self, points: FloatArray) -> None:
        open3d = load_open3d()
        self.size = len(points)
        self._points = points
        self._centre = 0.5 * np.add(*bounds(points))
        self._search = open3d.core.nns.NearestNeighborSearch(open3d.core.Tensor(points - self._centre))
        self._search.knn_index()

    def nearest(self, queries: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
        """Nearest points of each query, closest first.

        Parameters
        ----------
        queries : ndarray, (m, 3)
            Places to ask about; m may be 0.
        count : int
            Neighbours a query; fewer where the cloud has fewer points.

        Returns
        -------
        indices : ndarray of int, (m, k)
            Rows of the cloud, k = min(count, cloud size).
        distances : ndarray, (m, k)
            Their distances.
        """
        count = min(count, self.size)
        if not len(queries):
            return np.zeros((0, count), dtype=np.int64), np.zeros((0, count))
        tensor = load_open3d().core.Tensor(queries - self._centre)
        indices, squared = self._search.knn_search(tensor, count)
        return indices.numpy().astype(np.int64).reshape(-1, count), np.sqrt(squared.numpy()).reshape(-1, count)

    def around(self, rows: IntArray) -> tuple[NDArray[np.int32], FloatArray]:
        """Nearest points of points of the cloud itself, each looked up once.

        Parameters
        ----------
        rows : ndarray of int, (m,)
            Rows of the cloud.

        Returns
        -------
        indices : ndarray of int, (m, k)
            Rows of the cloud, closest first, k = min(24, cloud size); of a place that is there once, itself first.
        farthest : ndarray, (m,)
            Distance of the last of them.
        """
        indices, farthest = self._around
        missing = rows[farthest[rows] < 0.0]
        if len(missing):
            missing = np.flatnonzero(np.bincount(missing, minlength=self.size))
            found, distances = self.nearest(self._points[missing], AROUND)
            # What is found depends on the cloud alone, so threads that meet here write the same; a row's neighbours are
            # there before their distance says so.
            indices[missing] = found
            farthest[missing] = distances[:, -1]
        return np.take(indices, rows, axis=0), farthest[rows]

    @cached_property
    def _around(self) -> tuple[NDArray[np.int32], FloatArray]:
        return np.zeros((self.size, min(AROUND, self.size)), dtype=np.int32), np.full(self.size, -1.0)
