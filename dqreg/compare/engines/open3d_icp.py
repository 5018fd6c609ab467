"""Open3D's legacy ICP: point-to-point, point-to-plane, symmetric, generalised; and its NDT.

Manual: the tutorials "ICP registration" and "Normal Distributions Transform" of Open3D's documentation. Both work on
raw clouds in metres, of a living room whose bounding box has a diagonal of about 4.5 m; their lengths are taken over
as fractions of that, so that a part in millimetres is treated as the tutorial treats its room.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.compare.engines.clouds import MAX_DISTANCE, open3d_cloud, source_cloud, target_cloud, task_size, with_normals
from dqreg.compare.engines.harness import SAME_LOOP_TOLERANCE, RunClock, initial_pose, no_pose, replay, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.errors import MissingDependencyError

Method = Literal["point-to-point", "point-to-plane", "symmetric", "generalized"]

ROOM_SIZE_M = 4.5
# Default of ICPConvergenceCriteria; both are compared with absolute differences, the second with a length.
RELATIVE_FITNESS = 1e-6
RELATIVE_RMSE = 1e-6 / ROOM_SIZE_M
# Default of ICPConvergenceCriteria, enough for every method with normals. For point-to-point the tutorial raises it to
# 2000 ("can be changed to allow more computation time and to improve the results further").
ITERATIONS: dict[str, int] = {"point-to-point": 2000, "point-to-plane": 30, "symmetric": 30, "generalized": 30}
# Tukey's constant in standard deviations of the noise, which the tutorial "Robust kernels" takes as known; here it is
# 1.4826 times the median distance from the planes after the last stage.
TUKEY_CONSTANT, MEDIAN_TO_SIGMA = 4.685, 1.4826


@dataclasses.dataclass(frozen=True)
class Open3dIcp:
    """One of Open3D's legacy ICP methods."""

    name: str  # Shown in tables
    method: Method  # Which one
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual", "same-loop")
    stages: tuple[float, ...] = ()  # Maximum distances as fractions of the size, one run each; () for one run
    robust: bool = False  # Whether a last run has Tukey's kernel

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        registration = load_open3d().pipelines.registration
        if self.method == "symmetric" and not hasattr(registration, "registration_symmetric_icp"):
            raise MissingDependencyError("symmetric ICP came with Open3D 0.20; run: pip install --upgrade open3d-cpu")
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings), (RuntimeError,))

    def _work(self, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        size = task_size(task)
        with clock.preparing():
            target = open3d_cloud(target_cloud(task, settings))
            if self.method in ("point-to-plane", "symmetric"):
                with_normals(target, settings, "target")
        source = open3d_cloud(source_cloud(task))
        if self.method == "symmetric":
            with_normals(source, settings, "source")
        settings.update(criteria(task, size, ITERATIONS[self.method]))
        if self.stages:
            return self._staged(source, target, task, size, settings)
        settings["max_correspondence_distance"] = max_distance(task, size)

        def run(start: FloatArray, iterations: int) -> Any:
            # A copy: a replay must not change the settings of the run.
            return self._call(source, target, start, {**settings, "max_iteration": iterations}, settings)

        start, most = initial_pose(task), settings["max_iteration"]
        result = run(start, most)
        clock.stop()
        if result.fitness == 0.0:
            return no_pose("no correspondences (fitness 0)")
        T = np.array(result.transformation)
        return EngineOutput(T, fitness_words(result), curve=replay(run, start, most, T) if task.curve else ())

    def _staged(self, source: Any, target: Any, task: Task, size: float, settings: dict[str, Any]) -> EngineOutput:
        """One run after the other, each within a smaller distance."""
        distances = settings["max_correspondence_distances"] = [share * size for share in self.stages]
        T = initial_pose(task)
        result: Any = None
        for within in distances:
            result = self._call(source, target, T, {**settings, "max_correspondence_distance": within}, settings)
            if result.fitness == 0.0:
                return no_pose("no correspondences (fitness 0)")
            T = np.array(result.transformation)
        if self.robust:
            settings["tukey_k"] = TUKEY_CONSTANT * MEDIAN_TO_SIGMA * _median_distance(source, target, result)
            result = self._call(source, target, T, {**settings, "max_correspondence_distance": distances[-1]}, settings)
        return EngineOutput(np.array(result.transformation), fitness_words(result))

    def _call(self, source: Any, target: Any, start: FloatArray, used: dict[str, Any], settings: dict[str, Any]) -> Any:
        registration = load_open3d().pipelines.registration
        within = used["max_correspondence_distance"]
        stop = registration.ICPConvergenceCriteria(
            used["relative_fitness"], used["relative_rmse"], used["max_iteration"]
        )
        if self.method == "symmetric":
            return registration.registration_symmetric_icp(
                source, target, within, start, registration.TransformationEstimationSymmetric(), stop
            )
        if self.method == "generalized":
            # Default of TransformationEstimationForGeneralizedICP; covariances from normals or 20 neighbours, inside.
            settings["epsilon"] = 1e-3
            estimation = registration.TransformationEstimationForGeneralizedICP(settings["epsilon"])
            return registration.registration_generalized_icp(source, target, within, start, estimation, stop)
        if self.method == "point-to-plane":
            kernel = (registration.TukeyLoss(used["tukey_k"]),) if "tukey_k" in used else ()
            estimation = registration.TransformationEstimationPointToPlane(*kernel)
        else:
            settings["with_scaling"] = False
            estimation = registration.TransformationEstimationPointToPoint(settings["with_scaling"])
        return registration.registration_icp(source, target, within, start, estimation, stop)


@dataclasses.dataclass(frozen=True)
class Open3dNdt:
    """Open3D's Normal Distributions Transform; it has no correspondences and takes no part in the same loop."""

    name: str = "open3d ndt"
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        if not hasattr(load_open3d().pipelines.registration, "registration_ndt"):
            raise MissingDependencyError("NDT came with Open3D 0.20; run: pip install --upgrade open3d-cpu")
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings), (RuntimeError,))

    def _work(self, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        registration = load_open3d().pipelines.registration
        size = task_size(task)
        with clock.preparing():
            target = open3d_cloud(target_cloud(task, settings))
        # The tutorial downsamples the source to 0.04 m and uses voxels of 0.5 m, a ninth of its room. On a bracket,
        # 8 degrees off, voxels half as large did best among 1/8, 1/16, 1/32 and 1/64 of the size: one run of two
        # converged to the true pose.
        settings["source_voxel_size"] = 0.04 / ROOM_SIZE_M * size
        source = open3d_cloud(source_cloud(task)).voxel_down_sample(settings["source_voxel_size"])
        options = {
            "voxel_size": size / 16.0,
            # As in the tutorial.
            "min_points_per_voxel": 6,
            "covariance_regularization": 1e-6,
            "transformation_epsilon": 1e-6,
            "relative_objective": 1e-6,
            "max_iteration": 200,
            "outlier_threshold": 9.0,
            "neighbor_search_type": 1,
        }
        settings.update(options)
        option = registration.NormalDistributionsTransformOption(**options)
        result = registration.registration_ndt(source, target, option, initial_pose(task))
        if not result.fitness:
            return no_pose("fitness 0")
        return EngineOutput(np.array(result.transformation), fitness_words(result))


def criteria(task: Task, size: float, iterations: int) -> dict[str, Any]:
    """When ICP ends, under Open3D's own names."""
    if task.setting == "same-loop":
        return {
            "relative_fitness": SAME_LOOP_TOLERANCE,
            "relative_rmse": SAME_LOOP_TOLERANCE * size,
            "max_iteration": int(task.max_iterations or iterations),
        }
    return {
        "relative_fitness": RELATIVE_FITNESS,
        "relative_rmse": RELATIVE_RMSE * size,
        "max_iteration": iterations,
    }


def max_distance(task: Task, size: float) -> float:
    """Maximum correspondence distance."""
    if task.setting == "same-loop" and task.max_distance is not None:
        return float(task.max_distance)
    return MAX_DISTANCE * size


def _median_distance(source: Any, target: Any, result: Any) -> float:
    """Median distance of the matched points from the planes of their matches."""
    rows, matches = np.asarray(result.correspondence_set).T
    p = np.asarray(source.points)[rows] @ result.transformation[:3, :3].T + result.transformation[:3, 3]
    gaps = np.einsum("ij,ij->i", p - np.asarray(target.points)[matches], np.asarray(target.normals)[matches])
    return float(np.median(np.abs(gaps)))


def fitness_words(result: Any) -> str:
    """What Open3D reports about its own success."""
    return f"fitness {float(result.fitness):.4f}, inlier rmse {float(result.inlier_rmse):.4g}"
