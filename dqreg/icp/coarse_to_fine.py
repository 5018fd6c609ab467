"""From coarse to fine: few points and a wide kernel first, all points and a narrow kernel last.

The coarse level, a few thousand points, decides the basin. Its first schedule ("coarse") runs the loop to convergence
at each kernel scale: from 15 degrees and 5 % of the size off, on four CAD parts, 60 of 64 initial poses converged to
the true one, about half of them where the scale falls in every iteration. Where it leaves much of the scan
unexplained, that other schedule ("annealed") is tried as well, and the likelier explanation of the distances is kept:
it keeps a near initial pose from being drawn to a table that holds three quarters of the points. Between two clouds,
which show different sides of a body, planes are followed from the initial pose at a narrow scale beside both.

On the finer levels another estimator may take over: point-to-plane steps need 1 to 3 iterations where the closed form
with extrapolation needs 5 to 80, for the same pose. The convergence rate is estimated on few points, so that the level
of many points needs no further iteration to prove that it has converged.

Where the initial pose explains nearly all of the scan at a small kernel scale already, as in tracking, the basin is
found before the first step, and the run starts with the fine estimator.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg._records import replaced
from dqreg._statuses import INTERRUPTED
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.scan import Scan, with_planes
from dqreg.geometry.surface import Surface
from dqreg.icp.correspondences import Correspondences, find_correspondences
from dqreg.icp.full_resolution import FINE_SCHEDULE, MIDDLE_POINTS, finish, settled_on_rims, with_last_step
from dqreg.icp.level import EXPLAINED_FRACTION, NEAR_SCALE_DIAGONALS, AnnealingSchedule, IcpSettings, Level
from dqreg.icp.loop import Alignment, Observer, Run
from dqreg.solvers.robust import InlierMixture

# Points of the coarse level, where the basin is decided.
COARSE_POINTS = 2_000
# Fraction of the scan's noise (or spacing, where that is smaller: lines of a LiDAR make poor planes) below which a
# kernel scale would only separate lucky points from unlucky ones.
FLOOR_NOISE_RATIO = 0.3
# The same for exact data, in sizes of the part: float32 files round there.
FLOOR_DIAGONALS = 1e-7
# Distance, in diagonals of the target, beyond which a point is an outlier to a wide and to a narrow kernel alike; at
# least so many scales of the kernel.
OUTLIER_DIAGONALS, OUTLIER_SCALES = 0.05, 3.0
# Mean log-likelihood of a point by which an end is likelier than another: less is what a few points say.
MIN_LOG_LIKELIHOOD_GAIN = 0.01
# Scales of the kernel within which two ends are one.
SAME_END_SCALES = 0.5
# Share of the points that two views have in common at least, where an initial pose is near.
MIN_COMMON_SHARE = 0.25
# Points on which it is checked whether the initial pose is near already, and of the coarse level where it is.
NEAR_POINTS = 1_000

PATIENT_SCHEDULE = AnnealingSchedule("coarse", stages=30, iterations=None, rounds=30)
QUICK_SCHEDULE = AnnealingSchedule("annealed", stages=150, iterations=1, rounds=1)
# From an initial pose that is near, the scale is learned anew after each step.
TRACKING_SCHEDULE = replaced(FINE_SCHEDULE, iterations=1)


def align_coarse_to_fine(
    scan: Scan, surface: Surface, start: FloatArray, plan: IcpSettings, observe: Observer | None = None, first: int = 1
) -> Alignment:
    """Run the loop from coarse to fine; iterations are numbered from the first on."""
    finest = min(plan.finest or len(scan), len(scan))
    counts = [count for count in (COARSE_POINTS, MIDDLE_POINTS) if 2 * count <= finest] + [finest]
    # Where the start is near, there is no basin to decide on any more.
    some, floor = scan.thinned(min(NEAR_POINTS, counts[0])), smallest_kernel_scale(scan, surface)
    few = Level(some, surface, plan, floor, last=len(counts) == 1)
    mixture, seen = _mixture_at_start(few, start)
    if mixture is None:
        # The basin is decided by normals too, at each point of the level.
        scan = with_planes(scan, COARSE_POINTS)
        run, level = _coarse_end(replaced(few, scan=scan.thinned(counts[0])), start, observe, first)
    else:
        if few.last:
            few, seen = replaced(few, scan=scan.thinned(counts[0])), None
        run = _near(few, None).descend(mixture, start, TRACKING_SCHEDULE, observe, first, before=seen)
        level = _near(few, run)
        # Planes lead from few points to all of them in a step or two: a level between would cost more than it saves.
        counts = [counts[0], *counts[1:][-1:]] if level.plan.fine is not None else counts
    run = finish(level, scan, counts[1:], run, observe)
    return with_last_step(level, plan, settled_on_rims(level, run, observe), observe)


def _coarse_end(level: Level, start: FloatArray, observe: Observer | None, first: int) -> tuple[Alignment, Level]:
    """End of the coarse level, with the fine estimator where there is one, and that level as the finer ones go on."""
    if level.plan.fine is None:
        run = _Basin.find(level, start, observe, first).run
        return run, _near(level, run)
    run, near = _in_basin(level, start, observe, first)
    if run.ended_early or not isinstance(level.surface, CloudSurface):
        return run, near
    return _or_at_narrow_kernel(level, start, run, near, observe)


def _or_at_narrow_kernel(
    level: Level, start: FloatArray, run: Alignment, near: Level, observe: Observer | None
) -> tuple[Alignment, Level]:
    """The end of a coarse level between two clouds, or where planes alone lead from the start at a narrow kernel.

    What one cloud shows and the other lacks draws a wide kernel away: it takes the thickness of a plate for noise, and
    moves two views that have little in common on top of each other. A narrow one falls at once, and finds one side of
    the plate, or is held until the pose rests, which walls that few points show may need.
    """
    history, best = run.history, run
    narrow = _Narrow.at(_near(level, None), start, level.floor)
    for is_held in (False, True):
        found = narrow.descend(observe, history[-1].number + 1, is_held=is_held)
        history += found.history
        if found.status in INTERRUPTED:
            return replaced(best, status=found.status, history=history), near
        apart = level.scan._spread.motion(best.T_target_source, found.T_target_source)
        if _is_near(level, best.mixture) and apart <= SAME_END_SCALES * best.mixture.scale:
            # Both ways lead to one place.
            break
        found_near = _near(level, found)
        if not found.ended_early and _is_likelier((found_near, found), (near, best)):
            best, near = found, found_near
    return replaced(best, history=history), near


@dataclasses.dataclass(frozen=True)
class _Narrow:
    """What leads between two clouds by planes alone from a start, at a narrow kernel."""

    level: Level
    before: Correspondences  # At the start
    widest: InlierMixture  # Of the kernels that are narrow
    closest: InlierMixture  # As narrow as what both views have in common is close, where that is less

    @staticmethod
    def at(level: Level, start: FloatArray, floor: float) -> _Narrow:
        """From a start, on a level of planes; no kernel is narrower than the floor."""
        before = find_correspondences(level.scan, level.surface, start)
        widest = NEAR_SCALE_DIAGONALS * level.surface.diagonal
        closest = min(widest, float(np.quantile(before.distances, MIN_COMMON_SHARE)))
        kernels = [InlierMixture.starting(max(scale, floor), level.plan.max_distance) for scale in (widest, closest)]
        return _Narrow(level, before, *kernels)

    def descend(self, observe: Observer | None, first: int, *, is_held: bool) -> Alignment:
        """The end where the kernel falls at once, or is held until the pose rests; with the history of both."""
        if not is_held:
            return self._fall(self.closest, self.before, observe, first)
        held = self.level.once(self.widest, FINE_SCHEDULE, observe, first, self.before)
        if held.status in INTERRUPTED:
            return held
        within = held.pairs.distances[held.pairs.distances <= self.level.plan.max_distance]
        learned = self.widest.fit(within, floor=self.level.floor, rounds=PATIENT_SCHEDULE.rounds)
        fallen = self._fall(learned, held.pairs, observe, first + len(held.history))
        return replaced(fallen, history=held.history + fallen.history)

    def _fall(self, mixture: InlierMixture, pairs: Correspondences, observe: Observer | None, first: int) -> Alignment:
        return self.level.descend(mixture, pairs.T_target_source, TRACKING_SCHEDULE, observe, first, before=pairs)


def _is_likelier(one: tuple[Level, Alignment], other: tuple[Level, Alignment]) -> bool:
    """Whether one end of the coarse level explains the scan better than another."""
    scale = max(run.mixture.scale for _, run in (one, other))
    limit = max(OUTLIER_SCALES * scale, OUTLIER_DIAGONALS * one[0].surface.diagonal)
    costs = [level.mean_nll(run, limit) for level, run in (one, other)]
    return costs[0] < costs[1] - MIN_LOG_LIKELIHOOD_GAIN


def _in_basin(level: Level, start: FloatArray, observe: Observer | None, first: int) -> tuple[Alignment, Level]:
    basin = _Basin.find(level, start, observe, first, hasty=True)
    run, near = _refined(level, basin.run, observe)
    if run.ended_early or basin.is_whole or near.explains(run, run.mixture):
        return run, near
    # It looked near at a wide kernel, and at a narrow one much of the scan is left over: a wrong basin, or strays.
    whole = _Basin.find(level, start, observe, run.next_number, patient=basin.patient)
    slow, slow_near = _refined(level, whole.run, observe)
    history = run.history + slow.history
    if not slow.ended_early and slow_near.mean_nll(slow) < near.mean_nll(run):
        run, near = slow, slow_near
    status = slow.status if slow.status in INTERRUPTED else run.status
    return replaced(run, history=history, status=status), near


def _mixture_at_start(level: Level, start: FloatArray) -> tuple[InlierMixture | None, Correspondences | None]:
    """Width and share to go on with at once, where the start is known to be near or is seen to be; what was seen."""
    plan = level.plan
    if plan.first_kernel_scale is not None:
        return InlierMixture.starting(max(plan.first_kernel_scale, level.floor), plan.max_distance), None
    if plan.fine is None:
        return None, None
    pairs = find_correspondences(level.scan, level.surface, start)
    distances = pairs.distances
    within = distances[distances <= plan.max_distance]
    if len(within) < EXPLAINED_FRACTION * len(distances):
        return None, None
    learned = _widest(level).fit(within, floor=level.floor, rounds=PATIENT_SCHEDULE.rounds)
    explained = learned.inlier_fraction * len(within) >= EXPLAINED_FRACTION * len(distances)
    return learned if explained and _is_near(level, learned) else None, pairs


def _widest(level: Level) -> InlierMixture:
    return InlierMixture.widest(level.plan.max_distance, level.floor)


def _is_near(level: Level, mixture: InlierMixture) -> bool:
    return mixture.scale <= NEAR_SCALE_DIAGONALS * level.surface.diagonal


def _refined(level: Level, run: Alignment, observe: Observer | None) -> tuple[Alignment, Level]:
    # The coarse points are gone over again where a new estimator takes over: it is the cheapest place to do so.
    near = _near(level, run)
    if run.ended_early:
        return run, near
    return near.descend(run.mixture, run.T_target_source, FINE_SCHEDULE, observe, run.next_number).after(run), near


def _near(level: Level, run: Run | None) -> Level:
    plan = level.plan
    if plan.fine is not None:
        # Planes of a mesh need so few steps that extrapolating them costs more than it saves; between two clouds each
        # step is about half of the one before, once the kernel is narrow.
        accelerate = plan.accelerate and isinstance(level.surface, CloudSurface)
        plan = replaced(plan, estimator=plan.fine, accelerate=accelerate)
    left = _left_by_inliers(level.scan, run) if run else np.inf
    return replaced(level, plan=plan, floor=smallest_kernel_scale(level.scan, level.surface, left), near=True)


def _left_by_inliers(scan: Scan, run: Run) -> float:
    """What planes leave at the inliers of a run, in the median; infinite where that is not known."""
    # Around a stray there is no plane: where they are many, the noise of the whole scan says nothing about the part's.
    residuals = scan.residuals[(run.weights > 0.5) & np.isfinite(scan.residuals)]
    return median(residuals) if len(residuals) else np.inf


def noise_on(scan: Scan, surface: Surface) -> float:
    """Noise of a scan that decides on a surface: between two clouds, what planes of its own points leave."""
    return scan.noise if scan.quiet is None or isinstance(surface, CloudSurface) else scan.quiet


def smallest_kernel_scale(scan: Scan, surface: Surface, most: float = np.inf) -> float:
    """Smallest width of the kernel for a scan on a target, a length; its noise is no more than that of some points."""
    noise = min(noise_on(scan, surface), scan.spacing, most)
    return max(FLOOR_NOISE_RATIO * noise, FLOOR_DIAGONALS * surface.diagonal)


@dataclasses.dataclass(frozen=True)
class _Basin:
    """The better of both schedules on one level, and what need not be run again."""

    run: Alignment
    patient: Alignment | None  # None where it was cut short
    is_whole: bool  # Whether neither was

    @staticmethod
    def find(
        level: Level,
        start: FloatArray,
        observe: Observer | None,
        first: int,
        *,
        hasty: bool = False,
        patient: Alignment | None = None,
    ) -> _Basin:
        """Run both schedules, the first unless it is known; in haste no farther than where the scan is explained."""
        mixture, is_cut = _widest(level), False

        def found(run: Run, mixture: InlierMixture) -> bool:
            nonlocal is_cut
            is_cut = _is_near(level, mixture) and level.explains(run, mixture)
            return is_cut

        enough, before = found if hasty else None, () if patient is None else patient.history
        if patient is None:
            patient = level.descend(mixture, start, PATIENT_SCHEDULE, observe, first, enough)
        whole = None if is_cut else patient
        if patient.status in INTERRUPTED or (hasty and found(patient, patient.mixture)):
            return _Basin(patient, whole, is_whole=False)
        quick = level.descend(
            mixture, start, QUICK_SCHEDULE, observe, first + len(patient.history) - len(before), enough
        )
        better = patient
        if not quick.ended_early and (patient.ended_early or level.mean_nll(quick) < level.mean_nll(patient)):
            better = quick
        status = quick.status if quick.status in INTERRUPTED else better.status
        history = patient.history[len(before) :] + quick.history
        return _Basin(replaced(better, status=status, history=history), whole, is_whole=not is_cut)
