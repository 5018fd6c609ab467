"""The loop: correspond, weigh, solve, compare, stop. Estimator, kernel and weights are parts that can be exchanged."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg._records import replaced
from dqreg._statuses import INTERRUPTED, NO_POSE, Status
from dqreg.errors import DegenerateGeometryError
from dqreg.geometry.scan import Scan
from dqreg.geometry.surface import Surface
from dqreg.icp.acceleration import TOLERATED_RISE, Anderson
from dqreg.icp.correspondences import Correspondences, find_correspondences, propagate
from dqreg.icp.estimators import (
    BEND_VARIANCE,
    BEND_VARIANCE_SHARE,
    CHUNK_PAIRS,
    MIN_BEND_VARIANCE,
    MIN_PLANES,
    Estimator,
    cells_to_cells,
    points_and_normals,
    points_only,
    surfaces_to_surfaces,
)
from dqreg.icp.history import Iteration
from dqreg.icp.lowered_weights import flat_planes, lowering_of
from dqreg.icp.rejectors import Weight
from dqreg.icp.stopping import Stopping
from dqreg.icp.weighing import CHUNK_ROWS, NOTHING, MixtureWeights, Weighed, counted, weigh
from dqreg.rigid import single_pose
from dqreg.solvers.newton import FLAT_CURVATURE_RATIO, LONGEST_RAD, MAX_STEPS, NO_GAIN_SHARE, ROUNDING_RISE_RATIO
from dqreg.solvers.robust import InlierMixture, Kernel, LeastSquares

Observer = Callable[[Iteration], object]

# What an observer answers that ends the loop for its time, and not for what it saw: for that it answers False.
TIME_IS_UP: Final = object()
# A pose has six unknowns and a pair of points fixes at most one of them for good: its distance along the normal.
MIN_CORRESPONDENCES = 6
# Inliers that fix a pose at least.
MIN_INLIERS = 3
# How a step between planes is taken, see `kernels.plane_pass`.
OF_BEND = BEND_VARIANCE_SHARE, MIN_BEND_VARIANCE, BEND_VARIANCE
OF_NEWTON = NO_GAIN_SHARE, ROUNDING_RISE_RATIO, LONGEST_RAD, FLAT_CURVATURE_RATIO


def contraction_of(history: tuple[Iteration, ...]) -> float | None:
    """Factor between two successive motions of one stage on the same points: the last such pair, None without."""
    for before, after in zip(history[-2::-1], history[:0:-1], strict=True):
        # After an extrapolation that was taken back the motion is infinite, and no measure of the next one.
        if (before.stage, before.points) == (after.stage, after.points) and math.isfinite(before.motion):
            return min(after.motion / before.motion, 1.0) if before.motion > 0.0 else 1.0
    return None


def _ended_by(answer: object) -> Status | None:
    """How the answer of an observer ends the loop; None where it goes on."""
    return "stopped by observer" if answer is False else "time limit" if answer is TIME_IS_UP else None


@dataclasses.dataclass(frozen=True)
class Run:
    """Where a run of the loop ended."""

    T_target_source: FloatArray  # (4, 4): Last pose
    status: Status  # How it ended
    history: tuple[Iteration, ...]  # One record an iteration
    pairs: Correspondences  # Correspondences of the last iteration
    weights: FloatArray  # (n,): Their weights; a pair that stands for many points has up to as many
    earlier: tuple[Correspondences, ...] = ()  # The last correspondences of coarser levels, evenly drawn from the scan

    @property
    def contraction(self) -> float | None:
        """See `contraction_of`."""
        return contraction_of(self.history)

    @property
    def ended_early(self) -> bool:
        """Whether there is no point in going on from here."""
        return self.status in NO_POSE or self.status in INTERRUPTED

    @property
    def next_number(self) -> int:
        """Number of the iteration that would follow."""
        return self.history[-1].number + 1 if self.history else 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Alignment(Run):
    """Where runs at several kernel scales ended, with the history of all, and the mixture learned from the last."""

    mixture: InlierMixture
    near: bool = False  # Whether the last run is of a level that is near: by the fine estimator, where there is one

    @cached_property
    def found(self) -> bool:
        """Whether there is a pose to speak of: fewer inliers than fix one are none."""
        return self.status not in NO_POSE and bool(self.history) and float(self.weights.sum()) >= MIN_INLIERS

    @property
    def rms(self) -> float:
        """Root mean square distance of the inliers; NaN where no pose was found."""
        weights = self.weights
        return float(np.sqrt(dot(weights, self.pairs.squares) / weights.sum())) if self.found else np.nan

    @property
    def inlier_fraction(self) -> float:
        """Mean probability of a point to be an inlier; 0 where no pose was found."""
        return float(self.weights.sum() / self.pairs.scan.represented) if self.found else 0.0

    @staticmethod
    def of(run: Run, mixture: InlierMixture, *, near: bool) -> Alignment:
        """A run with what was learned from it."""
        parts = run.T_target_source, run.status, run.history, run.pairs, run.weights, run.earlier
        return Alignment(*parts, mixture=mixture, near=near)

    def after(self, before: Run) -> Alignment:
        """The same with the history of the runs before it."""
        return replaced(self, history=before.history + self.history)


@dataclasses.dataclass(frozen=True)
class Icp:
    """An ICP loop put together from its parts."""

    estimator: Estimator = points_and_normals  # From weighted pairs to an absolute pose
    # Robust kernel of the distances; held fixed during a run, so that the energy has one meaning
    kernel: Kernel = LeastSquares()
    rejectors: tuple[Weight, ...] = ()  # Further factors of the weights: distance, normal angle, trimming
    stopping: Stopping = Stopping()  # When to end
    accelerate: bool = True  # Whether Anderson acceleration extrapolates the steps
    tolerated: float = TOLERATED_RISE  # Fraction by which the energy may rise where that makes the steps shorter
    stage: str = "loop"  # Name of this run in the records
    fewest: int = MIN_CORRESPONDENCES  # Correspondences without which there is no pose
    # Way from where they were searched, in diagonals of the surface, on which matches slide on their tangent planes
    slides: float = 0.0

    def run(
        self,
        scan: Scan,
        surface: Surface,
        start: FloatArray,
        observe: Observer | None = None,
        first: int = 1,
        before: Correspondences | None = None,
    ) -> Run:
        """Alternate between closest points and closed form until nothing moves."""
        T = start
        history: list[Iteration] = []
        motions: list[float] = []
        slid = 0.0
        spread = scan._spread
        anderson = Anderson(start, spread.mean, spread.size, self.tolerated) if self.accelerate else None
        while True:
            began = time.perf_counter()
            pairs = before = find_correspondences(scan, surface, T, before)
            weighed, T_next = self._step(pairs)
            weights = weighed.weights
            if weighed.used < self.fewest:
                return Run(T, "no correspondences", tuple(history), pairs, weights)
            if T_next is None:
                return Run(T, "degenerate correspondences", tuple(history), pairs, weights)
            back = anderson.taken_back(T, T_next, weighed.energy) if anderson else None
            motions.append(spread.motion(T, T_next) / surface.diagonal if back is None else np.inf)
            # Where an extrapolation is taken back, the plain step before it is the best pose so far.
            T_next = T_next if back is None else back
            record = self._record(first + len(history), pairs, weighed, T_next, motions[-1], began)
            history.append(record)
            answer = None if observe is None else observe(record)
            if status := _ended_by(answer) or self.stopping.status(motions):
                return Run(T_next, status, tuple(history), pairs, weights)
            T, slid = anderson.ahead(T_next) if anderson else T_next, slid + motions[-1]
            if slid <= self.slides:
                before = propagate(pairs, T)
            else:
                slid = 0.0

    def _step(self, pairs: Correspondences) -> tuple[Weighed, FloatArray | None]:
        """Weights of correspondences and the pose that the estimator makes of them, None where there is none."""
        found = weighed_step(pairs, self.kernel, self.rejectors, self.estimator)
        if found is not None:
            return found
        weighed = weigh(pairs, self.kernel, self.rejectors)
        is_enough = weighed.used >= self.fewest
        return weighed, _pose_by(self.estimator, pairs, weighed.weights, self.kernel.scale) if is_enough else None

    def _record(
        self, number: int, pairs: Correspondences, weighed: Weighed, T: FloatArray, motion: float, began: float
    ) -> Iteration:
        return Iteration(
            number=number,
            stage=self.stage,
            points=len(pairs.distances),
            pairs=weighed.used,
            inlier_fraction=weighed.total / pairs.scan.represented,
            rms=math.sqrt(weighed.mean_square),
            kernel_scale=self.kernel.scale,
            energy=weighed.energy,
            turn_rad=single_pose.angle_between(pairs.T_target_source, T),
            motion=motion,
            seconds=time.perf_counter() - began,
            T_target_source=T,
        )


def _pose_by(estimator: Estimator, pairs: Correspondences, weights: FloatArray, scale: float) -> FloatArray | None:
    """Pose that an estimator makes of weighted correspondences, (4, 4); None where they fix none."""
    try:
        return estimator(pairs, weights, scale).T_target_source
    except DegenerateGeometryError:
        return None


def weighed_step(
    pairs: Correspondences, kernel: Kernel, rejectors: Sequence[Weight], estimator: Estimator
) -> tuple[Weighed, FloatArray | None] | None:
    """Weights of correspondences and the pose of least cost, (4, 4), None where they fix none, in one call.

    None where a loop has other parts, or many rows, which are weighed on several threads.
    """
    if len(pairs.scan) > CHUNK_ROWS or estimator not in (surfaces_to_surfaces, cells_to_cells):
        return None
    mixture = MixtureWeights.of(kernel, rejectors)
    return None if mixture is None else _in_one_pass(pairs, mixture, is_last=estimator is cells_to_cells)


def _in_one_pass(
    pairs: Correspondences, mixture: MixtureWeights, *, is_last: bool
) -> tuple[Weighed, FloatArray | None]:
    from dqreg.kernels.steps.plane_pass import Stepping, plane_pass
    from dqreg.kernels.steps.weighing import SUMS
    from dqreg.kernels.threads import as_plain, ask_clock

    ask_clock()
    scan, found = pairs.scan, pairs.closest
    of_source = scan.points, pairs.moved, scan.normals, scan._rejecting_normals, scan._variances, *counted(scan)
    variances = NOTHING if found.variances is None else found.variances
    of_target = found.points, found.normals, found.distances, variances
    plain = [as_plain(column) for column in (pairs.T_target_source, *of_source, *of_target)]
    limits = (
        mixture.limits(pairs),
        lowering_of(pairs, is_last=is_last),
        Stepping(MIN_PLANES, *OF_BEND, MAX_STEPS, *OF_NEWTON),
    )
    (weights, lowered), sums, T = np.zeros((2, len(scan))), np.zeros((1, SUMS)), np.zeros((4, 4))
    more = flat_planes(pairs), as_plain(mixture.factors(pairs)), *limits, CHUNK_PAIRS
    given: Any = *plain, *more, weights, lowered, sums, T
    cost = plane_pass(*given)
    weighed = mixture.weighed(weights, sums)
    return weighed, _pose_by(points_only, pairs, lowered, mixture.kernel.scale) if math.isnan(cost) else T
