"""A tree of boxes over triangles: built once, read by any number of threads."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.meshes.duplicate_triangles import MURMUR_FACTOR, first_duplicates
from dqreg.kernels.order.morton import Codes, morton_cells, sorted_rows
from dqreg.kernels.order.split_sort import CHUNK as SORTED
from dqreg.kernels.order.split_sort import split_sorted_rows
from dqreg.kernels.threads import as_plain, aside, over_chunks
from dqreg.kernels.trees.area_order import area_order
from dqreg.kernels.trees.closest_triangles import closest_places
from dqreg.kernels.trees.facing_triangles import facing_places
from dqreg.kernels.trees.pose_distances import pose_distances
from dqreg.kernels.trees.treelets import BLOCK, boxes_in_order, enclose_children, hang_trees, join_in_blocks
from dqreg.kernels.trees.triangle import COLUMNS, pack
from dqreg.kernels.trees.triangles_across import triangles_across

# Queries that one thread answers in one go, and triangles.
CHUNK_QUERIES, CHUNK_TRIANGLES = 500, 16_384
# Triangles of a small tree on average, of up to so many triangles and of more: the top is cut by areas, which takes
# longer and makes the better boxes. Queries took 0.9 to 1.05 of the time of cutting by areas down to the leaves.
TREELET_TRIANGLES, MAX_SMALL_TRIANGLES = (4, 8), 50_000
# Triangles up to which it is kept what lies across their sides, which takes a tenth of what the tree takes, and of so
# many memory: walks save a tenth to a third of a query from a face near by, and less where caches hold fewer of them.
MAX_WALKED_TRIANGLES = 50_000
# Bits of each coordinate's cell, and of a mark beside it: the two halves of most rectangles have one box.
CELL_BITS, MARK_BITS = 19, 6
# No guesses.
NO_GUESSES = np.zeros(0, dtype=np.int64)


@dataclasses.dataclass(frozen=True)
class TriangleTree:
    """Triangles in the order of a tree of boxes.

    About 260 bytes a triangle. Built in O(n) from the leaves up, see `treelets`, but for the top: small trees of eight
    triangles or so are put under one that is cut by areas, see `area_order`.
    """

    nodes: FloatArray  # (k, 6): Box of each node, lowest and highest corner; the first is of all
    links: IntArray  # (k, 3): Its first child and 0, or its first slot and the number of its slots; the node above it
    packed: FloatArray  # (n, 12): See `COLUMNS`
    across: IntArray  # (n, 3): Slot across each side, below zero where there is none; (0, 3) of many triangles
    faces: IntArray  # (n,): Face of each slot of that order; of exact copies the first
    slots: IntArray  # (m,): Slot of each face
    leaves: IntArray  # (n,): Node that holds each slot
    normals: FloatArray  # (m, 3): Unit normal of each face
    size: float  # Diagonal of the box around all

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray) -> TriangleTree:
        """Tree of triangles. Shapes: corners (m, 3, 3)."""
        corners = as_plain(corners)
        # Copies in one place have boxes in one place: a query near a thousand of them would look at each.
        rows, first = order_of_triangles(corners)
        count = len(rows)
        nodes, links = np.zeros((2 * count, 6)), np.zeros((2 * count, 3), dtype=np.int64)
        order, leaves = np.zeros((2, count), dtype=np.int64)
        used = _hang_all(corners, rows, nodes, links, order, leaves)
        for unused in (nodes, links):
            # In its place: it is returned to the system without a copy.
            unused.resize((used, *unused.shape[1:]), refcheck=False)
        faces, packed, slots = rows[order], np.zeros((count, COLUMNS)), np.zeros(len(corners), dtype=np.int64)
        over_chunks(pack, count, corners, faces, links, leaves, packed, slots, nodes, chunk=CHUNK_TRIANGLES)
        aside(enclose_children, links, nodes)
        size = float(np.linalg.norm(nodes[0, 3:] - nodes[0, :3]))
        slots = slots if first is None else slots[first]
        across = np.zeros((count if count <= MAX_WALKED_TRIANGLES else 0, 3), dtype=np.int64)
        if len(across):
            # Minus zero is the same place as zero.
            aside(triangles_across, (corners + 0.0).view(np.uint64), faces, across)
        return TriangleTree(nodes, links, packed, across, faces, slots, leaves, as_plain(normals), size)

    def closest(
        self, queries: FloatArray, guesses: IntArray | None = None, bound: float = np.inf
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Closest points, normals, distances and faces: NaN, inf and -1 where nothing is nearer than the bound.

        ``guesses``, (n,), are faces near the answers: they save time and change nothing but which of two faces answers
        that are equally near to rounding.
        """
        count = len(queries)
        points, normals = np.zeros((2, count, 3))
        distances, found = np.zeros(count), np.zeros(count, dtype=np.int64)
        tree = self.nodes, self.links, self.packed, self.across, self.faces, self.slots, self.leaves, self.normals
        asked = as_plain(queries), NO_GUESSES if guesses is None else guesses, float(bound), self.size
        results = points, normals, distances, found
        over_chunks(closest_places, count, *tree, *asked, *results, chunk=CHUNK_QUERIES)
        return points, normals, distances, found

    def closest_facing(
        self, queries: FloatArray, directions: FloatArray, cosine: float, bound: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Closest points on the faces that look to a direction each, distances and faces: inf and -1 where none is.

        A face looks there where its normal has more than the cosine with the direction.
        """
        count = len(queries)
        points, distances, found = np.zeros((count, 3)), np.full(count, np.inf), np.full(count, -1, dtype=np.int64)
        tree = self.nodes, self.links, self.packed, self.faces, self.normals
        asked = as_plain(queries), as_plain(directions), float(cosine), float(bound)
        results = points, distances, found
        over_chunks(facing_places, count, *tree, *asked, *results, chunk=CHUNK_QUERIES)
        return points, distances, found

    def distances(
        self, rotations: FloatArray, shifts: FloatArray, points: FloatArray, bound: float, *, by_point: bool = False
    ) -> FloatArray:
        """How far each of n poses puts m points from the triangles, (n, m), infinite from the bound on.

        By point, where each pose is near the one before it: asked in that order.
        """
        found = np.zeros((len(rotations), len(points)))
        tree = self.nodes, self.links, self.packed, self.across, self.faces, self.leaves, self.normals
        asked = *map(as_plain, (rotations, shifts, points)), float(bound), by_point
        over_chunks(pose_distances, found.size, *tree, *asked, found.reshape(-1), chunk=CHUNK_QUERIES)
        return found


def _hang_all(
    corners: FloatArray, rows: IntArray, nodes: FloatArray, links: IntArray, order: IntArray, leaves: IntArray
) -> int:
    """Write the links of a tree over triangles, and the slots' triangles and leaves; returns the number of nodes."""
    count = len(rows)
    boxes, pairs = np.zeros((6, count), dtype=np.float32), np.zeros((count, 2), dtype=np.int64)
    roots, tops = np.zeros((2, count), dtype=np.int64)
    over_chunks(boxes_in_order, count, corners, rows, boxes, chunk=CHUNK_TRIANGLES)
    share = TREELET_TRIANGLES[count > MAX_SMALL_TRIANGLES]
    over_chunks(join_in_blocks, count, share, boxes, pairs, roots, chunk=BLOCK)
    left = np.flatnonzero(roots >= 0)
    spans = np.ascontiguousarray(np.take(boxes, left, axis=1).T, dtype=np.float64)
    used = aside(area_order, spans, 1, tops[: len(left)], nodes, links)
    return int(aside(hang_trees, used, tops[: len(left)], roots[left], pairs, links, order, leaves))


def order_of_triangles(corners: FloatArray) -> tuple[IntArray, IntArray | None]:
    """Rows of different triangles by the middles of their boxes, and of each the first copy; None where none has any.

    Shapes: corners (m, 3, 3), rows (n,), first (m,). O(m).
    """
    count = len(corners)
    middles, (codes, marks) = np.zeros((count, 3)), np.zeros((2, count), dtype=np.uint64)
    over_chunks(middles_of, count, corners, middles, marks, chunk=SORTED)
    low, high = bounds(middles)
    extent = float((high - low).max())
    per_length, unmoved = (2**CELL_BITS - 1) / extent if extent else 0.0, np.array([1.0, 0.0, 0.0, 0.0])
    over_chunks(morton_cells, count, middles, unmoved, low, per_length, codes, chunk=SORTED)
    codes <<= np.uint64(MARK_BITS)
    codes |= marks
    rows, keys = split_sorted_rows(codes) if count > 2 * SORTED else sorted_rows(codes)
    # Copies are in one cell with one mark, and few other triangles are.
    alike = keys[1:] == keys[:-1]
    if not alike.any():
        return rows, None
    shared = np.zeros(count, dtype=bool)
    shared[rows[1:][alike]], shared[rows[:-1][alike]] = True, True
    some, first = np.flatnonzero(shared), np.arange(count)
    first[some] = some[first_duplicates(np.take(corners, some, axis=0))]
    return rows[(first == np.arange(count))[rows]], first


@compiled
def middles_of(first: int, last: int, corners: FloatArray, middles: FloatArray, marks: Codes) -> None:
    """Write twice the middles of the boxes of triangles first to last, (n, 3), and random marks of their shapes, (n,).

    Both are the same bits in whatever order the corners are.
    """
    inner = np.zeros(1)
    words = inner.view(np.uint64)
    for f in range(first, last):
        mark = np.uint64(0)
        for k in range(3):
            a, b, c = corners[f, 0, k], corners[f, 1, k], corners[f, 2, k]
            low, high = min(a, b), max(a, b)
            middles[f, k] = min(low, c) + max(high, c)
            # Minus zero is the same place as zero.
            inner[0] = max(low, min(high, c)) + 0.0
            mark = (mark ^ words[0]) * np.uint64(MURMUR_FACTOR)
        marks[f] = mark >> np.uint64(64 - MARK_BITS)
