"""One frame against the map: a few points choose among many initial poses, all of them refine the best."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Scan
from dqreg.icp import (
    ESTIMATORS,
    Alignment,
    AnnealingSchedule,
    IcpSettings,
    InlierMixture,
    Level,
    Stopping,
    smallest_kernel_scale,
)
from dqreg.icp.correspondences import Correspondences
from dqreg.odometry.follow import Following, follow
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import candidates, screen
from dqreg.trust.doubts import fraction_fits

# Points of the coarse level.
COARSE = 400
# The kernel scale falls with every iteration; few suffice from an initial pose that was chosen.
QUICK = AnnealingSchedule("quick", stages=25, iterations=1, rounds=1)
FINE = AnnealingSchedule("fine", stages=4, iterations=None, rounds=30)
# Steps a search and searches of either, for planes; and the step, in voxels, from which on all points go on.
QUICK_STEPS, FINE_STEPS, NEAR_ENOUGH = (2, 25), (6, 20), 0.1
# Distance at which a match counts half on the last level, over their median.
FAR = 2.5
# First kernel scale, over the largest distance.
WIDE = 0.3
# The last level ends once a step moves the points by less than this fraction of the map's diagonal.
TOLERANCE, ITERATIONS = 1e-5, 20
# Lattices of rotations: the usual one, and the one for a frame that fits badly, whose limit is in the settings.
USUAL_DEG, STEP_DEG, RESCUE_STEP_DEG = 40.0, 20.0, 15.0
# Initial poses of the last attempt that are refined.
RESCUE_STARTS = 6


@dataclasses.dataclass(frozen=True)
class FrameSearch:
    """Searches the pose of a frame in the map."""

    surface: MapSurface  # The map
    lengths: Resolved  # Lengths of the sequence
    settings: OdometrySettings  # Method and largest rotation
    usual: float  # Fraction of inliers in the frames before; NaN where there are none
    anchors: list[tuple[FloatArray, FloatArray]]  # Poses (4, 4) around which is searched, the likeliest first

    def find(self, scan: Scan, *, trust_motion: bool) -> Alignment:
        """The pose of a frame."""
        if trust_motion:
            aligned = self.refine(scan, self.anchors[0][1])
            if self.fits(aligned):
                return aligned
        aligned = self._align(scan, self._lattice(min(USUAL_DEG, self.settings.search_deg), STEP_DEG), 1)
        if self.fits(aligned):
            return aligned
        rescued = self._align(scan, self._lattice(self.settings.search_deg, RESCUE_STEP_DEG), RESCUE_STARTS)
        return rescued if rescued.inlier_fraction > aligned.inlier_fraction else aligned

    def refine(self, scan: Scan, T_map_frame: FloatArray) -> Alignment:
        """The pose of a frame near a known one, (4, 4)."""
        return self._align(scan, T_map_frame[None], 1)

    def fits(self, aligned: Alignment) -> bool:
        """Whether the fraction of inliers is that of a right pose."""
        return fraction_fits(aligned.inlier_fraction, self.usual)

    def _lattice(self, limit_deg: float, step_deg: float) -> FloatArray:
        return np.concatenate([candidates(*anchor, limit_deg, step_deg) for anchor in self.anchors])

    def _align(self, scan: Scan, poses: FloatArray, keep: int) -> Alignment:
        """The best of several initial poses, (m, 4, 4), of which some are refined."""
        surface, lengths, few = self.surface, self.lengths, scan.thinned(COARSE)
        starts = screen(surface, scan.points, poses, 0.5 * lengths.reach, keep) if len(poses) > 1 else poses
        runs = [self._coarse(few, start) for start in starts]
        run = runs[0]
        if len(runs) > 1:
            coarse = self._level(few, lengths.reach)
            run = min(runs, key=lambda run: np.inf if run.ended_early else coarse.mean_nll(run))
        return run if run.ended_early else self._fine(scan, run)

    def _coarse(self, few: Scan, start: FloatArray) -> Alignment:
        """A run with few points, from anywhere."""
        wide = InlierMixture.starting(WIDE * self.lengths.reach, self.lengths.reach)
        if self.settings.method == "plane":
            how = Following("quick", *QUICK_STEPS, enough=NEAR_ENOUGH * self.lengths.voxel_size)
            return follow(few, self.surface, start, wide, how, floor=smallest_kernel_scale(few, self.surface))
        return self._level(few, self.lengths.reach).descend(wide, start, QUICK, None, 1)

    def settle(self, scan: Scan, T_map_frame: FloatArray, before: Alignment) -> Alignment:
        """The pose of a frame, all but known: from there, where it was found before with its points a little off."""
        return self._fine(scan, dataclasses.replace(before, T_target_source=T_map_frame), before.pairs)

    def _fine(self, scan: Scan, run: Alignment, before: Correspondences | None = None) -> Alignment:
        """A run refined with all points, whose matches are near those that they had before."""
        near, T = self.lengths.near, run.T_target_source
        narrow = InlierMixture(min(run.mixture.scale, 0.5 * near), run.mixture.inlier_fraction, near)
        if self.settings.method == "plane":
            how = Following("fine", *FINE_STEPS, enough=TOLERANCE * self.surface.diagonal, far=FAR)
            found = follow(
                scan, self.surface, T, narrow, how, floor=self._floor(scan), first=run.next_number, before=before
            )
        else:
            level = dataclasses.replace(self._level(scan, near), last=True)
            found = level.descend(narrow, T, FINE, None, run.next_number, before=before)
        return found.after(run)

    def _floor(self, scan: Scan) -> float:
        return smallest_kernel_scale(scan, self.surface)

    def _level(self, scan: Scan, farthest: float) -> Level:
        plan = IcpSettings(ESTIMATORS[self.settings.method], farthest, stopping=Stopping(TOLERANCE, ITERATIONS))
        return Level(scan, self.surface, plan, self._floor(scan), last=False)
