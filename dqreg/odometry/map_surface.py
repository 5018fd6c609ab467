"""The map as a surface: points in voxels, and planes of the sums of their cells.

A plane of the map is never fitted to neighbours that are searched: every point that a frame brings is added to the
sums of its cell, and the plane at a point is that of the cells around it, found when a frame first meets it.
"""

from __future__ import annotations

import dataclasses
import math
import mmap
from contextlib import suppress
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry.normals import MIN_SPREAD_RATIO
from dqreg.geometry.surface import Closest, Hint

Rows = TypeVar("Rows", bound=NDArray[Any])

# Places of the table of blocks for each that there is room for.
TABLE_PLACES_PER_BLOCK = 2
# What is taken off what no other point is nearer than: more than rounding.
RELATIVE_ROUNDING = 1e-12
# Rows that room is made for, of each that is needed: what nobody wrote to is no memory yet, and is not copied.
RESERVED_ROWS_PER_ROW = 8
# Bytes from which on an array has pages of its own.
MIN_HUGE_PAGE_BYTES = 1 << 20
# Points of a voxel that lie side by side at most.
MAX_SLOTS_PER_VOXEL = 16
# A match is kept where no other point can be nearer by more than this many voxels: points of the map are three times as
# far apart, and the planes of all of them are the same.
KEPT_MATCH_VOXELS = 0.03
# Queries that one thread answers in one go: of planes, of nearest points,
PLANE_CHUNK_QUERIES, NEAREST_CHUNK_QUERIES = 256, 64
# and of planes that were queried before.
KNOWN_PLANE_CHUNK_QUERIES = 8_192
# Number, voxels and blocks; sums of a voxel: see the kernels.
COUNTERS, VOXEL_SUMS = 3, (8, 10)
# Numbers of the plane of a point.
PLANE_NUMBERS = 9


@dataclasses.dataclass(frozen=True)
class MapPlanes(Closest):
    """What `MapSurface.planes_at` finds; the element is a cell, -1 where nothing stands."""

    variances: FloatArray = dataclasses.field(kw_only=True)
    roughness: FloatArray = dataclasses.field(kw_only=True)  # (n,): Mean squared distance of its points from each plane
    asked: IntArray = dataclasses.field(kw_only=True)  # (n, 3): Cells of the queries

    @staticmethod
    def none(count: int) -> MapPlanes:
        """Of so many queries that were never asked."""
        (points, normals), rows = np.zeros((2, count, 3)), np.full(count, -1)
        asked, (distances, roughness) = np.full((count, 3), np.iinfo(np.int64).min), np.zeros((2, count))
        unknown = np.full(count, np.inf)
        return MapPlanes(points, normals, distances, rows, variances=unknown, roughness=roughness, asked=asked)

    def copied(self) -> MapPlanes:
        """The same, to be written over."""
        places = self.points.copy(), self.normals.copy(), self.distances.copy(), self.elements.copy()
        variances, roughness = self.variances.copy(), self.roughness.copy()
        return MapPlanes(*places, variances=variances, roughness=roughness, asked=self.asked.copy())


class MapSurface:
    """Points of a map that grows as a surface, for one thread.

    >>> flat = np.stack(np.meshgrid(range(8), range(8), [0.0]), axis=-1).reshape(-1, 3)
    >>> found = MapSurface(2.0, 12, 10.0, flat).closest(np.array([[3.2, 4.1, 2.0]]))
    >>> found.points.tolist(), np.abs(found.normals).tolist()
    ([[3.0, 4.0, 0.0]], [[0.0, 0.0, 1.0]])
    """

    oriented = False

    def __init__(
        self, size: float, most: int, reach: float, points: FloatArray | None = None, *, noise: float = 0.0
    ) -> None:
        self._size, self._most, self._reach, self._thin = size, most, reach, MIN_SPREAD_RATIO * noise**2
        self._counts, self._state = np.zeros(COUNTERS, dtype=np.int64), 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._points, self._planes = np.zeros((0, 3)), np.zeros((0, 8, PLANE_NUMBERS))
        self._links, self._voxels = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
        self._sums = np.zeros((0, *VOXEL_SUMS), dtype=np.float32)
        self._slots = np.zeros((0, min(most, MAX_SLOTS_PER_VOXEL), 3), dtype=np.float32)
        self._members = np.zeros((0, min(most, MAX_SLOTS_PER_VOXEL)), dtype=np.int32)
        self._table, self._keys = np.zeros(TABLE_PLACES_PER_BLOCK, dtype=np.int32), np.zeros((0, 3), dtype=np.int64)
        self._cells = np.zeros((0, 64), dtype=np.int32)
        self.add(np.zeros((0, 3)) if points is None else points)

    def add(self, points: FloatArray) -> None:
        """Take those of some points, (n, 3), for which there is room, and the sums of all."""
        from dqreg.kernels.maps.voxel_points import admit_points
        from dqreg.kernels.threads import as_plain

        self._make_room(len(points))
        held = self._points, self._links, self._table, self._keys, self._cells, self._voxels, self._slots, self._members
        apart, before = self._size / float(np.sqrt(self._most)), int(self._counts[0])
        sums = self._sums.reshape(-1, VOXEL_SUMS[1])
        admit_points(as_plain(points), self._size, apart, self._most, *held, sums, self._counts)
        # Planes know the points that there were.
        self._state += 1
        if len(new := self._points[before : self._counts[0]]):
            low, high = bounds(new)
            self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        self.about(np.zeros(3), np.inf)

    def _make_room(self, more: int) -> None:
        """Room for so many points more, each in a voxel and a block of its own."""
        from dqreg.kernels.maps.voxel_blocks import put_blocks

        points, voxels, blocks = (self._counts + more).tolist()
        held = self._counts.tolist()
        if points > len(self._points):
            self._points, self._links = (
                _longer(self._points, held[0], RESERVED_ROWS_PER_ROW * points),
                _longer(self._links, held[0], RESERVED_ROWS_PER_ROW * points),
            )
        if voxels > len(self._voxels):
            self._voxels, self._sums = (
                _longer(self._voxels, held[1], RESERVED_ROWS_PER_ROW * voxels),
                _longer(self._sums, held[1], RESERVED_ROWS_PER_ROW * voxels),
            )
            self._planes, self._slots = (
                _longer(self._planes, held[1], RESERVED_ROWS_PER_ROW * voxels),
                _longer(self._slots, held[1], RESERVED_ROWS_PER_ROW * voxels),
            )
            self._members = _longer(self._members, held[1], RESERVED_ROWS_PER_ROW * voxels)
        if blocks > len(self._keys):
            self._keys, self._cells = (
                _longer(self._keys, held[2], RESERVED_ROWS_PER_ROW * blocks),
                _longer(self._cells, held[2], RESERVED_ROWS_PER_ROW * blocks),
            )
        if TABLE_PLACES_PER_BLOCK * blocks > len(self._table):
            size = 1
            while size < TABLE_PLACES_PER_BLOCK * blocks:
                size *= 2
            self._table = np.zeros(size, dtype=np.int32)
            put_blocks(self._keys, int(self._counts[2]), self._table)

    def about(self, place: FloatArray, reach: float) -> None:
        """Measure the surface by what a frame can meet of it: what lies within a reach of a place."""
        low, high = self._low, self._high
        if not self._counts[0]:
            low = high = np.zeros(3)
        near = np.maximum(low, place - reach), np.minimum(high, place + reach)
        low, high = near if (near[0] < near[1]).any() and (near[0] <= near[1]).all() else (low, high)
        self.centre: FloatArray = 0.5 * (low + high)
        self.diagonal = float(np.linalg.norm(high - low))

    @property
    def points(self) -> FloatArray:
        """Of the map, (n, 3), the oldest first."""
        return self._points[: self._counts[0]]

    @property
    def ends(self) -> FloatArray:
        """Lowest and highest coordinates of all points, (2, 3); infinite where there are none."""
        return np.stack([self._low, self._high])

    def voxels_of(self, values: FloatArray) -> FloatArray:
        """Of each point the value of the first one of its voxel, (n,)."""
        found: FloatArray = values[self._voxels[self._links[: self._counts[0], 1], 0]]
        return found

    @property
    def _held(self) -> tuple[Any, ...]:
        whole = self._points, self._links, self._table, self._keys, self._cells, self._voxels
        return *whole, self._slots, self._members

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest map point for each query, (n, 3), with the normal there; zero where the cells fix none.

        Farther off than the reach nothing is found: the row is -1 and the distance the reach. What was nearest is so
        still where it is nearer than any other can have come since the hint.
        """
        from dqreg.kernels.maps.voxel_planes import closest_in_voxels
        from dqreg.kernels.threads import as_plain, over_chunks

        count, none = len(points), np.zeros((0, 3))
        distances, others, variances = np.zeros((3, count))
        if hint is not None and hint[1].others is not None and hint[1].variances is not None:
            known = hint[1]
            before, others_before, rows = as_plain(hint[0]), as_plain(hint[1].others), known.elements.copy()
            feet, normals, variances = known.points.copy(), known.normals.copy(), hint[1].variances.copy()
        else:
            before, others_before, rows = none, none[:, 0], np.full(count, -1)
            feet, normals = np.zeros((2, count, 3))
        asked = (
            min(within, self._reach),
            self._size,
            self._thin,
            *self._held,
            self._sums.reshape(-1, VOXEL_SUMS[1]),
            self._planes.reshape(-1, PLANE_NUMBERS),
            self._state,
        )
        found = rows, distances, others, feet, normals, variances
        was = before, others_before, 1.0 - RELATIVE_ROUNDING, KEPT_MATCH_VOXELS * self._size
        over_chunks(closest_in_voxels, count, as_plain(points), *asked, *was, *found, chunk=NEAREST_CHUNK_QUERIES)
        return Closest(feet, normals, distances, rows, others, variances)

    def planes_at(self, points: FloatArray, before: MapPlanes | None = None) -> MapPlanes:
        """Plane of the cell of each query, (n, 3), or of the nearest cell beside it.

        Points of it are the middle of those that the plane was fitted to, distances those from the plane. What was
        found for the same queries before is taken over where they lie in the same cells.
        """
        from dqreg.kernels.maps.cell_matches import planes_in_cells
        from dqreg.kernels.threads import as_plain, over_chunks

        found = MapPlanes.none(len(points)) if before is None else before.copied()
        places = found.asked, found.elements, found.distances, found.points
        columns = *places, found.normals, found.variances, found.roughness
        held = self._size, self._thin, self._table, self._keys, self._cells, self._sums.reshape(-1, VOXEL_SUMS[1])
        planes = self._planes.reshape(-1, PLANE_NUMBERS), self._state, self._reach
        # Of those that were asked before few lie elsewhere: less than it costs to hand them over.
        chunk = PLANE_CHUNK_QUERIES if before is None else KNOWN_PLANE_CHUNK_QUERIES
        over_chunks(planes_in_cells, len(points), as_plain(points), *held, *planes, *columns, chunk=chunk)
        return found

    def distances(self, points: FloatArray, cap: float = np.inf) -> FloatArray:
        """Distance of each query, (n, 3), to the nearest map point, or the cap where that is less, (n,)."""
        from dqreg.kernels.maps.voxel_nearest import distances_in_voxels
        from dqreg.kernels.threads import as_plain, over_chunks

        found = np.zeros(len(points))
        asked = as_plain(points), min(cap, self._reach), self._size, *self._held
        over_chunks(distances_in_voxels, len(points), *asked, found, chunk=PLANE_CHUNK_QUERIES)
        return found


def _longer(rows: Rows, used: int, count: int) -> Rows:
    """The rows that are in use, and zeros up to a count: memory that nobody wrote to is not there yet."""
    made = _zeros((count, *rows.shape[1:]), rows.dtype)
    made[:used] = rows[:used]
    return cast(Rows, made)


def _zeros(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Zeros in pages of the largest size there is, of large arrays: a new map costs half of what it does in small ones.

    What NumPy takes again of what it gave back is zeroed at once, all of it.
    """
    size = math.prod(shape) * dtype.itemsize
    if size < MIN_HUGE_PAGE_BYTES or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.zeros(shape, dtype=dtype)
    memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    # Where a kernel has none of these, it says so.
    with suppress(OSError):
        memory.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(memory, dtype=dtype).reshape(shape)
