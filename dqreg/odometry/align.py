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
from dqreg.odometry.follow import FREE_TRANSLATION_SEARCHES, Following, SweptFrame, follow, is_in_cells
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import candidates, screen
from dqreg.trust.limits import fraction_fits

# Points of the coarse level, and where all others tell afterwards whether it was right.
COARSE_POINTS, CHECKED_COARSE_POINTS = 400, 200
# The kernel scale falls with every iteration; few suffice from an initial pose that was chosen.
QUICK_SCHEDULE = AnnealingSchedule("quick", stages=25, iterations=1, rounds=1)
FINE_SCHEDULE = AnnealingSchedule("fine", stages=4, iterations=None, rounds=30)
# Steps a search and searches of either, for planes.
QUICK_STEPS, FINE_STEPS = (2, 25), (4, 20)
# The step, in voxels, from which on all points are used.
ALL_POINTS_STEP_VOXELS = 0.3
# Least scale of the kernel, in voxels: below it the faces that are seen at a grazing angle, whose heights hardly err,
# would outvote those that are seen from the front.
MIN_KERNEL_SCALE_VOXELS = 0.05
# Points from which on a frame is followed on the planes of cells: of fewer, many meet none.
MIN_POINTS_FOR_CELLS = 1_000
# Runs with few points, each from where the last one ended, and the inliers that one has to win for another: rings of
# a LiDAR hold the steps back, and a run ends by their number.
MAX_APPROACHES, WORTHWHILE_SHARE = 4, 0.02
# Points that the pose of a frame with times is found from, before its motion is found with it from all.
POINTS_BEFORE_SWEEP = 1_000
# First kernel scale, over the largest distance.
FIRST_SCALE_REACHES = 0.3
# The last level ends once a step moves the points by less than this fraction of the map's diagonal.
TOLERANCE_DIAGONALS, MAX_ITERATIONS = 3e-5, 20
# Lattice of rotations.
LATTICE_DEG, LATTICE_STEP_DEG = 40.0, 20.0
# Its step for a frame that fits badly; the limit is in the settings.
RESCUE_LATTICE_STEP_DEG = 15.0
# Initial poses of the last attempt that are refined.
RESCUE_INITIAL_POSES = 6


@dataclasses.dataclass(frozen=True)
class FrameSearch:
    """Searches the pose of a frame in the map."""

    surface: MapSurface  # The map
    lengths: Resolved  # Lengths of the sequence
    settings: OdometrySettings  # Method and largest rotation
    usual: float  # Fraction of inliers in the frames before; NaN where there are none
    anchors: list[tuple[FloatArray, FloatArray]]  # Poses (4, 4) around which is searched, the likeliest first
    is_told: bool = False  # Whether other sensors tell what the frame leaves free, so that it need not slide

    def scan_of(self, frame: DownsampledFrame) -> Scan:
        """Points of a frame, with its own normals where few points, or the method, need them."""
        return (
            frame.scan if self.settings.method == "plane" and len(frame.seen) >= MIN_POINTS_FOR_CELLS else frame.fitted
        )

    def find(self, frame: DownsampledFrame, *, trust_motion: bool, near: bool = False) -> Alignment:
        """The pose of a frame; near the prediction, where that has been good to a voxel."""
        scan = self.scan_of(frame)
        if frame.back is not None and self.settings.method == "plane":
            scan = scan.thinned(POINTS_BEFORE_SWEEP)
        aligned = self._found(scan, trust_motion=trust_motion, near=near)
        if (
            len(scan) < MIN_POINTS_FOR_CELLS
            or self.settings.method != "plane"
            or not aligned.found
            or is_in_cells(aligned)
        ):
            return aligned
        return self._found(frame.fitted, trust_motion=trust_motion, near=False)

    def find_with_sweep(self, sweep: SweptFrame, *, near: bool) -> Alignment:
        """The pose of a frame near the prediction and the motion during its sweep, both from all of its points."""
        T, scan = self.anchors[0][1], sweep.scan
        if near:
            mixture = InlierMixture.starting(0.5 * self.lengths.near, self.lengths.near)
            return self._follow(scan, T, mixture, 1, sweep=sweep)
        run = self._coarse(scan.thinned(CHECKED_COARSE_POINTS), T)
        return run if run.ended_early else self.settle_sweep(sweep, run)

    def _found(self, scan: Scan, *, trust_motion: bool, near: bool) -> Alignment:
        if near and self.settings.method == "plane":
            mixture = InlierMixture.starting(0.5 * self.lengths.near, self.lengths.near)
            aligned = self._follow(scan, self.anchors[0][1], mixture, 1)
            if aligned.status == "converged" and self.fits(aligned) and is_in_cells(aligned):
                return aligned
        if trust_motion:
            aligned = self.refine(scan, self.anchors[0][1])
            if self.fits(aligned):
                return aligned
        aligned = self._align(scan, self._lattice(min(LATTICE_DEG, self.settings.search_deg), LATTICE_STEP_DEG), 1)
        if self.fits(aligned):
            return aligned
        rescued = self._align(
            scan, self._lattice(self.settings.search_deg, RESCUE_LATTICE_STEP_DEG), RESCUE_INITIAL_POSES
        )
        return rescued if rescued.inlier_fraction > aligned.inlier_fraction else aligned

    def refine(self, scan: Scan, T_map_frame: FloatArray) -> Alignment:
        """The pose of a frame near a known one, (4, 4)."""
        return self._align(scan, T_map_frame[None], 1)

    def approach(self, scan: Scan, T_map_frame: FloatArray) -> Alignment:
        """The pose of a few points of a frame near a known one, (4, 4), begun again where that wins inliers."""
        few = scan.thinned(COARSE_POINTS)
        run = self._coarse(few, T_map_frame)
        for _ in range(MAX_APPROACHES - 1):
            again = run if run.ended_early else self._coarse(few, run.T_target_source)
            won = again.inlier_fraction - run.inlier_fraction
            run = again if won > 0.0 else run
            if won < WORTHWHILE_SHARE:
                break
        return run

    def fits(self, aligned: Alignment) -> bool:
        """Whether the fraction of inliers is that of a right pose."""
        return fraction_fits(aligned.inlier_fraction, self.usual)

    def _lattice(self, limit_deg: float, step_deg: float) -> FloatArray:
        return np.concatenate([candidates(*anchor, limit_deg, step_deg) for anchor in self.anchors])

    def _align(self, scan: Scan, poses: FloatArray, keep: int) -> Alignment:
        """The best of several initial poses, (m, 4, 4), of which some are refined."""
        surface, lengths, few = self.surface, self.lengths, scan.thinned(COARSE_POINTS)
        starts = screen(surface, scan.points, poses, 0.5 * lengths.reach, keep) if len(poses) > 1 else poses
        runs = [self._coarse(few, start) for start in starts]
        run = runs[0]
        if len(runs) > 1:
            coarse = self._level(few, lengths.reach)
            run = min(runs, key=lambda run: np.inf if run.ended_early else coarse.mean_nll(run))
        return run if run.ended_early else self._fine(scan, run)

    def _coarse(self, few: Scan, start: FloatArray) -> Alignment:
        """A run with few points, from anywhere."""
        wide = InlierMixture.starting(FIRST_SCALE_REACHES * self.lengths.reach, self.lengths.reach)
        if self.settings.method == "plane":
            how = Following(
                "quick",
                *QUICK_STEPS,
                enough=ALL_POINTS_STEP_VOXELS * self.lengths.voxel_size,
                cells=False,
                holds=self._holds,
            )
            return follow(few, self.surface, start, wide, how, floor=self._floor(few))
        return self._level(few, self.lengths.reach).descend(wide, start, QUICK_SCHEDULE, None, 1)

    def settle(self, scan: Scan, T_map_frame: FloatArray, before: Alignment, *, anew: bool = False) -> Alignment:
        """The pose of a frame, all but known: from there, where it was found before with its points a little off.

        Anew: in another map, whose matches are others.
        """
        pairs = None if anew else before.pairs
        return self._fine(scan, dataclasses.replace(before, T_target_source=T_map_frame), pairs)

    def settle_sweep(self, sweep: SweptFrame, before: Alignment) -> Alignment:
        """The pose of a frame as above, and the motion during its sweep."""
        near = self.lengths.near
        narrow = InlierMixture(min(before.mixture.scale, 0.5 * near), before.mixture.inlier_fraction, near)
        T, scan = before.T_target_source, sweep.scan
        return self._follow(scan, T, narrow, before.next_number, before.pairs, sweep).after(before)

    def _fine(self, scan: Scan, run: Alignment, before: Correspondences | None = None) -> Alignment:
        """A run refined with all points, whose matches are near those that they had before."""
        near, T = self.lengths.near, run.T_target_source
        narrow = InlierMixture(min(run.mixture.scale, 0.5 * near), run.mixture.inlier_fraction, near)
        if self.settings.method == "plane":
            return self._follow(scan, T, narrow, run.next_number, before).after(run)
        level = dataclasses.replace(self._level(scan, near), last=True)
        return level.descend(narrow, T, FINE_SCHEDULE, None, run.next_number, before=before).after(run)

    def _follow(
        self,
        scan: Scan,
        T: FloatArray,
        mixture: InlierMixture,
        first: int,
        before: Correspondences | None = None,
        sweep: SweptFrame | None = None,
    ) -> Alignment:
        how = Following(
            "fine",
            *FINE_STEPS,
            enough=TOLERANCE_DIAGONALS * self.surface.diagonal,
            cells=len(scan) >= MIN_POINTS_FOR_CELLS,
            holds=self._holds,
        )
        floor = self._floor(scan)
        found = follow(scan, self.surface, T, mixture, how, floor=floor, first=first, before=before, sweep=sweep)
        if sweep is not None or not how.cells or is_in_cells(found):
            return found
        # A sparse sensor, in its first frames.
        how = dataclasses.replace(how, cells=False)
        return follow(scan, self.surface, T, mixture, how, floor=floor, first=first)

    @property
    def _holds(self) -> int:
        return 0 if self.is_told else FREE_TRANSLATION_SEARCHES

    def _floor(self, scan: Scan) -> float:
        if self.settings.method == "plane":
            return MIN_KERNEL_SCALE_VOXELS * self.lengths.voxel_size
        return smallest_kernel_scale(scan, self.surface)

    def _level(self, scan: Scan, farthest: float) -> Level:
        plan = IcpSettings(
            ESTIMATORS[self.settings.method], farthest, stopping=Stopping(TOLERANCE_DIAGONALS, MAX_ITERATIONS)
        )
        return Level(scan, self.surface, plan, self._floor(scan), last=False)
