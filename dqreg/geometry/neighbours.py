"""Nearest points of a cloud: a compiled tree for neighbourhoods, Open3D's KD-tree for correspondences."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg._open3d import load_open3d

# Neighbours of its own points that a tree remembers: what normals and rims of a cloud are read from.
KEPT_NEIGHBOURS = 24
# Points are asked about leaf by leaf where these are so many at least, and of those from the first to the last row one
# in so many.
MIN_DENSE_POINTS, ONE_IN = 256, 4


class NeighbourTree:
    """Compiled tree of points; built once, read-only afterwards."""

    def __init__(self, points: FloatArray, *, in_order: bool = False) -> None:
        from dqreg.kernels.point_tree import PointTree

        self.size = len(points)
        self._points, self._in_order = points, in_order
        self._found: IntArray = np.zeros((0, 0), dtype=np.int64)
        # Points in Morton order that few queries are asked of need no other order.
        self._tree = PointTree.of(points, in_order=in_order)

    def nearest(self, queries: FloatArray, count: int, within: float = np.inf) -> tuple[IntArray, FloatArray]:
        """Nearest points of each query, closest first; the size of the cloud where fewer are within a distance.

        Shapes: indices (m, k), distances (m, k).
        """
        return self._tree.nearest(queries, min(count, self.size), within)

    def nearest_to(self, rows: IntArray, count: int) -> tuple[IntArray, FloatArray]:
        """The same of some of the points, (m,) rows: in Morton order each begins at its own place."""
        from dqreg.kernels.point_tree import MAX_OWN_NEIGHBOURS

        count = min(count, self.size)
        if self._in_order or count > MAX_OWN_NEIGHBOURS or not _are_dense(rows):
            return self.nearest_beside(np.take(self._points, rows, axis=0), rows, count)
        found, distances = self._tree.nearest_of(rows, count)
        left = np.flatnonzero(found[:, 0] < 0)
        if len(left):
            found[left], distances[left] = self.nearest(np.take(self._points, rows[left], axis=0), count)
        return found, distances

    def nearest_beside(
        self, queries: FloatArray, rows: IntArray, count: int, within: float = np.inf
    ) -> tuple[IntArray, FloatArray]:
        """The same of queries near some of the points, (m,) rows; where fewer are within a distance, that distance."""
        places = {"at": rows} if self._in_order else {}
        return self._tree.nearest(queries, min(count, self.size), within, **places)

    def have_near(self, count: int, within: float) -> BoolArray:
        """Which points have so many within a distance, themselves among them, (n,)."""
        return self._tree.have_near(count, within)

    def around(self, rows: IntArray) -> tuple[NDArray[np.int32], FloatArray]:
        """Nearest points of points of the cloud itself, each found once.

        Shapes: rows (m,), indices (m, k), farthest (m,).
        """
        indices, farthest = self._around
        missing = rows[farthest[rows] < 0.0]
        if len(missing):
            missing = np.flatnonzero(np.bincount(missing, minlength=self.size))
            found, distances = self.nearest_to(missing, KEPT_NEIGHBOURS)
            # What is found depends on the cloud alone, so threads that meet here write the same; a row's neighbours are
            # there before their distance says so.
            indices[missing] = found
            farthest[missing] = distances[:, -1]
        return np.take(indices, rows, axis=0), farthest[rows]

    def remember(self, found: IntArray) -> None:
        """Keep the nearest points of all points of the cloud, (n, k), closest first, for `beside`."""
        self._found = found

    def beside(self, rows: IntArray, count: int) -> tuple[IntArray, NDArray[np.int32]]:
        """Lines of a table of nearest points, closest first, of some of the points: as many, or those that are known.

        Shapes: rows (m,), lines (m,), table (l, k), with another k than the count where all of these are in memory.
        """
        if "_around" in vars(self):
            indices, farthest = self._around
            if not (farthest[rows] < 0.0).any():
                return rows, indices
        if len(self._found):
            return rows, self._remembered
        return np.arange(len(rows)), self.nearest_to(rows, count)[0].astype(np.int32)

    @cached_property
    def _remembered(self) -> NDArray[np.int32]:
        return self._found.astype(np.int32)

    @cached_property
    def _around(self) -> tuple[NDArray[np.int32], FloatArray]:
        return np.zeros((self.size, min(KEPT_NEIGHBOURS, self.size)), dtype=np.int32), np.full(self.size, -1.0)


def _are_dense(rows: IntArray) -> bool:
    """Whether most of the points between some rows, (m,), are among these: they share leaves, in any order of space."""
    return len(rows) >= MIN_DENSE_POINTS and ONE_IN * len(rows) > int(rows.max()) - int(rows.min())


class KdTree:
    """Open3D's KD-tree of points, in float64: the correspondences between clouds.

    Always ``knn_search``: asking for one neighbour within a radius (``hybrid_search``) takes 25 times as long.
    """

    def __init__(self, points: FloatArray) -> None:
        open3d = load_open3d()
        self._size = len(points)
        self._centre = 0.5 * np.add(*bounds(points))
        self._search = open3d.core.nns.NearestNeighborSearch(open3d.core.Tensor(points - self._centre))
        self._search.knn_index()

    def nearest(self, queries: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
        """Nearest points of each query, closest first. Shapes: indices (m, k), distances (m, k)."""
        count = min(count, self._size)
        if not len(queries):
            return np.zeros((0, count), dtype=np.int64), np.zeros((0, count))
        tensor = load_open3d().core.Tensor(queries - self._centre)
        indices, squared = self._search.knn_search(tensor, count)
        return indices.numpy().astype(np.int64).reshape(-1, count), np.sqrt(squared.numpy()).reshape(-1, count)
