"""KISS-ICP's registration of a scan to its voxel map.

Manual: the configuration of PRBonn/kiss-icp ("in most of the cases it should be enough to use the default parameters
as is") and its pipeline `KissICP.register_frame`. Every length there follows from the range of the sensor, 100 m:
voxels of 1/100 of it, two of which are the first threshold.
"""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.engines.clouds import source_cloud, target_cloud, task_size
from dqreg.compare.engines.harness import RunClock, initial_pose, silent, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.errors import load_package

# MappingConfig: max_range / 100. We let the size of the task stand for the range; of 1/100, 1/50, 1/30, 1/20 and 1/10
# it is the best on a bracket.
VOXEL_SHARE = 1.0 / 100.0
# AdaptiveThresholdConfig: 2.0 m with voxels of 1.0 m.
SIGMA_VOXELS = 2.0
# RegistrationConfig: 1e-4, of a sum of a rotation in radians and a translation in metres, with voxels of 1.0 m.
CONVERGENCE_VOXELS = 1e-4
MAX_ITERATIONS = 500
POINTS_PER_VOXEL = 20


@dataclasses.dataclass(frozen=True)
class KissIcpMap:
    """KISS-ICP's robust point-to-point registration, once, against a map made of the target."""

    name: str = "kiss-icp map"
    needs: tuple[str, ...] = ("kiss-icp",)
    needs_initial_pose: bool = True
    # The map is its neighbour search, and its voxels limit the correspondence distance: with points and a distance from
    # outside one voxel holds all points, and a run takes a hundred times its usual seconds. Not the same loop.
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        modules = {name: load_package(f"kiss_icp.{name}", "kiss-icp") for name in ("mapping", "registration")}
        modules["voxelization"] = load_package("kiss_icp.voxelization", "kiss-icp")
        return timed(self, task, lambda clock, settings: self._work(modules, task, clock, settings), (RuntimeError,))

    def _work(self, kiss: dict[str, ModuleType], task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        settings.update(limits(task))

        def downsampled(points: FloatArray, voxel: float) -> FloatArray:
            down: FloatArray = kiss["voxelization"].voxel_down_sample(points, voxel)
            return down

        with silent():
            with clock.preparing():
                local_map = kiss["mapping"].VoxelHashMap(
                    voxel_size=settings["voxel_size"],
                    max_distance=settings["map_max_distance"],
                    max_points_per_voxel=settings["max_points_per_voxel"],
                )
                local_map.add_points(downsampled(target_cloud(task, settings).points, settings["map_downsampling"]))
            source = downsampled(source_cloud(task).points, settings["map_downsampling"])
            source = downsampled(source, settings["source_downsampling"])
            T = (
                kiss["registration"]
                .Registration(
                    max_num_iterations=settings["max_num_iterations"],
                    convergence_criterion=settings["convergence_criterion"],
                    max_num_threads=settings["max_num_threads"],
                )
                .align_points_to_map(
                    points=source,
                    voxel_map=local_map,
                    initial_guess=initial_pose(task),
                    max_correspondance_distance=settings["max_correspondence_distance"],
                    kernel=settings["kernel"],
                )
            )
        return EngineOutput(np.array(T), "")


def limits(task: Task) -> dict[str, Any]:
    """Every number of a run."""
    size = task_size(task)
    # The pipeline downsamples a frame to half a voxel for the map, and that to one and a half for the registration.
    voxel = VOXEL_SHARE * size
    return {
        "voxel_size": voxel,
        "map_downsampling": 0.5 * voxel,
        "source_downsampling": 1.5 * voxel,
        "max_points_per_voxel": POINTS_PER_VOXEL,
        "map_max_distance": size,
        "max_correspondence_distance": 3.0 * SIGMA_VOXELS * voxel,
        "kernel": SIGMA_VOXELS * voxel,
        "max_num_iterations": MAX_ITERATIONS,
        "convergence_criterion": CONVERGENCE_VOXELS * voxel,
        "max_num_threads": task.threads,
    }
