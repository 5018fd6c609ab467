"""Three attempts at a frame, each wider than the one before, until one fits."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry import Scan
from dqreg.odometry.align import Aligned, align
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import candidates
from dqreg.odometry.verdicts import fits

# Lattices of turns: the everyday one, and the one for a frame that fits badly, whose limit is in the settings.
EVERYDAY_DEG, STEP_DEG, RESCUE_STEP_DEG = 40.0, 20.0, 15.0
# Starts of the last attempt that are refined.
RESCUE_STARTS = 6


@dataclasses.dataclass(frozen=True)
class Seeker:
    """Finds frames in the map."""

    surface: MapSurface  # The map
    lengths: Resolved  # Lengths of the sequence
    settings: OdometrySettings  # Method and largest turn
    usual: float  # Usual share of points on the map; NaN where unknown
    anchors: list[tuple[FloatArray, FloatArray]]  # Poses (4, 4) around which is searched, the likeliest first

    def find(self, scan: Scan, *, trust_motion: bool) -> Aligned:
        """The pose of a frame."""
        if trust_motion:
            aligned = self._try(scan, self.anchors[0][1][None], 1)
            if fits(aligned.on_map, self.usual):
                return aligned
        aligned = self._try(scan, self._lattice(min(EVERYDAY_DEG, self.settings.search_deg), STEP_DEG), 1)
        if fits(aligned.on_map, self.usual):
            return aligned
        rescued = self._try(scan, self._lattice(self.settings.search_deg, RESCUE_STEP_DEG), RESCUE_STARTS)
        return rescued if rescued.on_map > aligned.on_map else aligned

    def refine(self, scan: Scan, T_map_frame: FloatArray) -> Aligned:
        """The pose of a frame near a known one, (4, 4)."""
        return self._try(scan, T_map_frame[None], 1)

    def _try(self, scan: Scan, poses: FloatArray, keep: int) -> Aligned:
        return align(scan, self.surface, poses, self.lengths, self.settings.method, keep)

    def _lattice(self, limit_deg: float, step_deg: float) -> FloatArray:
        return np.concatenate([candidates(*anchor, limit_deg, step_deg) for anchor in self.anchors])
