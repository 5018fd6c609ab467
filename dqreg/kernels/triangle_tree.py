"""A balanced tree of boxes over triangles: built once, read by any number of threads."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.closest_triangles import closest_places
from dqreg.kernels.compiled import compiled
from dqreg.kernels.copies import first_copies
from dqreg.kernels.kd_order import kd_order
from dqreg.kernels.threads import as_plain, aside, over_chunks
from dqreg.kernels.triangle import COLUMNS, pack

# Triangles a leaf: on nine CAD parts 2 took 0.7 to 0.95 of the time of 4.
LEAF = 2


@dataclasses.dataclass(frozen=True)
class TriangleTree:
    """Triangles in the order of a kd-tree of their centroids, and the boxes of the heap over them.

    About 160 bytes a triangle. Built in O(n log n).
    """

    boxes: FloatArray  # (2 L, 6): Box of each node, lowest and highest corner; node 0 is none
    packed: FloatArray  # (n, 12): See `COLUMNS`
    faces: IntArray  # (n,): Face of each slot of that order; of exact copies the first
    slots: IntArray  # (m,): Slot of each face
    normals: FloatArray  # (m, 3): Unit normal of each face
    size: float  # Diagonal of the box around all

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray) -> TriangleTree:
        """Tree of triangles. Shapes: corners (m, 3, 3)."""
        corners = as_plain(corners)
        # Copies in one place have boxes in one place: a query near a thousand of them would look at each.
        first = aside(first_copies, corners)
        kept = np.flatnonzero(first == np.arange(len(corners)))
        faces = kept[aside(kd_order, np.take(corners, kept, axis=0).mean(axis=1), LEAF)]
        packed, low, high = np.zeros((len(faces), COLUMNS)), np.zeros((len(faces), 3)), np.zeros((len(faces), 3))
        aside(pack, corners, faces, packed, low, high)
        slots = np.zeros(len(corners), dtype=np.int64)
        slots[faces] = np.arange(len(faces))
        boxes = heap_boxes(low, high, LEAF)
        size = float(np.linalg.norm(boxes[1, 3:] - boxes[1, :3]))
        return TriangleTree(boxes, packed, faces, slots[first], as_plain(normals), size)

    def closest(
        self, queries: FloatArray, guesses: IntArray | None = None, bound: float = np.inf
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Closest points, normals, distances and faces: NaN, inf and -1 where nothing is nearer than the bound.

        ``guesses``, (n,), are faces near the answers: they save time and change no bit.
        """
        count = len(queries)
        points, normals = np.zeros((count, 3)), np.zeros((count, 3))
        distances, found = np.zeros(count), np.zeros(count, dtype=np.int64)
        none = np.zeros(0, dtype=np.int64)
        tree = self.boxes, self.packed, LEAF, self.faces, self.slots, self.normals
        asked = as_plain(queries), none if guesses is None else guesses, float(bound), self.size
        over_chunks(closest_places, count, *tree, *asked, points, normals, distances, found)
        return points, normals, distances, found


@compiled
def heap_boxes(low: FloatArray, high: FloatArray, leaf: int) -> FloatArray:
    """Boxes of all nodes from those of the rows, (2 L, 6); an empty one is inside out. O(n)."""
    n, leaves = len(low), 1
    while leaves * leaf < n:
        leaves *= 2
    boxes = np.zeros((2 * leaves, 6))
    for j in range(2 * leaves - 1, 0, -1):
        for k in range(3):
            least, most = np.inf, -np.inf
            if j >= leaves:
                for i in range((j - leaves) * leaf, min((j - leaves + 1) * leaf, n)):
                    least, most = min(least, low[i, k]), max(most, high[i, k])
            else:
                least, most = (
                    min(boxes[2 * j, k], boxes[2 * j + 1, k]),
                    max(boxes[2 * j, 3 + k], boxes[2 * j + 1, 3 + k]),
                )
            boxes[j, k], boxes[j, 3 + k] = least, most
    return boxes
