"""trimesh's `icp` and `mesh_other`, each with scale and reflection off, and each as it is shipped.

Manual: the documentation of ``trimesh.registration``; it recommends no preprocessing.
"""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.engines.clouds import source_cloud, subsampled, target_cloud, task_size
from dqreg.compare.engines.harness import RunClock, initial_pose, replay, silent, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.errors import InputError, load_package
from dqreg.geometry import Mesh

# Defaults of trimesh.registration.icp. The threshold is a squared length, compared with the change of the cost.
SHIPPED_THRESHOLD, SHIPPED_ITERATIONS = 1e-5, 20
# With scale and reflection off, the two open numbers are chosen in icp's favour: a threshold that does not depend on
# the unit, and iterations to reach it.
THRESHOLD_SQUARED_SHARE, MAX_ITERATIONS = 1e-12, 100
# What icp is given: its error after so many iterations is far above what more points would gain.
SOURCE_POINTS = 20_000
# `mesh_other` runs icp from eight poses; its own default is 500 points.
OTHER_POINTS, SHIPPED_OTHER_POINTS = 1_000, 500
FIRST_ITERATIONS, FINAL_ITERATIONS = 10, 50


@dataclasses.dataclass(frozen=True)
class TrimeshIcp:
    """trimesh's point-to-point `icp` between clouds; a mesh is sampled, which is far faster than its own search."""

    name: str  # Shown in tables
    shipped: bool  # Whether every parameter keeps its default, scale and reflection included
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual", "same-loop")

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        module = load_package("trimesh.registration", "trimesh")
        return timed(self, task, lambda clock, settings: self._work(module, task, clock, settings))

    def _work(self, module: ModuleType, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        with clock.preparing():
            target = target_cloud(task, settings).points
        source = source_cloud(task).points
        threshold = SHIPPED_THRESHOLD if self.shipped else THRESHOLD_SQUARED_SHARE * task_size(task) ** 2
        iterations = SHIPPED_ITERATIONS if self.shipped else MAX_ITERATIONS
        if task.setting == "same-loop":
            threshold, iterations = THRESHOLD_SQUARED_SHARE * task_size(task) ** 2, int(task.max_iterations or 0)
            settings["max_distance"] = "not supported: every correspondence counts, at any distance"
        else:
            settings.update(source_points=min(SOURCE_POINTS, len(source)), seed=task.seed)
            source = subsampled(source, SOURCE_POINTS, task.seed)
        settings.update(threshold=threshold, max_iterations=iterations, scale=self.shipped, reflection=self.shipped)

        def run(start: FloatArray, most: int) -> Pose:
            with silent():
                T, _, cost = module.icp(
                    source,
                    target,
                    initial=start,
                    threshold=threshold,
                    max_iterations=most,
                    scale=self.shipped,
                    reflection=self.shipped,
                )
            return Pose(T, float(cost))

        start = initial_pose(task)
        found = run(start, iterations)
        clock.stop()
        curve = replay(run, start, iterations, found.transformation) if task.curve else ()
        return EngineOutput(found.transformation, f"mean squared distance {found.cost:.4g}", curve=curve)


@dataclasses.dataclass(frozen=True)
class TrimeshMeshOther:
    """trimesh's `mesh_other`: principal axes of mesh and points, eight rotations, icp from each; no initial pose."""

    name: str  # Shown in tables
    shipped: bool  # Whether every parameter keeps its default, reflection included
    # trimesh's own search for closest points on a mesh.
    needs: tuple[str, ...] = ("rtree",)
    needs_initial_pose: bool = False
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        if not isinstance(task.target, Mesh):
            raise InputError(f"{self.name} aligns a mesh; the target is a cloud of points. Use a mesh as the target")
        load_package("rtree", "rtree")
        module, trimesh = load_package("trimesh.registration", "trimesh"), load_package("trimesh", "trimesh")
        part = task.target
        return timed(self, task, lambda clock, settings: self._work(module, trimesh, part, task, clock, settings))

    def _work(
        self, module: ModuleType, trimesh: ModuleType, part: Mesh, task: Task, clock: RunClock, settings: dict[str, Any]
    ) -> EngineOutput:
        with clock.preparing():
            mesh = trimesh.Trimesh(part.vertices.copy(), part.faces.copy(), process=False)
        most = SHIPPED_OTHER_POINTS if self.shipped else OTHER_POINTS
        points = subsampled(source_cloud(task).points, most, task.seed)
        used: dict[str, Any] = {
            "scale": False,
            "reflection": self.shipped,
            "icp_first": FIRST_ITERATIONS,
            "icp_final": FINAL_ITERATIONS,
            "threshold": SHIPPED_THRESHOLD if self.shipped else THRESHOLD_SQUARED_SHARE * task_size(task) ** 2,
        }
        settings.update(used, start="not used", source_points=len(points), seed=task.seed)
        with silent():
            T_source_target, cost = module.mesh_other(mesh, points, **used)
        return EngineOutput(np.linalg.inv(T_source_target), f"cost {float(cost):.4g}")


@dataclasses.dataclass(frozen=True)
class Pose:
    """Result of one call of icp."""

    transformation: FloatArray  # (4, 4): The pose
    cost: float  # Mean squared distance of the correspondences
