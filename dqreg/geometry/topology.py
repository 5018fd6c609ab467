"""Which triangles meet: sides and their neighbours, open seams, winding, connected bodies."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.files.mesh_data import merge_identical
from dqreg.geometry.morton import sorted_rows


def ranked(codes: IntArray) -> IntArray:
    """Stable order of numbers from 0 on."""
    return sorted_rows(codes.astype(np.uint64))


def numbered(codes: IntArray) -> IntArray:
    """Place of each of some numbers from 0 on among the different ones, ascending, (n,).

    >>> numbered(np.array([7, 3, 7, 90])).tolist()
    [1, 0, 1, 2]
    """
    order = ranked(codes)
    walked = codes[order]
    numbers = np.zeros(len(codes), dtype=np.int64)
    numbers[order[1:]] = np.cumsum(walked[1:] != walked[:-1])
    return numbers


@dataclasses.dataclass(frozen=True)
class Topology:
    """Faces over welded vertices.

    A side is numbered ``3 * face + k`` and runs from corner k to corner k + 1 of its face.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> both = Topology.of(square, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> both.open_sides, both.uneven_sides, (both.across // 3).tolist()
    (4, 0, [[0, 0, 1], [0, 1, 1]])
    """

    corners: IntArray  # (f, 3): Welded vertex of each corner; the faces with an area first, then those without
    edges: IntArray  # (f, 3): Edge of each side, whichever way the side runs
    forward: BoolArray  # (f, 3): Whether the side runs from the lower to the higher vertex
    real: BoolArray  # (f,): False for a face two of whose corners are one vertex: it joins nothing

    @staticmethod
    def of(vertices: FloatArray, faces: IntArray, flat: IntArray | None = None) -> Topology:
        """Topology of some triangles."""
        every = faces if flat is None else np.concatenate([faces, flat])
        is_used = np.zeros(len(vertices), dtype=bool)
        is_used[every] = True
        _, welded = merge_identical(vertices[is_used])
        corners = welded[(np.cumsum(is_used) - 1)[every]]
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
        low, high = ends.min(axis=2), ends.max(axis=2)
        edges = numbered((low * (int(welded.max()) + 1) + high).ravel())
        return Topology(corners, edges.reshape(-1, 3), ends[..., 0] == low, (low != high).all(axis=1))

    @cached_property
    def across(self) -> IntArray:
        """Side met across each side, (f, 3); itself where there is none. Where more than two meet: some other."""
        mine = np.arange(self.edges.size)
        rows = np.flatnonzero(np.repeat(self.real, 3))
        order = rows[ranked(self.edges.ravel()[rows])]
        edges = self.edges.ravel()[order]
        same = np.flatnonzero(edges[1:] == edges[:-1])
        mine[order[same]], mine[order[same + 1]] = order[same + 1], order[same]
        return mine.reshape(-1, 3)

    @cached_property
    def open_sides(self) -> int:
        """Edges at which an odd number of faces meet: one face is a rim, three are a wall on a surface."""
        return int(np.count_nonzero(self._uses(np.ones_like(self.forward)) % 2))

    @cached_property
    def free_sides(self) -> IntArray:
        """Numbers of the sides that one face alone has, ascending: where the surface ends."""
        alone = self._uses(np.ones_like(self.forward)) == 1
        return np.flatnonzero(alone[self.edges].ravel() & np.repeat(self.real, 3))

    @property
    def uneven_sides(self) -> int:
        """Edges at which an even number of faces meet, but not half of them in each sense."""
        uses, ahead = self._uses(np.ones_like(self.forward)), self._uses(self.forward)
        return int(np.count_nonzero((uses % 2 == 0) & (2 * ahead != uses)))

    def _uses(self, chosen: BoolArray) -> IntArray:
        sides = self.edges[self.real][chosen[self.real]]
        return np.bincount(sides, minlength=int(self.edges.max()) + 1)

    @cached_property
    def bodies(self) -> IntArray:
        """Number of the connected body of each face, (f,): faces that share an edge belong together."""
        from dqreg.kernels.components import components

        count = len(self.corners)
        rows = np.repeat(np.arange(count), 3)
        size = count + int(self.edges.max()) + 1
        bodies: IntArray = components(size, rows, count + self.edges.ravel().astype(np.int64))[:count]
        return bodies
