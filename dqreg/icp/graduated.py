"""From a rough start to the last digit: wide kernels and few points first, narrow kernels and many points last.

The basin is decided on a few thousand points, by two schedules, and the better explanation of the distances is kept:

- patient: at each width the loop runs to convergence. From 15 degrees and 5 % of the size off, on four CAD parts,
  60 of 64 starts came home this way, about half of them where the width fell in every iteration.
- quick: the width falls in every iteration. A scan whose points belong to the table for three quarters is drawn to
  the table by the patient schedule; this one stays with a start that is near.

On the finer levels the pose is near, and an estimator of the plan's choice may take over: with points to planes they
need 2 to 5 iterations where the closed form with extrapolation needs 5 to 80, for the same pose.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry.prepare import Scan
from dqreg.geometry.surface import Surface
from dqreg.icp.kernels import InlierMixture
from dqreg.icp.loop import Observer, Run
from dqreg.icp.stage import Level, Plan, Schedule

# Points of the coarse level, where the basin is decided, and of the level between it and the last.
COARSE, MIDDLE = 2_000, 20_000
# Share of the scan's noise (or spacing, where that is smaller: lines of a LiDAR make poor planes) below which a width
# would only separate lucky points from unlucky ones.
NOISE_FLOOR = 0.3
# The same for exact data, in sizes of the part: float32 files round there.
EXACT_FLOOR = 1e-7

PATIENT = Schedule("patient", stages=30, iterations=None, rounds=30)
QUICK = Schedule("quick", stages=150, iterations=1, rounds=1)
FINE = Schedule("fine", stages=30, iterations=None, rounds=30)


def run_graduated(
    scan: Scan, surface: Surface, start: FloatArray, plan: Plan, observe: Observer | None = None
) -> tuple[Run, InlierMixture]:
    """Run the loop from coarse to fine.

    Parameters
    ----------
    scan : Scan
        Source with as many points as the last level shall use.
    surface : Surface
        Target.
    start : ndarray, (4, 4)
        Pose to begin with.
    plan : Plan
        Parts and limits.
    observe : callable, optional
        Called with each iteration of every stage; the run ends if it returns False.

    Returns
    -------
    Run
        The last stage, with the history of all, the dropped schedule's included.
    InlierMixture
        Width and share of inliers at the end.
    """
    counts = [count for count in (COARSE, MIDDLE) if 2 * count <= len(scan)] + [len(scan)]
    levels = [Level(scan.thinned(n), surface, plan, width_floor(scan, surface), n == counts[-1]) for n in counts]
    run, mixture = find_basin(levels[0], start, observe)
    near = dataclasses.replace(plan, estimator=plan.fine or plan.estimator)
    floor = width_floor(_judged_by_inliers(levels[0].scan, run), surface)
    for level in levels[1:] or (levels if plan.fine else []):
        if run.ended_early:
            break
        finer, mixture = dataclasses.replace(level, plan=near, floor=floor).descend(
            mixture, run.T_target_source, FINE, observe, len(run.history) + 1
        )
        run = dataclasses.replace(finer, history=run.history + finer.history)
    return run, mixture


def _judged_by_inliers(scan: Scan, run: Run) -> Scan:
    # Around a stray there is no plane: where they are many, the noise of the whole scan says nothing about the part's.
    residuals = scan.residuals[(run.weights > 0.5) & np.isfinite(scan.residuals)]
    return dataclasses.replace(scan, noise=min(float(np.median(residuals)), scan.noise)) if len(residuals) else scan


def width_floor(scan: Scan, surface: Surface) -> float:
    """Smallest width of the kernel for a scan on a target, a length.

    Parameters
    ----------
    scan : Scan
        Source, with its noise and spacing.
    surface : Surface
        Target, for its size.

    Returns
    -------
    float
        The floor, > 0.
    """
    return max(NOISE_FLOOR * min(scan.noise, scan.spacing), EXACT_FLOOR * surface.diagonal)


def find_basin(level: Level, start: FloatArray, observe: Observer | None = None) -> tuple[Run, InlierMixture]:
    """The better of both schedules on one level.

    Parameters
    ----------
    level : Level
        A few thousand points against the target.
    start : ndarray, (4, 4)
        Pose to begin with.
    observe : callable, optional
        Called with each iteration.

    Returns
    -------
    Run
        Its pose and last pairs, with the history of both.
    InlierMixture
        Its width and share.
    """
    wide = max(0.5 * level.plan.max_distance, level.floor)
    mixture = InlierMixture(wide, 0.5, level.plan.max_distance)
    patient, patient_mixture = level.descend(mixture, start, PATIENT, observe, 1)
    if patient.status == "stopped by observer":
        return patient, patient_mixture
    quick, quick_mixture = level.descend(mixture, start, QUICK, observe, len(patient.history) + 1)
    better, learned = patient, patient_mixture
    if not quick.ended_early and (
        patient.ended_early or level.surprise(quick_mixture, quick) < level.surprise(patient_mixture, patient)
    ):
        better, learned = quick, quick_mixture
    if quick.status == "stopped by observer":
        better = dataclasses.replace(better, status=quick.status)
    return dataclasses.replace(better, history=patient.history + quick.history), learned
