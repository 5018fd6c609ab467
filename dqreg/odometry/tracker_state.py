"""Where a drive stands: what a frame that is tried may change, to be kept and put back whole."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.odometry.assess import MapLink
from dqreg.odometry.voxel_map import VoxelMap


@dataclasses.dataclass(frozen=True, eq=False)
class Standing:
    """The map, and where the sensor is in it."""

    T_last: FloatArray  # (4, 4): Of the last trusted frame, T_map_frame
    motion: FloatArray = dataclasses.field(default_factory=lambda: np.eye(4))  # (4, 4): Of one step
    world: VoxelMap | None = None  # The map
    link: MapLink = dataclasses.field(default_factory=MapLink)  # What it hangs on
    T_doubtful: FloatArray | None = None  # (4, 4): Of the last frame that was kept out of the map
    kept_out: int = 0  # Frames kept out of the map in a row
