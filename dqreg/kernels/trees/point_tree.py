"""A balanced tree of boxes over points: built once, read by any number of threads."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.kernels.threads import as_plain, aside, even_chunk, over_chunks
from dqreg.kernels.trees.kd_order import heap_boxes, kd_order
from dqreg.kernels.trees.nearest_points import nearest_points
from dqreg.kernels.trees.neighbour_counts import rows_with_neighbours
from dqreg.kernels.trees.own_neighbours import own_neighbours

# Points a leaf: 4 to 16 are about as fast, and where boxes of a curve overlap more of them are.
LEAF_POINTS, CURVE_LEAF_POINTS = 8, 16
# Points from which on a tree is built on another thread, so that an interrupt is seen at once.
MIN_POINTS_ASIDE = 200_000
# Queries that one thread answers in one go, and leaves whose own points it does.
CHUNK_QUERIES, CHUNK_LEAVES = 256, 16
# Neighbours of these at most.
MAX_OWN_NEIGHBOURS = 32

# No places.
NO_PLACES = np.zeros(0, dtype=np.int64)


@dataclasses.dataclass(frozen=True)
class PointTree:
    """Points in the order of a kd-tree, and the boxes of the heap over them. About 50 bytes a point."""

    boxes: FloatArray  # (2 L, 6): Box of each node, lowest and highest corner; node 0 is none
    places: FloatArray  # (n, 3): Points in that order
    rows: IntArray  # (n,): Row of each place
    leaf: int = LEAF_POINTS  # Places a leaf

    @staticmethod
    def of(points: FloatArray, *, in_order: bool = False) -> PointTree:
        """Tree of points, (n, 3). O(n log n).

        Where they stand in Morton order it may be taken as it is: built in a tenth of the time, O(n), and asked in up
        to twice the time, for fewer queries than points.
        """
        points = as_plain(points)
        if in_order:
            return PointTree(
                heap_boxes(points, points, CURVE_LEAF_POINTS), points, np.arange(len(points)), CURVE_LEAF_POINTS
            )
        rows = aside(kd_order, points, LEAF_POINTS) if len(points) > MIN_POINTS_ASIDE else kd_order(points, LEAF_POINTS)
        places = np.take(points, rows, axis=0)
        return PointTree(heap_boxes(places, places, LEAF_POINTS), places, rows)

    def nearest(
        self, queries: FloatArray, count: int, within: float = np.inf, at: IntArray = NO_PLACES
    ) -> tuple[IntArray, FloatArray]:
        """Rows and distances of the nearest points, closest first; row n and that distance where none is within.

        Few queries are answered sooner where a place of the tree near each is known, (m,).

        Shapes: (m, k), k at most the number of points.
        """
        count = min(count, len(self.rows))
        found, distances = np.zeros((len(queries), count), dtype=np.int64), np.zeros((len(queries), count))
        tree = self.boxes, self.places, self.leaf, self.rows
        over_chunks(
            nearest_points,
            len(queries),
            *tree,
            as_plain(queries),
            float(within),
            found,
            distances,
            at,
            chunk=even_chunk(len(queries), CHUNK_QUERIES),
        )
        return found, distances

    def nearest_of(self, asked: IntArray, count: int) -> tuple[IntArray, FloatArray]:
        """The same of some points of the tree, (m,) rows, all different; row -1 where nothing is known of them.

        In half of the time, where most of those near each other are asked about; for few neighbours, k at most
        `MAX_OWN_NEIGHBOURS`.
        """
        lines = np.full(len(self.rows), -1, dtype=np.int64)
        lines[asked] = np.arange(len(asked))
        found, distances = np.full((len(asked), count), -1, dtype=np.int64), np.zeros((len(asked), count))
        tree = self.boxes, self.places, self.leaf, self.rows
        over_chunks(own_neighbours, len(self.boxes) // 2, *tree, lines, found, distances, chunk=CHUNK_LEAVES)
        return found, distances

    def have_near(self, count: int, within: float) -> BoolArray:
        """Which points have so many within a distance, themselves among them; all count where there are fewer, (n,)."""
        places = np.zeros(len(self.rows), dtype=bool)
        asked = self.boxes, self.places, self.leaf, min(count, len(self.rows)), float(within)
        over_chunks(rows_with_neighbours, len(places), *asked, places)
        found = np.zeros(len(places), dtype=bool)
        found[self.rows] = places
        return found
