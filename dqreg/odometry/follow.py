"""A frame followed onto the planes of the map: matches are searched rarely, and between two searches all is solved.

The next pose, and the kernel that its distances ask for, cost less than the search for the matches. So each search is
followed by as many steps as its planes are good for. Near the pose a match is the plane of the cell of a point.
"""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import remember
from dqreg._statuses import Status
from dqreg.geometry import Closest, Scan
from dqreg.geometry.beams import BEAM_SINE
from dqreg.icp import Alignment, InlierMixture
from dqreg.icp.correspondences import Correspondences, find_correspondences, moved_points
from dqreg.icp.history import Iteration
from dqreg.icp.level import MIN_SCALE_RATIO, NEAR_ANGLE_RAD, SAMPLING_ERROR_SHARE
from dqreg.icp.loop import MIN_CORRESPONDENCES, Run
from dqreg.kernels.threads import as_plain
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapPlanes, MapSurface
from dqreg.odometry.sweep import swept_by
from dqreg.rigid import single_pose
from dqreg.rigid.single_pose import orthonormal
from dqreg.solvers.robust import LEAST_FRACTION

# A step that is so much shorter than the way since the search waits for the next search.
DEFERRED_STEP_SHARE = 0.05
# Share of the correspondences that has to face a motion during the sweep for it to count: at this share, half of it is
# believed in a step, of which each search takes many. Where a whole round follows the search, `deskewing` has its own.
STEP_DAMPING_SHARE = 0.05
# Share of the points that has to meet planes in their cells: 0.13 where 6 rings met one sweep, 0.5 where 16 did.
MIN_SHARE_IN_CELLS = 1.0 / 3.0
# Information below so many times what the noise of the normals alone would give constrains nothing: on real frames all
# six motions reach 15, the one along a corridor 1.
SPURIOUS_INFORMATION_RATIO = 3.0
# Search from which on what is free to slide is left where it is: else the rest would not come to rest for it.
FREE_TRANSLATION_SEARCHES = 10
# A scale that falls by less in all steps of a search is settled.
SETTLED_SCALE_RATIO = 0.8


@dataclasses.dataclass(frozen=True)
class Following:
    """How far a frame is followed."""

    stage: str  # Shown with each search
    steps: int  # Steps on the planes of one search at most
    searches: int  # At most
    enough: float  # Root mean square motion of the points since the search that ends it, a length; 0: their noise does
    cells: bool  # Whether matches are the planes of cells, in place of nearest points: for a pose that is near
    holds: int = FREE_TRANSLATION_SEARCHES  # Search from which on translations that nothing holds are left as they are


def follow(
    scan: Scan,
    surface: MapSurface,
    T: FloatArray,
    mixture: InlierMixture,
    how: Following,
    *,
    floor: float,
    first: int = 1,
    before: Correspondences | None = None,
    sweep: SweptFrame | None = None,
) -> Alignment:
    """The pose of a frame near a known one, (4, 4), with matches no farther off than the limit of the mixture.

    With a sweep, whose frame's scan it is, the motion that is undone in it is found as well.
    """
    lever = math.sqrt(float(np.einsum("ij,ij->", scan.points, scan.points)) / max(len(scan), 1))
    history: list[Iteration] = []
    mixture, spread = dataclasses.replace(mixture, scale=max(mixture.scale, floor)), scan._spread
    last = 0.0
    while True:
        began = time.perf_counter()
        pairs = before = _without_beams((_in_cells if how.cells else find_correspondences)(scan, surface, T, before))
        enough = max(how.enough, SAMPLING_ERROR_SHARE * mixture.scale / math.sqrt(max(len(scan), 1)))
        # Normals err about two axes, each by half of their variance.
        least = 0.5 * SPURIOUS_INFORMATION_RATIO if len(history) >= how.holds else 0.0
        ends = floor, lever, DEFERRED_STEP_SHARE * enough, least
        moved, weights, figures = (
            _steps(pairs, mixture, how, ends) if sweep is None else sweep.steps(pairs, mixture, how, ends)
        )
        scale, fraction, energy, total, squares, used, _ = figures.tolist()
        if used < MIN_CORRESPONDENCES:
            return Alignment(T, "no correspondences", tuple(history), pairs, weights, mixture=mixture)
        after = orthonormal(moved)
        motion = float(spread.motion(T, after))
        record = Iteration(
            number=first + len(history),
            stage=how.stage,
            points=len(scan),
            pairs=int(used),
            inlier_fraction=float(weights.sum()) / len(scan),
            rms=math.sqrt(squares / total),
            kernel_scale=mixture.scale,
            energy=energy,
            turn_rad=single_pose.angle_between(T, after),
            motion=motion / surface.diagonal,
            seconds=time.perf_counter() - began,
            T_target_source=after,
        )
        history.append(record)
        settled = scale >= SETTLED_SCALE_RATIO * mixture.scale and (sweep is None or sweep.is_still)
        mixture, T = InlierMixture(scale, fraction, mixture.limit), after
        # Of two motions the next one can be told.
        to_come = motion * min(motion / last, 1.0) if last > 0.0 else motion
        status: Status | None = "converged" if to_come <= enough and settled else None
        last, scan = motion, scan if sweep is None else sweep.scan
        if status is None and len(history) >= how.searches:
            status = "iteration limit"
        if status is not None:
            return Alignment(T, status, tuple(history), pairs, weights, mixture=mixture)


def _without_beams(pairs: Correspondences) -> Correspondences:
    """Correspondences just found, without the planes that their beams lie in.

    Round a corner all points of one ring lie in the plane of its beams, with nothing over: no plane would count more,
    and it holds the sensor where it was.
    """
    from dqreg.kernels.maps.cell_matches import leave_out_beams

    found = pairs.closest
    assert found.variances is not None
    places = found.points, found.normals, found.distances, found.variances
    leave_out_beams(pairs.moved, pairs.T_target_source[:3, 3].copy(), BEAM_SINE, *places, isinstance(found, MapPlanes))
    return pairs


def _steps(
    pairs: Correspondences, mixture: InlierMixture, how: Following, ends: tuple[float, float, float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pose after steps on the planes of correspondences, their weights, and figures of the last step."""
    from dqreg.kernels.steps.plane_steps import FIGURES, step_on_planes

    found, scan, T = pairs.closest, pairs.scan, pairs.T_target_source.copy()
    weights, figures = np.zeros(len(scan)), np.zeros(FIGURES)
    angle = min(max(math.pi * mixture.scale / mixture.limit, NEAR_ANGLE_RAD), 0.5 * math.pi)
    limits = _limits(mixture, ends, math.cos(angle), float(how.cells))
    points, own = as_plain(scan.points), as_plain(scan._rejecting_normals)
    step_on_planes(points, own, *_planes(found), limits, how.steps, T, weights, figures)
    return T, weights, figures


def _limits(mixture: InlierMixture, ends: tuple[float, float, float, float], *own: float) -> FloatArray:
    """Limits in the order of `plane_steps`, a kernel's own after those of both."""
    learned = mixture.scale, mixture.inlier_fraction, mixture.limit, LEAST_FRACTION
    return np.array([*learned, ends[0], MIN_SCALE_RATIO, *ends[1:], *own])


def _planes(found: Closest) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Feet, normals, distances, variances of the normals: the map knows all. And how rough the planes of cells are."""
    assert found.variances is not None
    rough = found.roughness if isinstance(found, MapPlanes) else np.zeros(len(found.points))
    places = as_plain(found.points), as_plain(found.normals), as_plain(found.distances)
    return *places, as_plain(found.variances), as_plain(rough)


def is_in_cells(run: Run) -> bool:
    """Whether a frame was followed on the planes of cells, and met enough of them."""
    found = run.pairs.closest
    return isinstance(found, MapPlanes) and bool(np.mean(found.variances < np.inf) >= MIN_SHARE_IN_CELLS)


class SweptFrame:
    """A frame with times, whose motion is found with its pose."""

    def __init__(self, frame: DownsampledFrame, worthwhile: float) -> None:
        self.scan, self.is_still, self._frame, self._worthwhile = frame.scan, False, frame, worthwhile
        assert frame.back is not None
        self._seen, self._back = frame.seen, as_plain(frame.back)
        self._step = single_pose.log(frame.motion[:3, :3], frame.motion[:3, 3])

    @property
    def frame(self) -> DownsampledFrame:
        """The frame with the motion undone that was found."""
        return remember(self._frame.without(single_pose.exp(self._step)), scan=self.scan)

    def steps(
        self, pairs: Correspondences, mixture: InlierMixture, how: Following, ends: tuple[float, float, float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As without a sweep; the scan is one with the motion undone that was found."""
        from dqreg.kernels.steps.plane_steps import FIGURES
        from dqreg.kernels.steps.sweep_steps import step_on_planes_of_sweep

        # The search before wanted both threads; these steps, and most searches after them, do not.
        self._frame.whole.begin()
        found, scan, T = pairs.closest, pairs.scan, pairs.T_target_source.copy()
        weights, figures, change = np.zeros(len(scan)), np.zeros(FIGURES), np.zeros(6)
        planes, points, limits = _planes(found), as_plain(scan.points), _limits(mixture, ends, STEP_DAMPING_SHARE)
        step_on_planes_of_sweep(points, self._back, *planes, limits, how.steps, T, change, weights, figures)
        self.is_still = off_at(self._frame.reach, change) <= self._worthwhile
        self._step = self._step + change
        self.scan = dataclasses.replace(scan, points=swept_by(self._seen, self._back, self._step))
        return T, weights, figures


def off_at(reach: float, change: FloatArray) -> float:
    """How far a twist, (6,), moves points at a distance from the sensor, at most."""
    return reach * float(np.linalg.norm(change[:3])) + float(np.linalg.norm(change[3:]))


def _in_cells(scan: Scan, surface: MapSurface, T: FloatArray, before: Correspondences | None) -> Correspondences:
    """The planes of the cells that the points lie in."""
    moved, known = moved_points(T, scan.points), None if before is None else before.closest
    hint = known if isinstance(known, MapPlanes) and len(known.points) == len(moved) else None
    pairs = Correspondences(scan, T, surface.planes_at(moved, hint), same_sign=False, surface=surface)
    return remember(pairs, moved=moved)
