"""The map: points in voxels, so many in each at most, with a surface that grows with it."""

from __future__ import annotations

import dataclasses
import functools
import os
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.kernels.threads import Later
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import Resolved
from dqreg.rigid import pose

# Share of the points that are out of range from which on they are forgotten, since the map is made anew then; and how
# far the sensor has to move, over the range, until they are counted again.
FORGOTTEN_SHARE, RECOUNT_RANGES = 1.0 / 8.0, 1.0 / 32.0


# Maps that other threads may be adding to.
_growing: weakref.WeakSet[VoxelMap] = weakref.WeakSet()


class VoxelMap:
    """Points of a map; the same as in KISS-ICP's, which forgets what is out of range at once.

    A frame that is inserted is added beside what its caller does, until the map is asked for.
    """

    def __init__(self, lengths: Resolved, points: FloatArray | None = None) -> None:
        self._made = _Made.of(lengths, np.zeros((0, 3)) if points is None else points, np.zeros(3))
        # What a frame makes of it.
        self._added: Later[_Made] | None = None

    @property
    def surface(self) -> MapSurface:
        """All points as a surface."""
        self._settle()
        return self._made.surface

    @property
    def points(self) -> FloatArray:
        """All points, (n, 3), the oldest first."""
        return self.surface.points

    def insert(self, points: Callable[[], FloatArray], T_map_frame: FloatArray) -> None:
        """Add the points of a frame, which are made then, (n, 3), and forget what is out of range from there."""
        self._settle()
        # Of what was made, not of the map: that would hold itself, and its memory, until cycles are looked for.
        self._added = Later(functools.partial(self._made.grown, points, T_map_frame))
        _growing.add(self)

    def __getstate__(self) -> dict[str, Any]:
        self._settle()
        return vars(self)

    def _settle(self) -> None:
        """Wait for what is added; after an interrupt it may still be."""
        if self._added is None:
            return
        try:
            self._made = self._added.result()
        except Exception:
            self._added = None
            raise
        self._added = None
        _growing.discard(self)


@dataclasses.dataclass(frozen=True, eq=False)
class _Made:
    """A surface, and where its points were counted last."""

    lengths: Resolved
    surface: MapSurface
    counted_at: FloatArray

    @staticmethod
    def of(lengths: Resolved, points: FloatArray, counted_at: FloatArray) -> _Made:
        """Of points alone."""
        of_map = lengths.voxel_size, lengths.max_points_per_voxel, lengths.reach
        made = MapSurface(*of_map, points, noise=lengths.noise)
        return _Made(lengths, made, counted_at)

    def grown(self, points: Callable[[], FloatArray], T_map_frame: FloatArray) -> _Made:
        """With the points of a frame, without what is out of range if that is much; the surface is the same."""
        self.surface.add(pose.apply(T_map_frame, points()))
        place, reach = T_map_frame[:3, 3].copy(), self.lengths.max_range
        if np.linalg.norm(place - self.counted_at) <= RECOUNT_RANGES * reach:
            return self
        held, corner = self.surface.points, np.abs(self.surface.ends - place).max(axis=0)
        if corner @ corner > reach**2:
            away = held - place
            # The first point stands for its voxel.
            far = self.surface.voxels_of(np.einsum("ij,ij->i", away, away)) > reach**2
            if np.count_nonzero(far) > FORGOTTEN_SHARE * len(held):
                return _Made.of(self.lengths, held[~far], place)
        return dataclasses.replace(self, counted_at=place)


def _before_fork() -> None:
    # A child would hold half of what is added.
    for each in list(_growing):
        each._settle()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork)
