"""What a peer is given: two clouds of points in the task's own frames, and lengths that come from the data."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.engines.protocol import Task
from dqreg.geometry import Mesh
from dqreg.open3d_gate import load_open3d

# Points drawn from a mesh for peers that take clouds. Generous: at 500,000 the distance to the nearest sample is about
# a thousandth of a part's size, and sampling costs about a tenth of a second.
MESH_SAMPLES = 500_000
# Largest distance of a pair in sizes of the task, where a manual leaves it to the user. On virtual scans 8 degrees and
# 3 % of the size off, Open3D and small_gicp did at least as well with it as with half, twice or a fifth of it.
REACH = 0.1


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
    """Length that open lengths of manuals are shares of: the smaller bounding-box diagonal of source and target."""
    target = task.target.vertices if isinstance(task.target, Mesh) else task.target.points
    return min(diagonal(task.source.points), diagonal(target))


def diagonal(points: FloatArray) -> float:
    """Bounding-box diagonal."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def thinned(points: FloatArray, most: int, seed: int) -> FloatArray:
    """At most so many points, drawn evenly.

    Shapes: returns (n, most).
    """
    if len(points) <= most:
        return points
    rows = np.random.default_rng(seed).choice(len(points), size=most, replace=False)
    return points[np.sort(rows)]
