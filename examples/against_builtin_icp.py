"""The same scans through dqreg, Open3D's ICP and small_gicp (where installed): error, seconds, verdict.

Virtual scans of a CAD part with known truth: two views, range noise of 3e-4 sizes, start 8 degrees and 3 % of the
size off. Every method starts from raw points; sampling the CAD, normals and trees are counted. The error is the worst
displacement of a vertex of the part, in sizes S (bounding-box diagonals).

    python examples/against_builtin_icp.py                       # the bracket that ships with dqreg
    python examples/against_builtin_icp.py part.stl other.stl    # your own parts
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import dqreg
from dqreg._open3d import load_open3d
from dqreg.files import read_mesh
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import bracket

VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
CAD_SAMPLES = 500_000
# small_gicp keeps one point a voxel: voxels in 1/S, and as many samples as they need; more take time and gain nothing.
VOXELS = {200: 100_000, 400: 200_000}


def main(paths: list[str], pixels: int = 800, seeds: int = 3, samples: int = CAD_SAMPLES) -> dict[str, list[float]]:
    shapes = {Path(p).stem: (read_mesh(p).vertices, read_mesh(p).faces) for p in paths} or {"bracket": bracket()}
    table = Table("part", "scan points", "method", "worst vertex [S]", "seconds", title="median over seeds", box=None)
    errors: dict[str, list[float]] = {}
    for name, (vertices, faces) in shapes.items():
        for method, rows in _race(vertices, faces, pixels, seeds, samples).items():
            error, seconds, points = (float(np.median(column)) for column in zip(*rows, strict=True))
            errors.setdefault(method, []).append(error)
            table.add_row(name, f"{points:.0f}", method, f"{error:.1e}", f"{seconds:.2f}")
    Console().print(table)
    return errors


def _race(vertices: np.ndarray, faces: np.ndarray, pixels: int, seeds: int, samples: int) -> dict[str, list[tuple]]:
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    centre = vertices.mean(axis=0)
    rows: dict[str, list[tuple]] = {}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        scan = scan_mesh(vertices, faces, Scanner(VIEWS, pixels=pixels), Noise(range_sigma=3e-4 * size), rng=rng)
        T_truth = disturbance(rng, np.deg2rad(8.0), 0.03 * size, centre)
        points = pose.apply(pose.inverse(T_truth), scan.points)
        for method, run in methods(vertices, faces, size, samples).items():
            began = time.perf_counter()
            T = run(points)
            seconds = time.perf_counter() - began
            error = worst_vertex_displacement(T, T_truth, vertices) / size
            rows.setdefault(method, []).append((error, seconds, len(points)))
    return rows


def methods(
    vertices: np.ndarray, faces: np.ndarray, size: float, samples: int
) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    reach = 0.1 * size

    def ours(effort: str) -> Callable[[np.ndarray], np.ndarray]:
        part = dqreg.Mesh(vertices, faces)
        return lambda points: dqreg.register(points, part, "identity", effort=effort).T_target_source

    def open3d_icp(points: np.ndarray, *, planes: bool) -> np.ndarray:
        open3d = load_open3d()
        registration = open3d.pipelines.registration
        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces)
        )
        open3d.utility.random.seed(0)
        target = mesh.sample_points_uniformly(samples, use_triangle_normal=True)
        source = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        step = (
            registration.TransformationEstimationPointToPlane()
            if planes
            else registration.TransformationEstimationPointToPoint()
        )
        criteria = registration.ICPConvergenceCriteria(1e-9, 1e-9, 100)
        return registration.registration_icp(source, target, reach, np.eye(4), step, criteria).transformation

    def small_gicp(points: np.ndarray, voxels: int) -> np.ndarray:
        import small_gicp as gicp

        few = min(samples, VOXELS[voxels])
        cad = dqreg.geometry.sample_mesh(dqreg.Mesh(vertices, faces), few, np.random.default_rng(0)).points
        target, tree = gicp.preprocess_points(cad, downsampling_resolution=size / voxels, num_threads=2)
        source, _ = gicp.preprocess_points(points, downsampling_resolution=size / voxels, num_threads=2)
        answer = gicp.align(
            target, source, tree, registration_type="GICP", max_correspondence_distance=reach, num_threads=2,
            max_iterations=100,
        )  # fmt: skip
        return answer.T_target_source

    found: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "dqreg fast": ours("fast"),
        "dqreg": ours("normal"),
        "dqreg best": ours("best"),
        "Open3D point-to-point": lambda points: open3d_icp(points, planes=False),
        "Open3D point-to-plane": lambda points: open3d_icp(points, planes=True),
    }
    try:
        import small_gicp as _  # noqa: F401
    except ImportError:
        return found
    return {**found, **{f"small_gicp GICP, S/{voxels}": partial(small_gicp, voxels=voxels) for voxels in VOXELS}}


if __name__ == "__main__":
    main(sys.argv[1:])
