"""The map: points in voxels, so many in each at most, with a surface that grows with it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import Resolved
from dqreg.rigid import pose

# Places of the table of voxels for each that there is room for.
SPARSE = 2
# Share of the voxels that are out of range from which on they are forgotten, since the map is made anew then; and how
# far the sensor has to move, over the range, until they are counted again.
FAR, STEP = 1.0 / 8.0, 1.0 / 32.0


class VoxelMap:
    """Points of a map; the same as in KISS-ICP's, which forgets what is out of range at once."""

    def __init__(self, lengths: Resolved, points: FloatArray | None = None) -> None:
        self._lengths, self._counted_at = lengths, np.zeros(3)
        self._make(np.zeros((0, 3)) if points is None else points)

    def _make(self, points: FloatArray, voxels: int = 1) -> None:
        """A map of points, with room for so many voxels: those of a map are all taken again, in their order."""
        room, size = max(len(points), voxels), 1
        while size < SPARSE * room:
            size *= 2
        self.surface = MapSurface(np.zeros((0, 3)))
        # Points and voxels so far.
        self._counts, self._table = np.zeros(2, dtype=np.int64), np.full(size, -1)
        self._cells = np.zeros((room, 3), dtype=np.int64)
        self._members = np.zeros((room, self._lengths.max_points_per_voxel), dtype=np.int64)
        self._filled = np.zeros(room, dtype=np.int64)
        self._add(points)

    @property
    def points(self) -> FloatArray:
        """All points, (n, 3), the oldest first."""
        return self.surface.points

    def insert(self, points: FloatArray, T_map_frame: FloatArray) -> None:
        """Add the points of a frame, (n, 3), and forget what is out of range from there."""
        self._add(pose.apply(T_map_frame, points))
        place, reach = T_map_frame[:3, 3], self._lengths.max_range
        if np.linalg.norm(place - self._counted_at) > STEP * reach:
            self._counted_at = place.copy()
            self._forget(place, reach)

    def _forget(self, place: FloatArray, reach: float) -> None:
        voxels = int(self._counts[1])
        # The first point stands for its voxel.
        away = self.points[self._members[:voxels, 0]] - place
        far = np.einsum("ij,ij->i", away, away) > reach**2
        if np.count_nonzero(far) > FAR * voxels:
            gone = self._members[:voxels][far]
            gone = gone[np.arange(gone.shape[1]) < self._filled[:voxels][far, None]]
            self._make(np.delete(self.points, gone, axis=0))

    def _add(self, points: FloatArray) -> None:
        from dqreg.kernels.threads import as_plain
        from dqreg.kernels.voxel_points import admit_points

        most = int(self._counts[1]) + len(points)
        if most > len(self._filled):
            self._make(self.points, 2 * most)
        size, most = self._lengths.voxel_size, self._lengths.max_points_per_voxel
        room = self.surface.room(len(points))
        voxels = self._table, self._cells, self._members, self._filled, self._counts
        admit_points(as_plain(points), size, size / float(np.sqrt(most)), room, *voxels)
        self.surface.grow(int(self._counts[0]))
