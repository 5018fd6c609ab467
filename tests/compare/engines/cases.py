"""One small case for every engine: an irregular solid with five corners, and a scan of all of it with known pose."""

from __future__ import annotations

import functools

import numpy as np
from scipy.spatial import ConvexHull

from dqreg.compare.engines import ENGINES, EngineOutput, Task
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.rigid import pose, twist
from dqreg.synth import disturbance
from dqreg.synth.parts import bracket

# Given the part itself: mesh_other takes nothing else, NDT and features want more points than the cloud has.
ON_PART = ("trimesh mesh_other", "trimesh mesh_other as shipped", "open3d ndt", "open3d fpfh+ransac", "open3d fpfh+fgr")
NOISE = 3e-4


@functools.cache
def part() -> Mesh:
    corners = np.array([[0, 0, 0], [10, 1, 0], [1, 6, 0.5], [2, 1, 4], [4, 0.5, 3.5]], dtype=np.float64)
    faces = ConvexHull(corners).simplices.astype(np.int64)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(corners, faces)


@functools.cache
def truth() -> np.ndarray:
    """About 46 degrees and half a size: a pose that is not its own inverse by a long way."""
    return np.array(twist.exp(np.array([0.5, -0.3, 0.55, 4.0, -3.0, 2.0])))


@functools.cache
def twins() -> tuple[PointCloud, PointCloud, np.ndarray]:
    """A bracket's points twice, and the pose between: axes exchanged in a circle, and a shift by whole voxels.

    For KISS-Matcher, whose finding of other poses is its own affair: here it sees the same voxels on both sides, and a
    wrong frame or unit would still show.
    """
    shape = Mesh(*bracket())
    points = sample_mesh(shape, 12_000, np.random.default_rng(3)).points
    T = np.zeros((4, 4))
    T[[0, 1, 2, 3], [2, 0, 1, 3]] = 1.0
    T[:3, 3] = np.array([37.0, -12.0, 5.0]) * 0.01 * float(np.linalg.norm(np.ptp(points, axis=0)))
    return PointCloud(points), PointCloud(pose.apply(T, points)), T


@functools.cache
def clouds() -> tuple[PointCloud, PointCloud]:
    rng = np.random.default_rng(1)
    size = part().diagonal
    seen = sample_mesh(part(), 3000, rng)
    noisy = seen.points + rng.normal(0.0, NOISE * size, seen.points.shape)
    back = pose.inverse(truth())
    scan = PointCloud(pose.apply(back, noisy), seen.normals @ back[:3, :3].T)
    return scan, sample_mesh(part(), 8000, rng)


def task(name: str, setting: str = "manual", **changes: object) -> Task:
    scan, target = clouds()
    # Two degrees and half a per cent of the size away from the truth.
    start = disturbance(np.random.default_rng(2), np.deg2rad(2.0), 0.005 * part().diagonal, part().centre) @ truth()
    if name.startswith("kiss-matcher"):
        return Task(*twins()[:2], None, threads=1)
    fields: dict[str, object] = {
        "source": scan,
        "target": part() if name in ON_PART else target,
        "start": start,
        "setting": setting,
        "threads": 1,
    }
    if setting == "same-loop":
        fields |= {
            "source_points": scan.points[:2000],
            "target_points": target.points[:5000],
            "target_normals": target.normals[:5000],
            "max_distance": 0.1 * part().diagonal,
            "max_iterations": 30,
        }
    return Task(**{**fields, **changes})  # type: ignore[arg-type]


@functools.cache
def attempt(name: str, setting: str) -> EngineOutput:
    return ENGINES[name].register(task(name, setting))


def error(T: np.ndarray, name: str = "") -> float:
    """Worst displacement of a corner of the part, in sizes; also for poses with a scale."""
    if name.startswith("kiss-matcher"):
        gap, points = T - twins()[2], twins()[0].points
        return float(np.linalg.norm(points @ gap[:3, :3].T + gap[:3, 3], axis=1).max() / np.ptp(points, axis=0).max())
    gap = T - truth()
    return float(np.linalg.norm(part().vertices @ gap[:3, :3].T + gap[:3, 3], axis=1).max() / part().diagonal)
