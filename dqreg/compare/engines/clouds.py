"""What a peer is given: two clouds of points in the task's own frames, and lengths that come from the data."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.compare.engines.protocol import Task
from dqreg.geometry import Mesh

# Points drawn from a mesh for peers that take clouds: at 500,000 the distance to the nearest sample is about a
# thousandth of a part's size, and sampling takes about a tenth of a second.
MESH_SAMPLES = 500_000
# Maximum correspondence distance as a fraction of `task_size`, where a manual leaves it to the user: as large as an
# initial pose 8 degrees and 3 % of the size off needs. On virtual scans point-to-plane methods are up to 20 times as
# accurate with less of it, and then lose poses that are farther off: the staged engines take both in turn.
MAX_DISTANCE = 0.1
STAGED_DISTANCES = (0.1, 0.02, 0.004)


@dataclasses.dataclass(frozen=True)
class Cloud:
    """Points of one side."""

    points: FloatArray  # (n, 3): Positions
    normals: FloatArray | None  # (n, 3): Unit normals, where they are known


def source_cloud(task: Task) -> Cloud:
    """The source as points: those of the same loop, or all."""
    if task.setting == "same-loop" and task.source_points is not None:
        return Cloud(task.source_points, None)
    return Cloud(task.source.points, task.source.normals)


def target_cloud(task: Task, settings: dict[str, Any], samples: int = MESH_SAMPLES) -> Cloud:
    """The target as points: those of the same loop, the cloud's own, or samples of the mesh."""
    if task.setting == "same-loop" and task.target_points is not None:
        return Cloud(task.target_points, task.target_normals)
    if not isinstance(task.target, Mesh):
        return Cloud(task.target.points, task.target.normals)
    open3d = load_open3d()
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(task.target.vertices),
        open3d.utility.Vector3iVector(task.target.faces.astype(np.int32)),
    )
    settings.update(target_samples=samples, target_sampler="Open3D sample_points_uniformly, triangle normals")
    settings["seed"] = task.seed
    open3d.utility.random.seed(task.seed)
    drawn = mesh.sample_points_uniformly(samples, use_triangle_normal=True)
    return Cloud(np.array(drawn.points), np.array(drawn.normals))


def task_size(task: Task) -> float:
    """Length of which open lengths of manuals are fractions: the smaller bounding-box diagonal of source and target."""
    target = task.target.vertices if isinstance(task.target, Mesh) else task.target.points
    return min(diagonal(task.source.points), diagonal(target))


def diagonal(points: FloatArray) -> float:
    """Bounding-box diagonal."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def subsampled(points: FloatArray, most: int, seed: int) -> FloatArray:
    """At most so many points, drawn uniformly. Shapes: returns (n, most)."""
    if len(points) <= most:
        return points
    rows = np.random.default_rng(seed).choice(len(points), size=most, replace=False)
    return points[np.sort(rows)]


def open3d_cloud(cloud: Cloud) -> Any:
    """A legacy Open3D cloud."""
    open3d = load_open3d()
    converted = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
    if cloud.normals is not None:
        converted.normals = open3d.utility.Vector3dVector(cloud.normals)
    return converted


def with_normals(cloud: Any, settings: dict[str, Any], side: str) -> Any:
    """Fit normals where there are none, as Open3D does by itself (30 nearest neighbours)."""
    given = cloud.has_normals()
    if not given:
        # The default of `estimate_normals`, called without arguments in the ICP tutorial.
        cloud.estimate_normals(load_open3d().geometry.KDTreeSearchParamKNN(knn=30))
    settings[f"{side}_normals"] = "given" if given else "estimated, 30 nearest neighbours"
    return cloud
