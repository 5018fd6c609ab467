"""Where a registration is: a `Fit`, and the one function that runs the loop and goes on from a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg._records import replaced
from dqreg.geometry import Mesh, PointCloud, prepare_scan
from dqreg.icp import (
    ESTIMATORS,
    Alignment,
    Correspondences,
    Icp,
    IcpSettings,
    Observer,
    Run,
    align_coarse_to_fine,
    find_correspondences,
    smallest_kernel_scale,
)
from dqreg.icp.correspondences import placed
from dqreg.icp.history import Iteration
from dqreg.icp.noise_by_face import weights_by_face
from dqreg.registration.constrained_motions import followed_by, inflation_of, own_normals
from dqreg.registration.evidence.even_correspondences import evenly_asked
from dqreg.registration.evidence.evidence import agreement_in_time, agreement_of
from dqreg.registration.evidence.other_objects import on_others
from dqreg.registration.options.constraints import PoseConstraints
from dqreg.registration.problem.derived_values import Derived, Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import Problem, SourceAndTarget
from dqreg.registration.problem.target_index import TargetIndex
from dqreg.rigid.twist import scaling_by
from dqreg.search.problem import SCENE_RATIO
from dqreg.solvers.robust import InlierMixture
from dqreg.trust import Evidence, Information, information_of

T = TypeVar("T")

# Rounds of EM that learn the mixture at a pose where the loop has not ended.
EM_ROUNDS = 30

ON_PART: Key[BoolArray] = Key()
AGREEMENT: Key[Evidence] = Key()
STRAIN_AXIS: Key[tuple[float, float, float]] = Key()
EVENLY_ASKED: Key[Correspondences] = Key()
INFORMATION: Key[Information] = Key(of_pose=True)
FOLLOWED: Key[float] = Key(of_pose=True)
INFLATION: Key[FloatArray | None] = Key(of_pose=True)


@dataclasses.dataclass(frozen=True)
class Fit:
    """A pose between the centred frames, how the loop came there, and what it was held to."""

    problem: Problem
    prepared: Prepared  # Scan and surface that the loop compares
    target: TargetIndex  # The problem's; of a part, with those faces alone that could be seen
    settings: IcpSettings
    constraints: PoseConstraints
    run: Alignment  # Pose, last correspondences and weights, mixture, history of all runs, status
    derived: Derived = dataclasses.field(default_factory=Derived, init=False, repr=False, compare=False)

    def begin(self, key: Key[T], make: Callable[[], T]) -> None:
        """Make beside the caller what will be asked for; under a time limit nothing is."""
        if self.problem.options.time_limit is None:
            self.derived.begin(key, make)

    @property
    def T_target_source(self) -> FloatArray:
        """The pose, (4, 4)."""
        return self.run.T_target_source

    @property
    def found(self) -> bool:
        """Whether there is a pose to speak of."""
        return self.run.found

    @property
    def is_late(self) -> bool:
        """Whether the time limit ended the loop: such a pose is not accepted, and little is asked of it."""
        return self.run.status == "time limit"

    @property
    def between_clouds(self) -> bool:
        """Whether the target is a cloud, as a scan is: it ends somewhere, and is known as badly."""
        return self.target.kind == "cloud"

    @property
    def may_be_moved(self) -> bool:
        """Whether another pose may be the answer: no method was chosen, and no motion is locked or known beforehand."""
        return self.problem.options.method == "auto" and not self.constraints.any

    @property
    def floor(self) -> float:
        """Smallest scale of the kernel, a length."""
        return smallest_kernel_scale(self.prepared.scan, self.prepared.surface)

    @property
    def has_border(self) -> bool:
        """Whether the target ends somewhere: a cloud, an open mesh."""
        geometry = self.target.geometry
        return not (isinstance(geometry, Mesh) and geometry.is_closed)

    @property
    def agreement(self) -> Evidence:
        """How well scan and target agree at the pose: what the verdict is made of, as far as the run tells it."""
        return self.derived.once(AGREEMENT, self._agreement)

    def begin_agreement(self) -> None:
        """Make it beside the caller."""
        self.begin(AGREEMENT, self._agreement)

    @property
    def strain_axis(self) -> tuple[float, float, float]:
        """Axis of a strain of the scan against a part, be it a fault or not; zeros for none."""
        return self.derived.once(STRAIN_AXIS, lambda: self._agreement(axis=True).stretched_along)

    def _agreement(self, *, axis: bool = False) -> Evidence:
        prepared, reach = self.prepared, self.settings.max_distance
        if self.problem.options.max_distance is not None:
            # A shorter one hides the points that speak against a pose.
            reach = self.problem.reach(prepared)
        asked = self.run, prepared.scan, prepared.surface, reach
        if self.is_late:
            return agreement_in_time(*asked, has_border=self.has_border)
        pairs, clouds = self.evenly_asked(), (self.problem.source.cloud, self.target.geometry)
        given = any(isinstance(cloud, PointCloud) and cloud.normals is not None for cloud in clouds)
        return agreement_of(
            *asked,
            has_border=self.has_border,
            pairs=pairs,
            axis=axis,
            given_normals=given,
            expected=0.0 if self.between_clouds else self.problem.options.expected_deviation or 0.0,
        )

    def evenly_asked(self) -> Correspondences:
        """Pairs at the pose of points that were drawn evenly, each of one point."""
        scan, surface, width = self.prepared.scan, self.prepared.surface, self.run.mixture.scale
        return self.derived.once(EVENLY_ASKED, lambda: evenly_asked(self.run, scan, surface, width))

    @property
    def is_scene(self) -> bool:
        """Whether the scan is so large that it shows more than the target, which is closed."""
        return not self.has_border and self.prepared.scan.diagonal > SCENE_RATIO * self.prepared.surface.diagonal

    @property
    def on_part(self) -> BoolArray:
        """Which points of the loop, (n,), are not of a scene's other objects: those may touch the target."""
        points, asked = self.run.pairs.scan.points, (self.prepared, self.problem.derived, self.T_target_source[None])
        if not self.is_scene:
            return np.ones(len(points), dtype=bool)
        return self.derived.once(ON_PART, lambda: ~on_others(*asked, points))

    @property
    def information(self) -> Information:
        """Information of the six motions from the last correspondences, the constraints and the prior."""
        return self.derived.once(INFORMATION, self._information)

    def begin_information(self) -> None:
        """Make it beside the caller."""
        self.begin(INFORMATION, self._information)

    def _information(self) -> Information:
        T, pairs, weights = self.T_target_source, self.run.pairs, self.run.weights
        prior = self.constraints.information(T)
        if self.settings.fine is not None and self.settings.fine is not ESTIMATORS["generalised"]:
            weights = weights_by_face(pairs, weights, self.run.mixture.scale)
        # What happens to touch the part holds none of its motions.
        if self.is_scene and (own := weights * self.on_part).any():
            weights = own
        # Where their feet were searched: the last step may be a long one along what nothing holds, and the normals of a
        # round part, all turned against their places, would hold that.
        sides = pairs.moved, pairs.closest.normals, placed(pairs, T)[1]
        information = information_of(
            *(*sides, weights, 0.5 * self.prepared.surface.diagonal, np.zeros(3)),
            self.problem.target.smooth_normals(pairs.closest),
            own=own_normals(self.prepared.surface, pairs),
            patchwise=True,
            counts=pairs.scan.counts,
            scattered=pairs.scan.scatter,
            allowed=self.constraints.allowed(T),
            prior=None if prior is None else self._beside_the_pairs(prior),
        )
        # What is said of the motions names points in the caller's frame.
        return replaced(information, centre=self.target.origin)

    def _beside_the_pairs(self, prior: FloatArray) -> FloatArray:
        # Standard deviations will be divided by the share that is followed, and inflated: those of the prior as well.
        lever, inflation = scaling_by(0.5 * self.prepared.surface.diagonal), self.inflation
        inflation = np.eye(6) if inflation is None else inflation * lever / lever[:, None]
        return np.asarray(inflation.T @ prior @ inflation / self.followed**2)

    @property
    def inflation(self) -> FloatArray | None:
        """What errors of the scaled twist are multiplied with, see `inflation_of`; None by nothing."""
        if self.is_late or self.problem.watch.is_over:
            return None
        lever = 0.5 * self.prepared.surface.diagonal
        return self.derived.once(INFLATION, lambda: inflation_of(self.run, lever, lambda T: self.beside(T).run))

    @property
    def followed(self) -> float:
        """Share of a displacement along the normals that residuals between two clouds follow; 1 on a mesh.

        Where noise is no less than the spacing, the nearest point is another one after it, again near: the cost is
        flatter than its Gauss-Newton Hessian says, and the pose errs by so much more.
        """
        return self.derived.once(FOLLOWED, lambda: followed_by(self.run, self.prepared.surface))

    def at(self, T: FloatArray) -> Fit:
        """The same run, ended at another pose: its correspondences, and the mixture that these teach."""
        pairs = find_correspondences(self.run.pairs.scan, self.prepared.surface, T)
        within = pairs.distances <= self.run.mixture.limit
        mixture = self.run.mixture.fit(pairs.distances[within], floor=self.floor, rounds=EM_ROUNDS)
        return self._ended(pairs, mixture, within)

    def beside(self, T: FloatArray) -> Fit:
        """The same, ended at a pose near by: its mixture, and what its rejectors left."""
        before, mixture = self.run.pairs, self.run.mixture
        pairs = find_correspondences(before.scan, self.prepared.surface, T, before)
        return self._ended(pairs, mixture, (pairs.distances <= mixture.limit) & (self.run.weights > 0.0))

    def late(self) -> Fit:
        """The fit where the time is up before it could be judged: little more is asked of its pose."""
        if not self.found:
            return self
        found = replaced(self, run=replaced(self.run, status="time limit"))
        self.derived.hand_on(found.derived)
        return found

    def _ended(self, pairs: Correspondences, mixture: InlierMixture, kept: BoolArray) -> Fit:
        weights = np.where(kept, mixture.weight(pairs.distances), 0.0)
        if pairs.scan.counts is not None:
            weights *= pairs.scan.counts
        run = replaced(self.run, T_target_source=pairs.T_target_source, pairs=pairs, weights=weights, mixture=mixture)
        return replaced(self, run=run)

    def resumed(
        self,
        start: FloatArray,
        kernel_scale: float | None,
        *,
        prepared: Prepared | None = None,
        target: TargetIndex | None = None,
        settings: IcpSettings | None = None,
    ) -> Fit:
        """The fit to which the loop comes from a pose, with this one's constraints and history.

        The basin is decided anew where no scale of the kernel is given to start with.
        """
        return coarse_to_fine(
            self.problem,
            prepared or self.prepared,
            start,
            replaced(settings or self.settings, first_kernel_scale=kernel_scale),
            self.constraints,
            target=target or self.target,
            before=self.run.history,
        )


def coarse_to_fine(
    problem: Problem,
    prepared: Prepared,
    start: FloatArray,
    settings: IcpSettings,
    constraints: PoseConstraints,
    *,
    target: TargetIndex | None = None,
    before: tuple[Iteration, ...] = (),
) -> Fit:
    """Run the loop from a pose between the centred frames: the only place that does.

    Numbers and records of iterations go on from those before; the constraints hold exactly; a status names the time
    limit where that ended the loop.
    """
    observe = problem.watch.watching(problem.observer(problem.options.observe))
    settings = replaced(settings, deadline=problem.watch.deadline)
    run = align_coarse_to_fine(prepared.scan, prepared.surface, start, settings, observe, first=len(before) + 1)
    run = replaced(
        run,
        T_target_source=constraints.project(run.T_target_source),
        history=before + run.history,
    )
    return Fit(problem, prepared, target or problem.target, settings, constraints, run)


def run_icp(icp: Icp, sides: SourceAndTarget, start: FloatArray, observe: Observer | None = None) -> Run:
    """One plain loop on all points, between centred frames; poses that go in and come out are the caller's."""
    scan, T = prepare_scan(sides.source.cloud), sides.to_centred(start)
    run = icp.run(scan, sides.target.surface, T, sides.observer(observe))
    history = sides.history_in_caller_frames(run.history)
    return replaced(run, T_target_source=sides.to_caller(run.T_target_source), history=history)
