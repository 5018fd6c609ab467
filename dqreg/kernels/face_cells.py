"""Cells around a surface that know the faces which can be the closest one to any place inside: a few, nearest first.

A cell is made when places in it were asked about twice: then a query reads a short list where a tree takes boxes by the
dozen. Cells are in bricks of 8 x 8 x 8, of which those away from the surface do not exist.
"""

from __future__ import annotations

import dataclasses
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.closest_places import BITS, BRICK, WIDER
from dqreg.kernels.closest_triangles import DEEPEST, box_distance, descend
from dqreg.kernels.compiled import compiled
from dqreg.kernels.threads import over_chunks
from dqreg.kernels.triangle import closest_on

# Edge of a cell in edges of a square as large as the usual face; bricks at most.
EDGE, BRICKS = 0.4, 1 << 16
# Faces of a cell at most, and edges from the surface to its middle beyond which it is left to the tree.
MOST, FAR = 64, 3.0
# Faces from which on cells are faster than the tree, and queries after which cells are made: a cell costs as much as
# three queries save, so that a part of one scan had better have none.
FACES, PATIENCE = 64, 250_000
# Faces beyond which there are none: on 80,000 even ones tracking took five times what the tree takes. Queries of
# one call beyond which nothing is made: they come in order of place, each place once.
MANY, LARGE = 10_000, 65_536
# Cells that are made at once, and one more for so many queries that those served: where faces are as small as the
# points stand apart, hardly a cell is asked twice.
ALLOWED, PAID = 4_000, 4
# Cells made in one go: what is in between stays small. Edges by which the box around all faces is widened.
TOGETHER, MARGIN = 4096, 2.0
# Bounds are wider than rounding, in sizes.
ROUNDING = 1e-12
# State of a cell that is left to the tree; 0 is one not made.
LEFT = -1


@dataclasses.dataclass(frozen=True)
class Made:
    """The cells made so far; arrays may be longer than what counts of them."""

    frame: FloatArray  # (5,): Lowest corner of the first cell, edge, and one over it
    shape: IntArray  # (4,): Bricks along each axis, and cells with a list
    top: NDArray[np.int32]  # (b,): Row of each brick; -1 for one that does not exist
    bricks: NDArray[np.int32]  # (m, 512): List of each cell plus one; 0 for one not made, or `LEFT`
    heads: IntArray  # (k + 1,): Where each list begins, and the next one
    slots: IntArray  # (c,): Faces of the lists, by their places in the tree
    floors: FloatArray  # (c,): How far from the middle of the cell each is at least, ascending in a list

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All of it, as kernels take it."""
        return self.frame, self.shape, self.top, self.bricks, self.heads, self.slots, self.floors


class FaceCells:
    """The cells of a tree of triangles: any number of threads may read while one makes more of them."""

    def __init__(self, boxes: FloatArray, packed: FloatArray, leaf: int, faces: IntArray, size: float) -> None:
        self._tree, self._size, self._lock = (boxes, packed, leaf, faces), size, threading.Lock()
        self._asked_once, self._waited, self._served = np.zeros(0, dtype=np.int64), 0, 0
        self._tried = 0
        across = np.cross(packed[:, 3:6], packed[:, 6:9])
        usual = float(np.sqrt(0.5 * np.sqrt((across**2).sum(axis=1)).sum() / max(len(packed), 1)))
        low, high = boxes[1, :3], boxes[1, 3:]
        edge = max(EDGE * usual, float(np.finfo(float).tiny))
        # The box of all faces decides how fine its cells can be.
        while True:
            counts = np.ceil((high - low + 2.0 * MARGIN * edge) / (edge * (1 << BITS)))
            if not counts.prod() > BRICKS:
                break
            edge *= 1.1 * max(float(counts.prod() / BRICKS) ** (1.0 / 3.0), 1.0)
        bricks = np.maximum(counts, 1.0).astype(np.int64) if np.isfinite(counts).all() else np.zeros(3, dtype=np.int64)
        frame = np.r_[low - MARGIN * edge, edge, 1.0 / edge]
        top, lists = np.full(1, -1, dtype=np.int32), (np.zeros(2, np.int64), np.zeros(1, np.int64), np.zeros(1))
        self.made = Made(frame, np.r_[bricks, 0], top, np.zeros((1, BRICK), np.int32), *lists)

    def is_worth(self, count: int) -> bool:
        """Whether, with so many more queries, so many were asked that making cells pays."""
        if not FACES <= len(self._tree[1]) <= MANY:
            return False
        if count > LARGE:
            return bool(self.made.shape[3])
        # Where threads meet some are not counted: then it begins a little later.
        self._waited += count
        return self._waited > PATIENCE

    def learn(self, wanted: IntArray) -> None:
        """Make the cells that were asked for twice: here, or here and before. Shapes: wanted (n,), -1 for none."""
        missed = wanted[wanted >= 0]
        self._served += len(wanted) - len(missed)
        left = ALLOWED + self._served // PAID - self._tried
        if len(wanted) > LARGE or left <= 0:
            return
        keys, counts = np.unique(missed, return_counts=True)
        with self._lock:
            twice = (counts > 1) | np.isin(keys, self._asked_once, assume_unique=True)
            self._asked_once = np.setdiff1d(np.union1d(self._asked_once, keys), keys[twice], assume_unique=True)
            keys = keys[twice][:left]
            self._tried += len(keys)
            for first in range(0, len(keys), TOGETHER):
                self._make(keys[first : first + TOGETHER])

    def _make(self, keys: IntArray) -> None:
        made = self.made
        counts = np.zeros(len(keys), dtype=np.int64)
        slots, floors = np.zeros((len(keys), MOST), dtype=np.int64), np.zeros((len(keys), MOST))
        asked = *self._tree, self._size, made.frame, made.shape, keys
        over_chunks(faces_of_cells, len(keys), *asked, counts, slots, floors, chunk=256)
        kept = counts > 0
        rows = np.flatnonzero(kept[:, None] & (np.arange(MOST) < counts[:, None]))
        used, held = int(made.shape[3]), int(made.heads[made.shape[3]])
        more = int(np.count_nonzero(kept))
        heads = _grown(made.heads, used + more + 1)
        heads[used + 1 : used + more + 1] = held + np.cumsum(counts[kept])
        lists = _grown(made.slots, held + len(rows)), _grown(made.floors, held + len(rows))
        lists[0][held : held + len(rows)] = slots.ravel()[rows]
        lists[1][held : held + len(rows)] = floors.ravel()[rows]
        # Readers that hold what there was before see lists beyond its end, and leave them to the tree.
        states = np.full(len(keys), LEFT, dtype=np.int32)
        states[kept] = used + 1 + np.arange(more)
        top, bricks = _with_bricks(made, keys // BRICK)
        bricks[top[keys // BRICK], keys % BRICK] = states
        shape = np.r_[made.shape[:3], used + more]
        self.made = Made(made.frame, shape, top, bricks, heads, *lists)


def _with_bricks(made: Made, numbers: IntArray) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Rows of all bricks, those with some numbers among them, and the bricks."""
    top = made.top
    if len(top) < made.shape[:3].prod():
        top = np.full(int(made.shape[:3].prod()), -1, dtype=np.int32)
    there = int(np.count_nonzero(top >= 0))
    new = np.unique(numbers[top[numbers] < 0])
    bricks = _grown(made.bricks, there + len(new))
    top = top.copy()
    top[new] = there + np.arange(len(new))
    return top, bricks


def _grown(values: NDArray[Any], length: int) -> NDArray[Any]:
    """The array with room for so many rows: itself where it has that."""
    if length <= len(values):
        return values
    grown = np.zeros((max(length, 2 * len(values)), *values.shape[1:]), dtype=values.dtype)
    grown[: len(values)] = values
    return grown


@compiled
def faces_of_cells(
    first: int,
    last: int,
    boxes: FloatArray,
    packed: FloatArray,
    leaf: int,
    faces: IntArray,
    size: float,
    frame: FloatArray,
    shape: IntArray,
    keys: IntArray,
    counts: IntArray,
    slots: IntArray,
    floors: FloatArray,
) -> None:
    """Write the faces that can be the closest to some place in cells first to last, nearest first; 0 to leave it.

    The face nearest to the middle is no farther from any place than from the farthest corner. O(log n) a cell.
    """
    stack, away, middle = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST), np.zeros(3)
    half, n, edge, slot = len(boxes) // 2, len(packed), frame[3], 0 * len(packed)
    radius, slack = np.sqrt(0.75) * edge, ROUNDING * size
    for i in range(first, last):
        rest, cell = keys[i] >> (3 * BITS), keys[i] & (BRICK - 1)
        for k in range(2, -1, -1):
            inside = (cell >> (BITS * (2 - k))) & ((1 << BITS) - 1)
            middle[k] = frame[k] + ((rest % shape[k]) * (1 << BITS) + inside + 0.5) * edge
            rest = rest // shape[k]
        x, y, z = middle[0], middle[1], middle[2]
        # Cells come in the order of their numbers, so that the face of the one before is near.
        bound = closest_on(packed, slot, x, y, z)[0] * WIDER + slack * slack
        square, slot, _, _ = descend(boxes, packed, leaf, faces, x, y, z, bound, 0.0, stack, away)
        if slot < 0:
            square, slot, _, _ = descend(boxes, packed, leaf, faces, x, y, z, np.inf, 0.0, stack, away)
        if square > FAR * FAR * edge * edge:
            continue
        farthest = 0.0
        for corner in range(8):
            dx, dy, dz = (corner >> 2) - 0.5, ((corner >> 1) & 1) - 0.5, (corner & 1) - 0.5
            found, _, _ = closest_on(packed, slot, x + dx * edge, y + dy * edge, z + dz * edge)
            farthest = max(farthest, found)
        reach = (np.sqrt(farthest) + radius) * (1.0 + ROUNDING) + slack
        reach = reach * reach
        count, waiting = 0, 0
        node = waiting + 1  # no literal, as in `descend`
        while True:
            if node >= half:
                for t in range((node - half) * leaf, min((node - half + 1) * leaf, n)):
                    found, _, _ = closest_on(packed, t, x, y, z)
                    if found > reach:
                        continue
                    if count < MOST:
                        floor, j = np.sqrt(found), count
                        while j > 0 and floors[i, j - 1] > floor:
                            floors[i, j], slots[i, j] = floors[i, j - 1], slots[i, j - 1]
                            j -= 1
                        floors[i, j], slots[i, j] = floor, t
                    count += 1
            elif box_distance(boxes, node, x, y, z) <= reach:
                stack[waiting] = 2 * node + 1
                waiting += 1
                node = 2 * node
                continue
            if waiting == 0 or count > MOST:
                break
            waiting -= 1
            node = stack[waiting]
        if count <= MOST:
            counts[i] = count
            for j in range(count):
                floors[i, j] = floors[i, j] * (1.0 - ROUNDING) - slack
