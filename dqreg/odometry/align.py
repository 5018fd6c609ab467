"""One frame against the map: screen starts, find the basin on a few points, finish on all of them."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Scan
from dqreg.icp import ESTIMATORS, Alignment, InlierMixture, Level, Plan, Run, Schedule, Stopping, width_floor
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.settings import OdometrySettings, Resolved
from dqreg.odometry.starts import candidates, screen
from dqreg.trust.verdict import fraction_fits

# Points of the coarse level.
COARSE = 400
# The width falls with every iteration; few suffice from a screened start.
QUICK = Schedule("quick", stages=25, iterations=1, rounds=1)
FINE = Schedule("fine", stages=4, iterations=None, rounds=30)
# Width to begin with, over the reach.
WIDE = 0.3
# The last level ends once a step moves the points by less than this share of the map's diagonal.
TOLERANCE, ITERATIONS = 1e-5, 20


@dataclasses.dataclass(frozen=True)
class Aligned:
    """A frame at its best pose."""

    run: Run  # Last stage, with the history of all
    mixture: InlierMixture  # Width and share of inliers at the end

    @property
    def found(self) -> bool:
        """Whether there is a pose to speak of."""
        return not self.run.ended_early and bool(self.run.history)

    @property
    def inlier_fraction(self) -> float:
        """Mean probability of the frame's points to be inliers; 0 where no pose was found."""
        return float(self.run.weights.mean()) if self.found else 0.0


def align(scan: Scan, surface: MapSurface, poses: FloatArray, settings: Resolved, method: str, keep: int) -> Aligned:
    """The best of several starts.

    Shapes: poses (m, 4, 4).
    """
    plan = Plan(ESTIMATORS[method], settings.reach)
    floor = width_floor(scan, surface)
    coarse = Level(scan.thinned(COARSE), surface, plan, floor, last=False)
    best: tuple[float, Alignment] | None = None
    starts = screen(surface, scan.points, poses, 0.5 * settings.reach, keep) if len(poses) > 1 else poses
    wide = InlierMixture.starting(WIDE * plan.max_distance, plan.max_distance)
    for start in starts:
        run = coarse.descend(wide, start, QUICK, None, 1)
        misfit = np.inf if run.ended_early else coarse.mean_nll(run)
        if best is None or misfit < best[0]:
            best = (misfit, run)
    assert best is not None
    run = best[1]
    return Aligned(run, run.mixture) if run.ended_early else _finish(scan, surface, run, plan, floor, settings)


def _finish(scan: Scan, surface: MapSurface, run: Alignment, plan: Plan, floor: float, settings: Resolved) -> Aligned:
    stopping = Stopping(TOLERANCE, ITERATIONS)
    fine = dataclasses.replace(plan, max_distance=settings.near, stopping=stopping)
    level = Level(scan, surface, fine, floor, last=True)
    narrow = InlierMixture(min(run.mixture.scale, 0.5 * settings.near), run.mixture.share, settings.near)
    finer = level.descend(narrow, run.T_target_source, FINE, None, run.next_number).after(run)
    return Aligned(finer, finer.mixture)


# Lattices of turns: the everyday one, and the one for a frame that fits badly, whose limit is in the settings.
EVERYDAY_DEG, STEP_DEG, RESCUE_STEP_DEG = 40.0, 20.0, 15.0
# Starts of the last attempt that are refined.
RESCUE_STARTS = 6


@dataclasses.dataclass(frozen=True)
class FrameSearch:
    """Searches the pose of a frame in the map."""

    surface: MapSurface  # The map
    lengths: Resolved  # Lengths of the sequence
    settings: OdometrySettings  # Method and largest turn
    usual: float  # Fraction of inliers in the frames before; NaN where there are none
    anchors: list[tuple[FloatArray, FloatArray]]  # Poses (4, 4) around which is searched, the likeliest first

    def find(self, scan: Scan, *, trust_motion: bool) -> Aligned:
        """The pose of a frame."""
        if trust_motion:
            aligned = self._try(scan, self.anchors[0][1][None], 1)
            if self.fits(aligned):
                return aligned
        aligned = self._try(scan, self._lattice(min(EVERYDAY_DEG, self.settings.search_deg), STEP_DEG), 1)
        if self.fits(aligned):
            return aligned
        rescued = self._try(scan, self._lattice(self.settings.search_deg, RESCUE_STEP_DEG), RESCUE_STARTS)
        return rescued if rescued.inlier_fraction > aligned.inlier_fraction else aligned

    def fits(self, aligned: Aligned) -> bool:
        """Whether the fraction of inliers is that of a right pose."""
        return fraction_fits(aligned.inlier_fraction, self.usual)

    def refine(self, scan: Scan, T_map_frame: FloatArray) -> Aligned:
        """The pose of a frame near a known one, (4, 4)."""
        return self._try(scan, T_map_frame[None], 1)

    def _try(self, scan: Scan, poses: FloatArray, keep: int) -> Aligned:
        return align(scan, self.surface, poses, self.lengths, self.settings.method, keep)

    def _lattice(self, limit_deg: float, step_deg: float) -> FloatArray:
        return np.concatenate([candidates(*anchor, limit_deg, step_deg) for anchor in self.anchors])
