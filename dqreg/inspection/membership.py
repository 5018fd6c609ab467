"""Which points of a scan are of the part: not beyond reach, not of a surface that leaves it, no outliers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError

Flags = NDArray[np.int8]
# What a point belongs to. Files of deviations hold these numbers: never renumbered.
ON_PART: Final = 0
BEYOND: Final = 1
OTHER_SURFACE: Final = 2
OUTLIER: Final = 3
EXCLUDED: Final = 4

# A point is off the surface from that many sigmas of the scan's noise, or from one spacing, whichever is more ...
OFF, OFF_SPACINGS = 6.0, 1.0
# ... and lies beside another surface, not on the part, from that many sigmas on.
BESIDE = 3.0
# Cells in which points off the surface are neighbours, in spacings: a surface fills them, outliers do not.
CELL = 3.0
# Points around a point, itself included, that make it one of a surface; and points beyond reach that make the surface
# one that leaves the part.
SURFACE, LEAVES = 5, 10


@dataclasses.dataclass(frozen=True)
class Counts:
    """Points of a scan by what they belong to; the last five add up to the first.

    Attributes
    ----------
    total : int
        Points of the scan that were read.
    on_part : int
        Points that enter the figures.
    other_surfaces : int
        Within reach, but of a surface that leaves the part: a table, a clamp, material that the part does not have.
    outliers : int
        Within reach, but single points off every surface.
    beyond_reach : int
        Farther from the part than ``reach``.
    excluded : int
        In a box that was asked to be left out.
    """

    total: int
    on_part: int
    other_surfaces: int
    outliers: int
    beyond_reach: int
    excluded: int


def counts_of(flags: Flags) -> Counts:
    """Points of each kind.

    >>> counts_of(np.array([0, 0, 1, 3], dtype=np.int8)).on_part
    2
    """
    found = np.bincount(flags, minlength=5).tolist()
    return Counts(len(flags), found[ON_PART], found[OTHER_SURFACE], found[OUTLIER], found[BEYOND], found[EXCLUDED])


def by_reach(values: FloatArray, reach: float) -> Flags:
    """On the part or beyond reach, by the distance alone. Shapes: (n,)."""
    return np.where(np.abs(values) <= reach, ON_PART, BEYOND).astype(np.int8)


def membership(points: FloatArray, values: FloatArray, *, reach: float, noise: float, spacing: float) -> Flags:
    """What each point belongs to: (n,); linear in the points.

    Points off the part's surface are joined to patches through neighbouring cells. A patch that runs on beyond
    ``reach`` is another surface, whole; one that ends within it is a deviation of the part; too few points for a patch
    are outliers. Points are about the target's origin, where cells keep their digits.
    """
    flags = by_reach(values, reach)
    if not np.isfinite(reach) or spacing <= 0.0 or not len(values):
        return flags
    off = np.flatnonzero(np.abs(values) > max(OFF * noise, OFF_SPACINGS * spacing))
    if not len(off):
        return flags
    cells = _Cells(points[off], CELL * spacing)
    crowd = cells.around(cells.counts)
    surface = crowd >= SURFACE
    beyond = cells.sums(flags[off] == BEYOND)
    patch = cells.patches(surface)
    leaves = np.bincount(patch[surface], weights=beyond[surface], minlength=len(cells.counts)) >= LEAVES
    other = surface & leaves[patch]
    kind = np.where(other, OTHER_SURFACE, np.where(surface, ON_PART, OUTLIER))[cells.cell]
    within = flags[off] == ON_PART
    flags[off[within]] = kind[within]
    if other.any():
        # Where a table touches the part its last points lie nearer than "off".
        near = np.flatnonzero((flags == ON_PART) & (np.abs(values) > BESIDE * noise))
        near = near[cells.touches(points[near], other)]
        flags[near] = OTHER_SURFACE
    return flags


def in_boxes(points: FloatArray, boxes: Sequence[Sequence[float]]) -> BoolArray:
    """Points in any of the boxes, given by two opposite corners: x, y, z, x, y, z.

    >>> in_boxes(np.array([[0.5, 0.5, 0.5], [2.0, 0, 0]]), [(1, 1, 1, 0, 0, 0)]).tolist()
    [True, False]
    """
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        ends = np.asarray(box, dtype=np.float64)
        if ends.shape != (6,) or not np.isfinite(ends).all():
            raise InputError(f"a box to exclude is six coordinates, two opposite corners; got {box!r:.80}")
        low, high = np.minimum(ends[:3], ends[3:]), np.maximum(ends[:3], ends[3:])
        inside |= ((points >= low) & (points <= high)).all(axis=1)
    return inside


class _Cells:
    """Cells of a grid that hold points, and who lies beside whom among their 26 neighbours."""

    def __init__(self, points: FloatArray, width: float) -> None:
        self._low, self._width = points.min(axis=0) - width, width
        at = self._place(points)
        self._wide = at.max(axis=0) + 2
        self.keys, self.cell, self.counts = np.unique(self._key(at), return_inverse=True, return_counts=True)
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        self._shifts = steps @ np.array([self._wide[1] * self._wide[2], self._wide[2], 1])

    def _place(self, points: FloatArray) -> IntArray:
        found: IntArray = np.floor((points - self._low) / self._width).astype(np.int64)
        return found

    def _key(self, at: IntArray) -> IntArray:
        found: IntArray = (at[:, 0] * self._wide[1] + at[:, 1]) * self._wide[2] + at[:, 2]
        return found

    def _beside(self, keys: IntArray, shift: int) -> tuple[IntArray, BoolArray]:
        # Row of the cell beside each key, and whether it holds points.
        rows = np.minimum(np.searchsorted(self.keys, keys + shift), len(self.keys) - 1)
        return rows, self.keys[rows] == keys + shift

    def sums(self, points: BoolArray) -> IntArray:
        """Marked points in each cell."""
        found: IntArray = np.bincount(self.cell[points], minlength=len(self.keys))
        return found

    def around(self, counts: IntArray) -> IntArray:
        """Sum over each cell and its neighbours."""
        total = np.zeros(len(self.keys), dtype=np.int64)
        for shift in self._shifts:
            rows, there = self._beside(self.keys, int(shift))
            total += np.where(there, counts[rows], 0)
        return total

    def patches(self, chosen: BoolArray) -> IntArray:
        """Patch of each cell: chosen cells that hang together share one."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        links = []
        for shift in self._shifts[14:]:
            rows, there = self._beside(self.keys, int(shift))
            both = np.flatnonzero(there & chosen & chosen[rows])
            links.append(np.column_stack([both, rows[both]]))
        first, second = np.concatenate(links).T
        size = len(self.keys)
        graph = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(size, size))
        labels: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
        return labels

    def touches(self, points: FloatArray, marked: BoolArray) -> BoolArray:
        """Whether a point lies in a marked cell or beside one."""
        at = self._place(points)
        inside = ((at >= 0) & (at < self._wide - 1)).all(axis=1)
        keys = self._key(np.clip(at, 0, self._wide - 2))
        found = np.zeros(len(points), dtype=bool)
        for shift in self._shifts:
            rows, there = self._beside(keys, int(shift))
            found |= there & marked[rows]
        touching: BoolArray = found & inside
        return touching
