"""Nearest points of a cloud: a compiled tree for neighbourhoods, Open3D's KD-tree for correspondences.

And these followed from where the same queries stood before: few of them need a search.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg._open3d import load_open3d
from dqreg._records import remembered
from dqreg.geometry.surface import Closest
from dqreg.kernels.threads import Later

if TYPE_CHECKING:
    from dqreg.kernels.trees.point_tree import PointTree

Candidates = NDArray[np.int32]
# Of queries: nearest points, their distances, what no other point is nearer than, and candidates from now on.
Followed = tuple[IntArray, FloatArray, FloatArray, Candidates]
# Where queries stood before, the candidates there, and what no other point was nearer than.
Before = tuple[FloatArray, Candidates, FloatArray]
# What stands at the points of a cloud: these, normals and their variances, and numbers.
Columns = tuple[FloatArray, FloatArray, FloatArray, IntArray]

# Two distances that differ by less may be equal: then the tree decides.
DISTANCE_ROUNDING = 1e-12
# Queries that are followed in one go, and where the tree is asked as well.
CHUNK_QUERIES, CHUNK_ASKED = 16_384, 256
# Neighbours of its own points that a tree remembers: what normals and rims of a cloud are read from.
KEPT_NEIGHBOURS = 24
# Points are asked about leaf by leaf where these are so many at least, and of those from the first to the last row one
# in so many.
MIN_DENSE_POINTS, ONE_IN = 256, 4
# Points for each of the queries, from which on building a tree costs more than asking it.
FEW_QUERIES = 4


class NeighbourTree:
    """Compiled tree of points; read-only for whoever asks.

    Points in Morton order that few queries are asked of need no other order, in which a tree is built in a tenth of the
    time. Late ones are put in another order when many queries are asked of them at once, or `build` asks so.
    """

    def __init__(self, points: FloatArray, *, in_order: bool = False, late: bool = False) -> None:
        from dqreg.kernels.trees.point_tree import PointTree

        self.size = len(points)
        self._points, self._late = points, late
        self._found: IntArray = np.zeros((0, 0), dtype=np.int64)
        # With whether its places are the rows; written at once, as threads may meet where it is late.
        self._tree = PointTree.of(points, in_order=in_order or late), in_order or late
        self._building: Later[None] | None = None

    def begin(self) -> None:
        """`build` beside the caller."""
        self._building = Later(self.build)

    def build(self) -> None:
        """Put the points in the order that many queries are answered soonest in; threads that meet make the same."""
        from dqreg.kernels.trees.point_tree import PointTree

        if self._late:
            self._tree = PointTree.of(self._points), False
            self._late = False

    def is_of(self, points: FloatArray) -> bool:
        """Whether it is the tree of these very points."""
        return points is self._points

    def _for(self, queries: int) -> tuple[PointTree, bool]:
        if self._late and FEW_QUERIES * queries > self.size:
            if self._building is not None and self._building.is_begun:
                self._building.result()
            self.build()
        return self._tree

    def columns(self, queries: int) -> tuple[FloatArray, FloatArray, int, IntArray]:
        """Boxes, places in their order, places a leaf and the row of each place: what kernels ask, of so many."""
        tree, _ = self._for(queries)
        return tree.boxes, tree.places, tree.leaf, tree.rows

    def nearest(self, queries: FloatArray, count: int, within: float = np.inf) -> tuple[IntArray, FloatArray]:
        """Nearest points of each query, closest first; the size of the cloud where fewer are within a distance.

        Shapes: indices (m, k), distances (m, k).
        """
        return self._for(len(queries))[0].nearest(queries, min(count, self.size), within)

    def nearest_to(self, rows: IntArray, count: int) -> tuple[IntArray, FloatArray]:
        """The same of some of the points, (m,) rows: in Morton order each begins at its own place."""
        from dqreg.kernels.trees.point_tree import MAX_OWN_NEIGHBOURS

        count, (tree, in_order) = min(count, self.size), self._for(len(rows))
        if in_order or count > MAX_OWN_NEIGHBOURS or not _are_dense(rows):
            return self.nearest_beside(np.take(self._points, rows, axis=0), rows, count)
        found, distances = tree.nearest_of(rows, count)
        left = np.flatnonzero(found[:, 0] < 0)
        if len(left):
            found[left], distances[left] = self.nearest(np.take(self._points, rows[left], axis=0), count)
        return found, distances

    def nearest_beside(
        self, queries: FloatArray, rows: IntArray, count: int, within: float = np.inf
    ) -> tuple[IntArray, FloatArray]:
        """The same of queries near some of the points, (m,) rows; where fewer are within a distance, that distance."""
        tree, in_order = self._for(len(queries))
        # For rows at steps the kernel would be compiled once more.
        places = {"at": np.ascontiguousarray(rows)} if in_order else {}
        return tree.nearest(queries, min(count, self.size), within, **places)

    def have_near(self, count: int, within: float) -> BoolArray:
        """Which points have so many within a distance, themselves among them, (n,)."""
        return self._for(self.size)[0].have_near(count, within)

    def around(self, rows: IntArray) -> tuple[NDArray[np.int32], FloatArray]:
        """Nearest points of points of the cloud itself, each found once.

        Shapes: rows (m,), indices (m, k), farthest (m,).
        """
        indices, farthest = self._around
        missing = rows[farthest[rows] < 0.0]
        if len(missing):
            missing = distinct_rows(missing, self.size)
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
        if (around := remembered(self, "_around")) is not None:
            indices, farthest = around
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


def distinct_rows(rows: IntArray, size: int) -> IntArray:
    """Some of so many rows, (n,), each once, ascending."""
    is_ascending = bool((rows[1:] > rows[:-1]).all())
    return rows if is_ascending else np.flatnonzero(np.bincount(rows, minlength=size))


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


def followed(
    points: FloatArray, places: FloatArray, candidates: Candidates, others: FloatArray, cloud: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Nearest candidates of queries, how far they are, and what no other point is nearer than, (n,).

    Given where they were, (n, 3), the candidates that were nearest there, (n, k) rows of the cloud, (m, 3), and what no
    other was nearer than, (n,).
    """
    from dqreg.kernels.threads import as_plain, over_chunks
    from dqreg.kernels.trees.follow_rows import follow_rows

    count = len(points)
    rows, distances, bounds = np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros(count)
    given = as_plain(points), as_plain(places), candidates, as_plain(others), cloud
    over_chunks(follow_rows, count, *given, 1.0 - DISTANCE_ROUNDING, rows, distances, bounds, chunk=CHUNK_QUERIES)
    return rows, distances, bounds


def found_in_tree(
    tree: NeighbourTree, points: FloatArray, before: Before | None, kept: int, cloud: FloatArray, held: Columns | None
) -> Closest | Followed:
    """The nearest points themselves, of a tree that kernels ask where none of the candidates is known to be it.

    With so many candidates from now on where there are none yet, and what stands at the points, where it is given.
    """
    from dqreg.kernels.threads import as_plain, even_chunk, over_chunks
    from dqreg.kernels.trees.follow_rows import follow_in_tree

    count, looked_up = len(points), 0 if held is None else len(points)
    rows, distances, bounds = np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros(count)
    none = points, np.zeros((0, min(kept, tree.size)), dtype=np.int32), bounds
    places, candidates, others = none if before is None else before
    found, (feet, normals) = np.zeros((count, candidates.shape[1]), dtype=np.int32), np.zeros((2, looked_up, 3))
    variances, elements = np.zeros(looked_up), np.zeros(looked_up, dtype=np.int64)
    columns = (cloud, cloud, others, rows) if held is None else held
    given = as_plain(points), as_plain(places), candidates, as_plain(others), 1.0 - DISTANCE_ROUNDING
    asked = tree.columns(count if before is None else 0)
    results = rows, distances, bounds, found, feet, normals, variances, elements
    # Near the end of a loop the tree is asked about few.
    how: Any = {"chunk": even_chunk(count, CHUNK_ASKED), "may_be_quick": before is not None}
    over_chunks(follow_in_tree, count, *given, *asked, *columns, *results, **how)
    if held is None:
        return rows, distances, bounds, found
    return Closest(feet, normals, distances, elements, bounds, variances)._with(found)
