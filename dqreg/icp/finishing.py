"""The finer levels, once the pose is near: the last digits, from as much of the scan as the plan has time for.

On a mesh, with points to planes, all points have their say for the price of few questions (see `gather`). Else each
level draws its points, and the last one draws those that say most.
"""

from __future__ import annotations

import dataclasses

from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.prepare import Scan
from dqreg.icp.favour import favoured_rows, value_of
from dqreg.icp.gather import gather, run_centres
from dqreg.icp.kernels import InlierMixture
from dqreg.icp.loop import Observer, Run
from dqreg.icp.stage import Level, Schedule

FINE = Schedule("fine", stages=30, iterations=None, rounds=30)
# Points of the level between the coarse and the last one.
MIDDLE = 10_000
# Where points are taken together, of the points that the plan has for its last level: one run of neighbours for so
# many, and one point that is asked about by itself for so many; and the shortest run.
RUNS, ALONE, SHORTEST = 6, 4, 4


def finish(
    level: Level, scan: Scan, counts: list[int], run: Run, mixture: InlierMixture, observe: Observer | None
) -> tuple[Run, InlierMixture]:
    """Go on from the coarse level to the last."""
    surface, finest = level.surface, level.plan.finest
    planes = level.plan.fine is not None and bool(run.history) and run.history[-1].stage == FINE.name
    # Where all points are asked for, each gets an answer of its own.
    long = finest is not None and len(scan) >= SHORTEST * (finest // RUNS)
    if counts and planes and long and finest is not None and isinstance(surface, MeshSurface):
        return _together(level, scan, surface, finest, run, mixture, observe)
    for count in counts:
        if run.ended_early:
            break
        level = _drawn(level, scan, count, last=count == counts[-1], so_far=run)
        run, mixture = _continued(level, run, mixture, observe)
    return run, mixture


def _together(
    level: Level,
    scan: Scan,
    surface: MeshSurface,
    finest: int,
    run: Run,
    mixture: InlierMixture,
    observe: Observer | None,
) -> tuple[Run, InlierMixture]:
    """All points: those on the face of their run of neighbours together, and a choice of the others one by one."""
    if run.ended_early:
        return run, mixture
    level = _after(level, run, scan.taken(run_centres(len(scan), finest // RUNS)[0]))
    run, mixture = _continued(level, run, mixture, observe)
    if run.ended_early:
        return run, mixture
    pairs = gather(scan, surface, run.pairs, run.weights, run.T_target_source, mixture.scale, finest // ALONE)
    level = dataclasses.replace(_after(level, run, pairs.scan), last=True)
    return _joined(run, level.once(mixture, FINE, observe, len(run.history) + 1, pairs)), mixture


def _continued(level: Level, run: Run, mixture: InlierMixture, observe: Observer | None) -> tuple[Run, InlierMixture]:
    finer, mixture = level.descend(mixture, run.T_target_source, FINE, observe, len(run.history) + 1)
    return _joined(run, finer), mixture


def _joined(run: Run, finer: Run) -> Run:
    return dataclasses.replace(finer, history=run.history + finer.history, earlier=(*run.earlier, run.pairs))


def _after(level: Level, run: Run, scan: Scan) -> Level:
    contraction = level.contraction if run.contraction is None else run.contraction
    return dataclasses.replace(level, scan=scan, contraction=contraction)


def _drawn(level: Level, scan: Scan, count: int, *, last: bool, so_far: Run) -> Level:
    if not so_far.history or so_far.history[-1].stage != FINE.name:
        # The last step was another estimator's.
        return dataclasses.replace(level, scan=scan.thinned(count), last=last)
    if level.plan.fine is not None and last and count < len(scan):
        places = scan.even_rows(len(level.scan))
        rows = favoured_rows(value_of(so_far.pairs, so_far.weights), places, len(scan), count)
        return dataclasses.replace(_after(level, so_far, scan.taken(rows)), last=last)
    return dataclasses.replace(_after(level, so_far, scan.thinned(count)), last=last)
