"""One level of points: run the loop at one kernel scale, learn the next scale, until it settles."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.scan import Scan
from dqreg.geometry.surface import Surface
from dqreg.icp.acceleration import TOLERATED_RISE, TOLERATED_RISE_OF_PLANES
from dqreg.icp.correspondences import ALL_ROWS, Correspondences, slid_distances
from dqreg.icp.estimators import Estimator
from dqreg.icp.history import Iteration
from dqreg.icp.loop import Alignment, Icp, Observer, Run, contraction_of
from dqreg.icp.rejectors import NormalAngle, WithinDistance, boundary_rejectors
from dqreg.icp.stopping import Stopping
from dqreg.solvers.robust import InlierMixture

# A stage is converged when it moves less than this fraction of its own kernel scale; where planes take over near the
# answer and nearly every point is explained, the next stage starts from anywhere within the scale.
STAGE_TOLERANCE_SCALES, EXPLAINED_TOLERANCE_SCALES = 0.03, 0.3
# The scale is settled when learning changes it by less than this factor; near the answer the pose hardly depends on it,
# and another stage would query all points again.
SETTLED_SCALE_RATIO, SETTLED_SCALE_RATIO_NEAR = 0.97, 0.9
# The largest fall of the scale from one stage to the next.
MIN_SCALE_RATIO = 0.5
# Points from which on the sampling error, not the scale, limits how far a level is worth converging; and to which
# fraction of that error.
SAMPLING_LIMITED_POINTS = 2_000
SAMPLING_ERROR_SHARE = 0.6
# Fraction of the points beyond which a scan counts as explained.
EXPLAINED_FRACTION = 0.9
# The same, in widths, where few of the points hold a motion.
PATIENT_TOLERANCE_SCALES = 1e-3
# On the last level matches slide on a part's faces until they are this share of the width from where they were asked.
MAX_SLIDE_SCALES = 0.3
# Distances from which scale and inlier fraction are learned: good to one per cent.
LEARNING_POINTS = 5_000
# Stages that may end without having converged; after that, more of them only cost time.
MAX_UNFINISHED_STAGES = 1
# The basin is found where the scan is explained at a kernel scale below that fraction of the target's size.
NEAR_SCALE_DIAGONALS = 0.01
# Beyond this the two normals are of different faces, once the pose is near.
NEAR_ANGLE_RAD = np.deg2rad(60.0)


@dataclasses.dataclass(frozen=True)
class IcpSettings:
    """What an alignment from coarse to fine needs to know beyond the data."""

    estimator: Estimator  # From weighted pairs to a pose, where the basin is decided
    max_distance: float  # Largest distance of a pair, target units
    fine: Estimator | None = None  # Estimator of the finer levels, where the pose is near; None keeps the same
    last: Estimator | None = None  # Estimator of one last step on a mesh, after the fine one; None for no such step
    cells: Estimator | None = None  # Estimator of the last level between clouds; None keeps the fine one
    finest: int | None = None  # Points of the last level; None takes all
    # Width of the kernel to begin with, for a start that is known to be near; None begins at half of the largest
    # distance and decides the basin
    first_kernel_scale: float | None = None
    # Largest angle between normals once the width is small; at the start it is 90 degrees
    max_angle_rad: float = NEAR_ANGLE_RAD
    accelerate: bool = True  # Whether the loop extrapolates
    stopping: Stopping = Stopping()  # Tolerance of the last stage and the iteration limit of each stage
    # When the finer levels end, by `time.perf_counter`, be it within an iteration
    deadline: float = np.inf


@dataclasses.dataclass(frozen=True)
class AnnealingSchedule:
    """How fast the width may fall."""

    name: str  # Shown with each iteration
    stages: int  # Widths at most
    iterations: int | None  # Iterations at each width at most; None leaves it to the plan
    rounds: int  # EM rounds between two widths


@dataclasses.dataclass(frozen=True)
class Level:
    """Points of one level, against the target."""

    scan: Scan  # The points
    surface: Surface  # The target
    plan: IcpSettings  # Parts and limits
    floor: float  # Smallest width
    last: bool  # Whether there is no finer level to come
    contraction: float = 1.0  # See `Stopping`
    near: bool = False  # Whether the basin is found, and the width may fall as fast as the distances allow
    patient: bool = False  # Whether the loop goes on until little moves that few points hold

    def descend(
        self,
        mixture: InlierMixture,
        start: FloatArray,
        schedule: AnnealingSchedule,
        observe: Observer | None,
        first: int,
        enough: Callable[[Run, InlierMixture], bool] | None = None,
        before: Correspondences | None = None,
    ) -> Alignment:
        """Run at falling widths until the width settles."""
        run = self._run(mixture, start, schedule, observe, first, before)
        history = run.history
        unfinished = 0
        for _ in range(schedule.stages - 1):
            unfinished += schedule.iterations is None and run.status != "converged"
            if run.ended_early or unfinished > MAX_UNFINISHED_STAGES:
                break
            learned = self._learned(mixture, run, schedule)
            factor = SETTLED_SCALE_RATIO_NEAR if self.near else SETTLED_SCALE_RATIO
            settled = factor * mixture.scale <= learned.scale <= mixture.scale / factor
            mixture = replaced(learned, scale=max(learned.scale, self._steepest(learned, run) * mixture.scale))
            to_come = run.history[-1].motion * self._contraction(history)
            if settled and to_come <= self._convergence(mixture):
                run = replaced(run, status="converged")
                break
            if enough is not None and enough(run, learned):
                mixture = learned
                break
            run = self._run(mixture, run.T_target_source, schedule, observe, first + len(history), run.pairs)
            history += run.history
        else:
            if schedule.iterations is not None and run.status == "iteration limit":
                # Not a limit of the caller's: the steps at the last widths became no shorter.
                run = replaced(run, status="stalled")
        return Alignment.of(replaced(run, history=history), mixture, near=self.near)

    def once(
        self,
        mixture: InlierMixture,
        schedule: AnnealingSchedule,
        observe: Observer | None,
        first: int,
        pairs: Correspondences,
    ) -> Alignment:
        """Run at one width from pairs of this level's points, without learning another width."""
        run = self._run(mixture, pairs.T_target_source, schedule, observe, first, pairs)
        return Alignment.of(run, mixture, near=self.near)

    def explains(self, run: Run, mixture: InlierMixture) -> bool:
        """Whether nearly all points of a run belong to the inliers of a mixture."""
        return bool(
            mixture.inlier_fraction * np.count_nonzero(run.weights > 0.0) >= EXPLAINED_FRACTION * len(run.weights)
        )

    def mean_nll(self, run: Alignment, limit: float = np.inf) -> float:
        """Mean negative log-likelihood of the distances at the end of a run: the lower, the better it explains them.

        Where a limit is given, distances beyond it are those of outliers.
        """
        near, mixture = (run.weights > 0.0) & (run.pairs.distances <= limit), run.mixture
        mixture = replaced(mixture, limit=min(mixture.limit, limit))
        learned = mixture.fit(run.pairs.distances[near], floor=self.floor, rounds=100)
        return learned.mean_nll(run.pairs.distances[near], rejected=int(np.count_nonzero(~near)))

    def _run(
        self,
        mixture: InlierMixture,
        start: FloatArray,
        schedule: AnnealingSchedule,
        observe: Observer | None,
        first: int,
        before: Correspondences | None = None,
    ) -> Run:
        plan = self.plan
        iterations = schedule.iterations or plan.stopping.iterations
        # Far from the answer normals say little; the angle closes as the width does.
        angle = min(max(math.pi * mixture.scale / plan.max_distance, plan.max_angle_rad), math.pi / 2)
        of_cells = plan.cells if self.last and self.near else None
        icp = Icp(
            estimator=of_cells or plan.estimator,
            kernel=mixture,
            rejectors=(
                WithinDistance(plan.max_distance),
                NormalAngle(angle),
                *(boundary_rejectors(self.surface, mixture.scale) if self.near else ()),
            ),
            stopping=replaced(
                plan.stopping,
                convergence=self._convergence(mixture),
                iterations=iterations,
                contraction=self.contraction,
            ),
            accelerate=self._extrapolates(mixture) and iterations > 1,
            tolerated=TOLERATED_RISE_OF_PLANES if self.near and plan.fine is not None else TOLERATED_RISE,
            stage=schedule.name,
            slides=self._slides(mixture),
        )
        return icp.run(self.scan, self.surface, start, observe, first, before)

    def _convergence(self, mixture: InlierMixture) -> float:
        width = mixture.scale / self.surface.diagonal
        # How well so many points of this width can place the part at all: no use in going on far below it. Between the
        # rings of a LiDAR distances are those of the rings, and heights over the planes are what places it.
        if isinstance(self.surface, CellSurface) and self.surface.has_wide:
            width = min(width, max(self.scan.noise, self.floor) / self.surface.diagonal)
        placed = width / float(np.sqrt(self.scan.represented))
        if self.patient:
            return min(PATIENT_TOLERANCE_SCALES * width, SAMPLING_ERROR_SHARE * placed)
        if self.last:
            return max(self.plan.stopping.convergence, SAMPLING_ERROR_SHARE * placed)
        if len(self.scan) > SAMPLING_LIMITED_POINTS:
            return SAMPLING_ERROR_SHARE * placed
        planes = self.near and self.plan.fine is not None
        explained = planes and mixture.inlier_fraction >= EXPLAINED_FRACTION
        return (EXPLAINED_TOLERANCE_SCALES if explained else STAGE_TOLERANCE_SCALES) * width

    def _extrapolates(self, mixture: InlierMixture) -> bool:
        # Where planes take over at a wide kernel, between two clouds, faces that only one of them shows draw as much as
        # those of both: extrapolated steps left the basin of the start, with a fifth in common 13 times of 14.
        is_wide = mixture.scale > NEAR_SCALE_DIAGONALS * self.surface.diagonal
        return self.plan.accelerate and not (is_wide and self.near and self.plan.fine is not None)

    def _slides(self, mixture: InlierMixture) -> float:
        # The level before has seen to the faces: after the first step on all points of a part, what is left is small
        # against the noise, and only matches within that of an edge would change.
        is_last = self.last and self.near and not self.patient and self.plan.fine is not None
        slides = is_last and len(self.scan) > SAMPLING_LIMITED_POINTS and isinstance(self.surface, MeshSurface)
        return MAX_SLIDE_SCALES * mixture.scale / self.surface.diagonal if slides else 0.0

    def _learned(self, mixture: InlierMixture, run: Run, schedule: AnnealingSchedule) -> InlierMixture:
        pairs, rows, is_kept = run.pairs, ALL_ROWS, run.weights > 0.0
        count = int(np.count_nonzero(is_kept))
        # Where nothing is left out, as a rule, nothing is picked.
        if count < len(run.weights) or count > LEARNING_POINTS:
            kept = np.flatnonzero(is_kept)
            rows = kept[sample_rows(count, LEARNING_POINTS)] if count > LEARNING_POINTS else kept
        # Near the answer the last step is all that is wrong with the distances.
        if self.near:
            distances = slid_distances(pairs, run.T_target_source, rows)
        else:
            distances = pairs.distances[rows] if len(rows) else pairs.distances
        return mixture.fit(distances, floor=self.floor, rounds=schedule.rounds)

    def _contraction(self, history: tuple[Iteration, ...]) -> float:
        # Two steps from a start that is near show how fast they shrink.
        shown = contraction_of(history) if self.near else None
        return self.contraction if shown is None else min(self.contraction, shown)

    def _steepest(self, learned: InlierMixture, run: Run) -> float:
        # Where nearly every point is explained, there is nothing that a slower fall could still win over.
        return 0.0 if self.near and self.explains(run, learned) else MIN_SCALE_RATIO
