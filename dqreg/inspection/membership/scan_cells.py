"""Cells of a grid that hold points of a scan, who lies beside whom, and how flat the points around each are."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray

# Points around a cell leave their plane by less than this share of their extent where they are of a smooth surface,
# beside what noise does; and are no line, which lies in many planes.
MAX_FLAT_RATIO, MAX_LINE_RATIO = 0.2, 0.15
# Points that are looked at together.
CHUNK_POINTS = 1 << 13


class ScanCells:
    """Cells that hold points, and their 26 neighbours that do."""

    def __init__(self, points: FloatArray, width: float) -> None:
        self._low, self.width, self._points = points.min(axis=0) - width, width, points
        at = self._place(points)
        self._wide = at.max(axis=0) + 2
        self.keys, self.cell, self.counts = np.unique(self._key(at), return_inverse=True, return_counts=True)
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        self._shifts = steps @ np.array([self._wide[1] * self._wide[2], self._wide[2], 1])

    def _place(self, points: FloatArray) -> IntArray:
        found: IntArray = np.floor((points - self._low) / self.width).astype(np.int64)
        return found

    def _key(self, at: IntArray) -> IntArray:
        found: IntArray = (at[:, 0] * self._wide[1] + at[:, 1]) * self._wide[2] + at[:, 2]
        return found

    @cached_property
    def pairs(self) -> IntArray:
        """Cells that lie beside each other, each pair once, (m, 2)."""
        found = []
        for shift in self._shifts[14:]:
            rows, there = _looked_up(self.keys, self.keys + int(shift))
            here = np.flatnonzero(there)
            found.append(np.column_stack([here, rows[here]]))
        return np.concatenate(found)

    def sums(self, values: FloatArray | BoolArray) -> FloatArray:
        """Sum over the points of each cell. Shapes: (n,), returns (cells,)."""
        return np.bincount(self.cell, weights=values, minlength=len(self.keys)).astype(np.float64)

    def around(self, values: FloatArray) -> FloatArray:
        """Sum over each cell and its neighbours. Shapes: (cells, ...), returns the same."""
        total: FloatArray = values + self._beside @ values
        return total

    @cached_property
    def _beside(self) -> Any:
        from scipy.sparse import coo_array

        one, two = self.pairs.T
        rows, columns = np.concatenate([one, two]), np.concatenate([two, one])
        return coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(self.keys),) * 2).tocsr()

    @cached_property
    def planes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Planes in and around each cell: middle (k, 3), normal (k, 3), variances (k, 3), the smallest first."""
        # In cells about the middle one, where squares keep their digits.
        centre = self._points.mean(axis=0)
        places = (self._points - centre) / self.width
        columns = [np.ones(len(places)), *places.T]
        columns += [places[:, i] * places[:, j] for i in range(3) for j in range(i, 3)]
        found = self.around(np.column_stack([self.sums(column) for column in columns]))
        middles = found[:, 1:4] / found[:, :1]
        moments = found[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3) / found[:, :1, None]
        variances, axes = np.linalg.eigh(moments - middles[:, :, None] * middles[:, None, :])
        return centre + middles * self.width, axes[:, :, 0], np.maximum(variances, 0.0) * self.width**2

    def flat(self, noise: float) -> BoolArray:
        """Cells whose points are of a smooth surface, (k,)."""
        least, middle, most = self.planes[2].T
        smooth = np.maximum(least - noise**2, 0.0) < MAX_FLAT_RATIO**2 * middle
        found: BoolArray = smooth & (middle > MAX_LINE_RATIO**2 * most)
        return found

    def patches(self, linked: BoolArray) -> IntArray:
        """Patch of each cell: cells that hang together by those `pairs` share one."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        one, two = self.pairs[linked].T
        size = len(self.keys)
        graph = coo_array((np.ones(len(one), dtype=bool), (one, two)), shape=(size, size))
        labels: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
        return labels

    def beside(self, marked: BoolArray) -> BoolArray:
        """Cells that are marked or lie beside one that is, (k,)."""
        found: BoolArray = self.around(marked.astype(np.float64)) > 0.0
        return found

    def near(self, points: FloatArray, asked: BoolArray) -> BoolArray:
        """Cells in which, or beside which, some asked of other points lie, (k,). Shapes: points (n, 3), asked (n,)."""
        from dqreg.kernels.threads import over_chunks

        # A range at a time, which stays in a core's cache.
        held: list[IntArray] = []

        def hold(first: int, last: int) -> None:
            held.append(np.unique(self._keys_of(points[first:last][asked[first:last]])[0]))

        over_chunks(hold, len(points), chunk=CHUNK_POINTS)
        keys = np.unique(np.concatenate(held))
        found = np.zeros(len(self.keys), dtype=bool)
        for shift in self._shifts:
            found |= _looked_up(keys, self.keys + int(shift))[1]
        return found

    def beyond(self, asked: IntArray) -> tuple[IntArray, IntArray]:
        """Keys of each asked cell and of the 26 beside it, and the number of the asked one."""
        keys: IntArray = (self.keys[asked][:, None] + self._shifts).ravel()
        return keys, np.repeat(asked, len(self._shifts))

    def rows_in(self, points: FloatArray, asked: BoolArray, keys: IntArray) -> tuple[IntArray, IntArray]:
        """Rows of other points, of those asked, that lie in cells of some keys, sorted ones; and the key of each."""
        from dqreg.kernels.threads import over_chunks

        held: list[tuple[IntArray, IntArray]] = []

        def hold(first: int, last: int) -> None:
            rows = first + np.flatnonzero(asked[first:last])
            own, inside = self._keys_of(points[rows])
            there = _looked_up(keys, own)[1]
            held.append((rows[inside][there], own[there]))

        over_chunks(hold, len(points), chunk=CHUNK_POINTS)
        rows, own = (np.concatenate(each) for each in zip(*held, strict=True))
        order = np.argsort(rows)
        return rows[order], own[order]

    def touches(self, points: FloatArray, marked: BoolArray) -> BoolArray:
        """Whether other points lie in a marked cell or beside one, (n,)."""
        keys, inside = self._keys_of(points, kept=True)
        found = np.zeros(len(points), dtype=bool)
        for shift in self._shifts:
            rows, there = _looked_up(self.keys, keys + int(shift))
            found |= there & marked[rows]
        touching: BoolArray = found & inside
        return touching

    def _keys_of(self, points: FloatArray, *, kept: bool = False) -> tuple[IntArray, BoolArray]:
        # Points outside the grid touch none of its cells.
        at = self._place(points)
        inside = ((at >= 0) & (at < self._wide - 1)).all(axis=1)
        return self._key(np.clip(at, 0, self._wide - 2) if kept else at[inside]), inside


def _looked_up(keys: IntArray, asked: IntArray) -> tuple[IntArray, BoolArray]:
    """Row of each key asked for among sorted ones, and whether it is there."""
    if not len(keys):
        return np.zeros(len(asked), dtype=np.int64), np.zeros(len(asked), dtype=bool)
    rows = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
    return rows, keys[rows] == asked
