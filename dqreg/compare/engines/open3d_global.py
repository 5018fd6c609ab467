"""Open3D's global registration: FPFH features with RANSAC, or with FGR, then point-to-plane ICP on all points.

Manual: the tutorial "Global registration" of Open3D's documentation. All of its lengths are multiples of one voxel
size, 0.05 m in a room of about 4.5 m.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.compare.engines.clouds import open3d_cloud, source_cloud, target_cloud, task_size, with_normals
from dqreg.compare.engines.harness import RunClock, no_pose, timed
from dqreg.compare.engines.open3d_icp import RELATIVE_FITNESS, RELATIVE_RMSE, ROOM_SIZE_M, fitness_words
from dqreg.compare.engines.protocol import EngineOutput, Setting, Task

# As a fraction of the size. On a bracket, 1/90 found 4 of 4 poses with RANSAC and 2 of 4 with FGR; 1/50 and 1/30 found
# 4 and fewer.
VOXEL_SHARE = 0.05 / ROOM_SIZE_M
FGR_NAMES = (
    "maximum_correspondence_distance",
    "division_factor",
    "use_absolute_scale",
    "decrease_mu",
    "iteration_number",
    "tuple_scale",
    "maximum_tuple_count",
    "tuple_test",
)


@dataclasses.dataclass(frozen=True)
class Open3dGlobal:
    """FPFH features and RANSAC or FGR; the initial pose is not used."""

    name: str  # Shown in tables
    method: Literal["ransac", "fgr"]  # Which solver takes the matched features
    needs: tuple[str, ...] = ()
    needs_initial_pose: bool = False
    settings: tuple[Setting, ...] = ("manual",)

    def register(self, task: Task) -> EngineOutput:
        """Do the task; see `dqreg.compare.engines.Engine.register`."""
        load_open3d()
        return timed(self, task, lambda clock, settings: self._work(task, clock, settings), (RuntimeError,))

    def _work(self, task: Task, clock: RunClock, settings: dict[str, Any]) -> EngineOutput:
        open3d = load_open3d()
        size = task_size(task)
        settings.update(start="not used", voxel_size=VOXEL_SHARE * size, seed=task.seed)
        with clock.preparing():
            target = open3d_cloud(target_cloud(task, settings))
            target_down, target_features = features(target, settings, None)
            with_normals(target, settings, "target")
        source = open3d_cloud(source_cloud(task))
        viewpoint = None if source.has_normals() else task.source.viewpoint
        estimated = "estimated, signs arbitrary" if viewpoint is None else "towards viewpoint"
        settings["source_normals"] = "given" if source.has_normals() else estimated
        source_down, source_features = features(source, settings, viewpoint)
        open3d.utility.random.seed(task.seed)
        coarse = (ransac if self.method == "ransac" else fgr)(
            source_down, target_down, source_features, target_features, settings
        )
        if coarse.fitness == 0.0:
            return no_pose(f"{self.method}: fitness 0")
        fine = refined(source, target, coarse.transformation, size, settings)
        if fine.fitness == 0.0:
            return no_pose("refinement: no correspondences (fitness 0)")
        self_report = f"{fitness_words(fine)} ({self.method} alone: {fitness_words(coarse)})"
        return EngineOutput(np.array(fine.transformation), self_report)


def features(cloud: Any, settings: dict[str, Any], viewpoint: FloatArray | None) -> tuple[Any, Any]:
    """Downsampled cloud and its FPFH features."""
    open3d = load_open3d()
    voxel = settings["voxel_size"]
    settings.update(normal_radius=2.0 * voxel, normal_max_nn=30, feature_radius=5.0 * voxel, feature_max_nn=100)
    near = open3d.geometry.KDTreeSearchParamHybrid
    down = cloud.voxel_down_sample(voxel)
    down.estimate_normals(near(radius=settings["normal_radius"], max_nn=settings["normal_max_nn"]))
    if viewpoint is not None:
        down.orient_normals_towards_camera_location(viewpoint)
    found = open3d.pipelines.registration.compute_fpfh_feature(
        down, near(radius=settings["feature_radius"], max_nn=settings["feature_max_nn"])
    )
    return down, found


def ransac(source: Any, target: Any, source_features: Any, target_features: Any, settings: dict[str, Any]) -> Any:
    """RANSAC with the tutorial's numbers."""
    registration = load_open3d().pipelines.registration
    used = {
        "mutual_filter": True,
        "max_correspondence_distance": 1.5 * settings["voxel_size"],
        "ransac_n": 3,
        "edge_length_similarity": 0.9,
        "max_iteration": 100_000,
        "confidence": 0.999,
    }
    settings["ransac"] = used
    within = used["max_correspondence_distance"]
    return registration.registration_ransac_based_on_feature_matching(
        source,
        target,
        source_features,
        target_features,
        used["mutual_filter"],
        within,
        registration.TransformationEstimationPointToPoint(False),
        used["ransac_n"],
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(used["edge_length_similarity"]),
            registration.CorrespondenceCheckerBasedOnDistance(within),
        ],
        registration.RANSACConvergenceCriteria(used["max_iteration"], used["confidence"]),
    )


def fgr(source: Any, target: Any, source_features: Any, target_features: Any, settings: dict[str, Any]) -> Any:
    """Fast global registration with the tutorial's numbers."""
    registration = load_open3d().pipelines.registration
    option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=0.5 * settings["voxel_size"])
    settings["fgr"] = {name: getattr(option, name) for name in FGR_NAMES if hasattr(option, name)}
    return registration.registration_fgr_based_on_feature_matching(
        source, target, source_features, target_features, option
    )


def refined(source: Any, target: Any, T: FloatArray, size: float, settings: dict[str, Any]) -> Any:
    """Point-to-plane ICP on the original clouds: "This time we use a strict distance threshold", default criteria."""
    registration = load_open3d().pipelines.registration
    used = {
        "max_correspondence_distance": 0.4 * settings["voxel_size"],
        "relative_fitness": RELATIVE_FITNESS,
        "relative_rmse": RELATIVE_RMSE * size,
        "max_iteration": 30,
    }
    settings["refinement"] = used
    return registration.registration_icp(
        source,
        target,
        used["max_correspondence_distance"],
        T,
        registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(
            used["relative_fitness"], used["relative_rmse"], int(used["max_iteration"])
        ),
    )
