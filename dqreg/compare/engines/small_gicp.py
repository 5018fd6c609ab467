"""small_gicp: ICP, point-to-plane, GICP and VGICP.

Manual: the README of koide3/small_gicp, "Usage (Python)", examples A and B, and the defaults of its functions. Its
lengths are those of a car's LiDAR in metres: downsampling to 0.25, correspondences up to 1.0, voxels of 1.0.
"""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any, Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.engines.clouds import MAX_DISTANCE, source_cloud, target_cloud, task_size
from dqreg.compare.engines.harness import SAME_LOOP_TOLERANCE, RunClock, initial_pose, silent, timed
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task
from dqreg.errors import load_package

# As a fraction of the size. On a bracket, 1/200 has an eighth to a half of the error of 1/100 for twice the time; 1/400
# has a quarter to two thirds of that for another two and a half times.
DOWNSAMPLING_SHARE = 1.0 / 200.0
# Points drawn from a mesh, a few for each voxel that holds any: 500,000 gain no accuracy and take 0.1 s more.
CAD_SAMPLES = 100_000
# The manual's voxels are four downsampling lengths (1.0 and 0.25); of 0.02, 0.05 and 0.1 of the size, 0.02 is best.
VOXEL_FACTOR = 4.0
# The manual's stopping rule: 0.1 degrees, and 1e-3 m with downsampling to 0.25 m. Finer ones gained nothing.
ROTATION_EPSILON = np.deg2rad(0.1)
TRANSLATION_EPSILON = 1e-3 / 0.25
# The default is 20; "ICP" needs more on parts, the others stop long before.
MAX_ITERATIONS = 100
# Default of `preprocess_points`.
NORMAL_NEIGHBOURS = 10


@dataclasses.dataclass(frozen=True)
class SmallGicp:
    """One of small_gicp's methods."""

    name: str  # Shown in tables
    method: Literal["ICP", "PLANE_ICP", "GICP", "VGICP"]  # ``registration_type`` of the manual
    needs: tuple[str, ...] = ("small-gicp",)
    needs_initial_pose: bool = True
    settings: tuple[Setting, ...] = ("manual", "same-loop")
    stages: tuple[float, ...] = ()  # Maximum distances as fractions of the size, one run each; () for one run
    downsampling_share: float = DOWNSAMPLING_SHARE
    samples: int = CAD_SAMPLES  # Points drawn from a mesh

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        gicp = load_package("small_gicp", "small-gicp")
        return timed(self, task, lambda clock, settings: self._work(gicp, task, clock, settings), (RuntimeError,))

    def _work(self, gicp: ModuleType, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        settings.update(limits(task, self.method, self.downsampling_share))
        if self.stages:
            del settings["max_correspondence_distance"]
            settings["max_correspondence_distances"] = [share * task_size(task) for share in self.stages]
        with silent():
            with clock.preparing():
                target, tree = preprocess(gicp, target_cloud(task, settings, self.samples).points, settings)
                goal = target
                if self.method == "VGICP":
                    goal = gicp.GaussianVoxelMap(settings["voxel_resolution"])
                    goal.insert(target)
            source, _ = preprocess(gicp, source_cloud(task).points, settings)
            kind = {} if self.method == "VGICP" else {"target_tree": tree, "registration_type": self.method}
            T, iterations = initial_pose(task), 0
            for within in settings.get("max_correspondence_distances") or [settings["max_correspondence_distance"]]:
                result = gicp.align(
                    goal,
                    source,
                    **kind,
                    init_T_target_source=T,
                    max_correspondence_distance=within,
                    num_threads=settings["num_threads"],
                    max_iterations=settings["max_iterations"],
                    rotation_epsilon=settings["rotation_epsilon"],
                    translation_epsilon=settings["translation_epsilon"],
                )
                T, iterations = np.array(result.T_target_source), iterations + int(result.iterations)
        ended = "converged" if result.converged else "not converged"
        self_report = f"{ended}, {result.num_inliers} of {source.size()} correspondences"
        return EngineOutput(T, self_report, iterations)


def limits(task: Task, method: str, downsampling_share: float = DOWNSAMPLING_SHARE) -> dict[str, Any]:
    """Every number of a run, under small_gicp's own names."""
    size = task_size(task)
    same = task.setting == "same-loop"
    epsilon = TRANSLATION_EPSILON * downsampling_share
    chosen: dict[str, Any] = {
        "registration_type": method,
        "downsampling_resolution": None if same else downsampling_share * size,
        "num_neighbors": NORMAL_NEIGHBOURS,
        "num_threads": task.threads,
        "max_correspondence_distance": float(task.max_distance or 0.0) if same else MAX_DISTANCE * size,
        "max_iterations": int(task.max_iterations or 0) if same else MAX_ITERATIONS,
        "rotation_epsilon": SAME_LOOP_TOLERANCE if same else float(ROTATION_EPSILON),
        "translation_epsilon": (SAME_LOOP_TOLERANCE if same else epsilon) * size,
    }
    if method == "VGICP":
        chosen["voxel_resolution"] = VOXEL_FACTOR * downsampling_share * size
    return chosen


def preprocess(gicp: ModuleType, points: FloatArray, settings: dict[str, Any]) -> tuple[Any, Any]:
    """A cloud with normals and covariances, and its tree."""
    if settings["downsampling_resolution"] is not None:
        cloud, tree = gicp.preprocess_points(
            points,
            downsampling_resolution=settings["downsampling_resolution"],
            num_neighbors=settings["num_neighbors"],
            num_threads=settings["num_threads"],
        )
        return cloud, tree
    cloud = gicp.PointCloud(points)
    tree = gicp.KdTree(cloud, num_threads=settings["num_threads"])
    gicp.estimate_normals_covariances(
        cloud, tree, num_neighbors=settings["num_neighbors"], num_threads=settings["num_threads"]
    )
    return cloud, tree
