"""Open3D's tensor multi-scale ICP.

Manual: the tutorial "ICP registration" under "Pipelines (Tensor)", section "Multi-Scale ICP Example": point to plane,
three voxel sizes that halve, correspondence distances of about three voxels, at most 20, 15 and 10 iterations.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._open3d import load_open3d
from dqreg.compare.engines.clouds import MAX_DISTANCE, open3d_cloud, source_cloud, target_cloud, task_size, with_normals
from dqreg.compare.engines.harness import SAME_LOOP_TOLERANCE, RunClock, initial_pose, no_pose, timed
from dqreg.compare.engines.open3d_icp import ROOM_SIZE_M, fitness_words
from dqreg.compare.engines.protocol import EngineOutput, Setting, Step, Task

# The tutorial's 0.1, 0.05 and 0.025 m are 1/45 and on of its room. 1/60 and on is more exact on a bracket (8e-6 of the
# size instead of 3e-5) in the same time; 1/90 is no better.
VOXEL_SHARES = (1.0 / 60.0, 1.0 / 120.0, 1.0 / 240.0)
# 0.3, 0.14 and 0.07 m with those voxels. "We may have a higher value [...] for the first coarse scale".
DISTANCE_SHARES = (MAX_DISTANCE, 2.8 * VOXEL_SHARES[1], 2.8 * VOXEL_SHARES[2])
# Both of the tutorial's criteria; the second is compared with a length, of a room of 4.5 m.
RELATIVE_CHANGES = (1e-4, 1e-5, 1e-6)
MAX_ITERATIONS = (20, 15, 10)


@dataclasses.dataclass(frozen=True)
class Open3dTensor:
    """Open3D's tensor multi-scale ICP, point to plane, float64 on the CPU; one scale of all points in the same loop."""

    name: str = "open3d tensor multi-scale"
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual", "same-loop")

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        load_open3d()
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings), (RuntimeError,))

    def _work(self, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        open3d = load_open3d()
        with clock.preparing():
            legacy = with_normals(open3d_cloud(target_cloud(task, settings)), settings, "target")
            target = open3d.t.geometry.PointCloud.from_legacy(legacy, open3d.core.float64)
        source = open3d.t.geometry.PointCloud(open3d.core.Tensor(source_cloud(task).points))
        settings.update(scales(task), estimation="point to plane", dtype="float64")
        registration = open3d.t.pipelines.registration
        stops = [
            registration.ICPConvergenceCriteria(*values)
            for values in zip(
                settings["relative_fitness"], settings["relative_rmse"], settings["max_iteration"], strict=True
            )
        ]
        steps: list[Step] = []

        def observe(values: Any) -> None:
            T = values["transformation"].numpy().copy()
            steps.append(Step(len(steps) + 1, clock.seconds, T))

        result = registration.multi_scale_icp(
            source,
            target,
            open3d.utility.DoubleVector(settings["voxel_sizes"]),
            stops,
            open3d.utility.DoubleVector(settings["max_correspondence_distances"]),
            open3d.core.Tensor(initial_pose(task)),
            registration.TransformationEstimationPointToPlane(),
            observe,
        )
        if result.fitness == 0.0:
            return no_pose("no correspondences (fitness 0)")
        T = np.array(result.transformation.numpy())
        self_report = fitness_words(result) + ("" if result.converged else ", not converged")
        return EngineOutput(T, self_report, iterations=len(steps), curve=tuple(steps))


def scales(task: Task) -> dict[str, Any]:
    """Voxels, distances and limits, coarse to fine."""
    size = task_size(task)
    if task.setting == "same-loop":
        return {
            "voxel_sizes": [-1.0],
            "max_correspondence_distances": [float(task.max_distance or MAX_DISTANCE * size)],
            "relative_fitness": [SAME_LOOP_TOLERANCE],
            "relative_rmse": [SAME_LOOP_TOLERANCE * size],
            "max_iteration": [int(task.max_iterations or MAX_ITERATIONS[0])],
        }
    return {
        "voxel_sizes": [share * size for share in VOXEL_SHARES],
        "max_correspondence_distances": [share * size for share in DISTANCE_SHARES],
        "relative_fitness": list(RELATIVE_CHANGES),
        "relative_rmse": [change / ROOM_SIZE_M * size for change in RELATIVE_CHANGES],
        "max_iteration": list(MAX_ITERATIONS),
    }
