"""dqreg itself: `dqreg.register` with its defaults, and its bare loops, which separate the solver from the loop."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np

from dqreg._open3d import load_open3d
from dqreg.compare.engines.harness import SAME_LOOP_TOLERANCE, RunClock, initial_pose, no_pose, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Step, Task
from dqreg.geometry import PointCloud
from dqreg.icp import ESTIMATORS, NO_POSE, Icp, Stopping, WithinDistance
from dqreg.icp.history import Iteration
from dqreg.registration.fit.fit import run_icp
from dqreg.registration.options.options import Effort
from dqreg.registration.problem.problem import SourceAndTarget
from dqreg.registration.problem.target_index import index_target
from dqreg.registration.register import register
from dqreg.registration.target import prepare_target


@dataclasses.dataclass(frozen=True)
class Dqreg:
    """`dqreg.register` as a user calls it; a mesh is used as it is."""

    name: str = "dqreg"  # Shown in tables
    effort: Effort = "normal"  # Its only setting
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = False
    # Its loop goes from few points to many and counts iterations on each level: one cap cannot mean the same for it.
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        load_open3d()
        return timed(self, task, lambda clock, settings: _register(task, clock, settings, effort=self.effort))


@dataclasses.dataclass(frozen=True)
class DqregLoop:
    """dqreg with one estimator throughout: as its manual says, `dqreg.register` with that ``method``.

    In the same loop it is plain ICP, closest points and estimator in turn: no kernel, no weights, no levels, and
    acceleration only where the name says so.
    """

    name: str  # Shown in tables
    # The closed form on points and normals, on points alone, Arun's SVD, or points to planes
    method: Literal["dq", "dq-points", "svd", "plane"]
    accelerate: bool = False  # Same loop only: whether Anderson acceleration extrapolates
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual", "same-loop")

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        load_open3d()
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings))

    def _work(self, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        if task.setting == "manual":
            return _register(task, clock, settings, method=self.method)
        with clock.preparing():
            target = index_target(PointCloud(np.asarray(task.target_points), task.target_normals))
            _ = target.surface
        sides = SourceAndTarget.read(PointCloud(np.asarray(task.source_points)), target, seed=task.seed)
        settings.update(
            method=self.method,
            accelerate=self.accelerate,
            max_distance=float(task.max_distance or 0.0),
            max_iterations=int(task.max_iterations or 0),
            convergence=SAME_LOOP_TOLERANCE,
        )
        cap = settings["max_iterations"]
        loop = Icp(
            estimator=ESTIMATORS[self.method],
            rejectors=(WithinDistance(settings["max_distance"]),),
            stopping=Stopping(convergence=SAME_LOOP_TOLERANCE, iterations=cap, patience=cap),
            accelerate=self.accelerate,
        )
        steps: list[Step] = []

        def observe(record: Iteration) -> None:
            steps.append(Step(record.number, clock.seconds, record.T_target_source))

        run = run_icp(loop, sides, initial_pose(task), observe)
        if run.status in NO_POSE or not steps:
            return no_pose(run.status)
        return EngineOutput(run.T_target_source, run.status, len(run.history), tuple(steps))


def _register(task: Task, clock: RunClock, settings: dict[str, Any], **options: Any) -> EngineOutput:
    """`dqreg.register` on a task."""
    with clock.preparing():
        target = prepare_target(task.target)
        if task.start is None:
            _ = target.pairs
    steps: list[Step] = []

    def observe(record: Iteration) -> None:
        steps.append(Step(record.number, clock.seconds, record.T_target_source))

    result = register(task.source, target, task.start, seed=task.seed, observe=observe, **options)
    settings.update(result.settings)
    self_report = (
        f"{result.verdict.level}: {result.verdict.reasons[0]}" if result.verdict.reasons else result.verdict.level
    )
    return EngineOutput(result.T_target_source, self_report, len(result.history), tuple(steps))
