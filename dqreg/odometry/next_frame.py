"""A frame on its way into the map, with all that it is placed by."""

from __future__ import annotations

import dataclasses

from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.kiss import KissParts
from dqreg.odometry.prediction import Prediction
from dqreg.odometry.settings import Resolved
from dqreg.odometry.voxel_map import VoxelMap
from dqreg.trust.records import Reason


@dataclasses.dataclass(frozen=True, eq=False)
class NextFrame:
    """A frame that is to be placed: in which map, from where on, and whether it may enter it."""

    frame: DownsampledFrame
    notes: tuple[Reason, ...]  # What was wrong with it as it was read
    world: VoxelMap  # The map
    lengths: Resolved  # Of the sequence
    kiss: KissParts  # How far predictions were off
    ratio: float  # Time since the last trusted frame, over that of the last motion
    expected: Prediction | None  # Where others expect it; None: constant velocity
    insert: bool  # Whether it may enter the map
