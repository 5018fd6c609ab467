"""The map: points in voxels, so many in each at most, with a surface that grows with it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.threads import Later
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import Resolved
from dqreg.rigid import pose

# Share of the points that are out of range from which on they are forgotten, since the map is made anew then; and how
# far the sensor has to move, over the range, until they are counted again.
FAR, STEP = 1.0 / 8.0, 1.0 / 32.0


class VoxelMap:
    """Points of a map; the same as in KISS-ICP's, which forgets what is out of range at once.

    A frame that is inserted is added when the map is asked for the next time, or beside what its caller does before.
    """

    def __init__(self, lengths: Resolved, points: FloatArray | None = None) -> None:
        self._lengths, self._counted_at = lengths, np.zeros(3)
        self._waiting: tuple[FloatArray, FloatArray] | None = None
        self._make(np.zeros((0, 3)) if points is None else points)

    def _make(self, points: FloatArray) -> None:
        """A map of points alone."""
        given = self._lengths
        self._surface = MapSurface(given.voxel_size, given.max_points_per_voxel, given.reach, points)

    @property
    def surface(self) -> MapSurface:
        """All points as a surface."""
        self._add_waiting()
        return self._surface

    @property
    def points(self) -> FloatArray:
        """All points, (n, 3), the oldest first."""
        return self.surface.points

    def insert(self, points: FloatArray, T_map_frame: FloatArray) -> None:
        """Add the points of a frame, (n, 3), and forget what is out of range from there."""
        self._add_waiting()
        self._waiting = points, T_map_frame

    @contextlib.contextmanager
    def growing(self) -> Iterator[None]:
        """Add what was inserted beside what is done meanwhile, without the map."""
        if self._waiting is None:
            yield
            return
        added = Later(self._add_waiting)
        try:
            yield
        finally:
            added.result()

    def _add_waiting(self) -> None:
        if self._waiting is None:
            return
        (points, T_map_frame), self._waiting = self._waiting, None
        self._surface.add(pose.apply(T_map_frame, points))
        place, reach = T_map_frame[:3, 3], self._lengths.max_range
        if np.linalg.norm(place - self._counted_at) > STEP * reach:
            self._counted_at = place.copy()
            self._forget(place, reach)

    def _forget(self, place: FloatArray, reach: float) -> None:
        points, corner = self._surface.points, np.abs(self._surface.ends - place).max(axis=0)
        if corner @ corner <= reach**2:
            # Nothing can be.
            return
        away = points - place
        # The first point stands for its voxel.
        far = self._surface.voxels_of(np.einsum("ij,ij->i", away, away)) > reach**2
        if np.count_nonzero(far) > FAR * len(points):
            self._make(points[~far])
