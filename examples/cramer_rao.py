"""How near `effort="best"` comes to the best that any method can do: the Cramer-Rao bound, on virtual scans.

A range sensor measures ``p = s + e d``: a point ``s`` of the part, moved along its unit ray ``d`` by the noise
``e ~ N(0, sigma^2)``. On a face with normal ``n`` the distance of the point from the face's plane is ``n . d e``; it
has the variance ``sigma^2 (n . d)^2``, and the best weight of the pair is one over that. With the rows
``J = [p x n, n]`` of the six motions, the covariance of an unbiased pose is at least::

    C = (sum J^T J / (sigma^2 (n . d)^2))^-1

and the mean square displacement of the vertices ``a`` at least the mean of ``trace(A C A^T)`` with
``A = [-[a]_x, I]``; `dqreg.synth.cramer_rao_bound` derives it. Here n and d are the true ones, which no method knows.

Errors are root mean squares over vertices and seeds, as multiples of the bound. Two yardsticks on the same noise say
what is luck and what is knowable; both are one step of least squares on the true faces: "rays known" weighs by
``1 / (n . d)^2`` and meets the bound but for luck; "all alike" weighs all pairs alike, as point-to-plane does.

    python examples/cramer_rao.py                               # the bracket, 3 seeds
    python examples/cramer_rao.py part.stl other.stl --seeds 10
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import dqreg
from dqreg._open3d import load_open3d
from dqreg.files import read_mesh
from dqreg.rigid import pose, twist
from dqreg.synth import Noise, Scan, Scanner, cramer_rao_bound, disturbance, rms_vertex_displacement, scan_mesh
from dqreg.synth.parts import bracket

VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
NOISE = 3e-4
CAD_SAMPLES = 500_000


def main(
    paths: list[str], seeds: int = 3, pixels: int = 900, samples: int = CAD_SAMPLES, first_seed: int = 0
) -> dict[str, dict[str, float]]:
    shapes = {Path(p).stem: (read_mesh(p).vertices, read_mesh(p).faces) for p in paths} or {"bracket": bracket()}
    table = Table("part", "points", "bound [S]", title=f"rms error / bound, seconds; {seeds} seeds", box=None)
    ratios: dict[str, dict[str, float]] = {}
    for name, mesh in shapes.items():
        rows, bound, points = measure(mesh, range(first_seed, first_seed + seeds), pixels, samples)
        ratios[name] = {method: error / bound for method, (error, _) in rows.items()}
        if len(ratios) == 1:
            for method in rows:
                table.add_column(method)
        cells = (f"{error / bound:.2f}" + (f" / {spent:.2f}" if spent else "") for error, spent in rows.values())
        table.add_row(name, f"{points:.0f}", f"{bound:.2e}", *cells)
    Console().print(table)
    return ratios


def measure(
    mesh: tuple, seeds: range, pixels: int, samples: int
) -> tuple[dict[str, tuple[float, float]], float, float]:
    """Error (rms over seeds) and seconds (median) of each method, the bound, and the mean number of points."""
    vertices, faces = mesh
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    found: dict[str, list[tuple[float, float]]] = {}
    bounds, counts = [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        scan = scan_mesh(vertices, faces, Scanner(VIEWS, pixels=pixels), Noise(range_sigma=NOISE * size), rng=rng)
        T_truth = disturbance(rng, np.deg2rad(8.0), 0.03 * size, vertices.mean(axis=0))
        points = pose.apply(pose.inverse(T_truth), scan.points)
        bounds.append(cramer_rao_bound(scan.points, scan.ray_directions, scan.normals, NOISE * size, vertices) / size)
        counts.append(len(points))
        for name, rays_known in (("rays known", True), ("all alike", False)):
            T = true_face_step(scan, mesh, rays_known=rays_known) @ T_truth
            found.setdefault(name, []).append((rms_vertex_displacement(T, T_truth, vertices) / size, 0.0))
        for name, run in methods(mesh, size, samples).items():
            began = time.perf_counter()
            T = run(points)
            seconds = time.perf_counter() - began
            found.setdefault(name, []).append((rms_vertex_displacement(T, T_truth, vertices) / size, seconds))
    rows = {}
    for name, pairs in found.items():
        errors, times = np.array(pairs).T
        rows[name] = float(np.sqrt(np.mean(errors**2))), float(np.median(times))
    return rows, float(np.sqrt(np.mean(np.square(bounds)))), float(np.mean(counts))


def true_face_step(scan: Scan, mesh: tuple, *, rays_known: bool) -> np.ndarray:
    """One step of least squares, 4x4, from the truth in the part's frame, with the face that each ray met."""
    vertices, faces = mesh
    normals, centre = scan.normals, vertices.mean(axis=0)
    off = np.einsum("ni,ni->n", scan.points - vertices[faces[scan.face_index, 0]], normals)
    rows = np.hstack([np.cross(scan.points - centre, normals), normals])
    cosines = np.einsum("ni,ni->n", normals, scan.ray_directions)
    weights = 1.0 / cosines**2 if rays_known else np.ones(len(rows))
    step = -np.linalg.solve((rows * weights[:, None]).T @ rows, rows.T @ (weights * off))
    return pose.about(twist.exp(step), centre)


def methods(mesh: tuple, size: float, samples: int) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    vertices, faces = mesh
    part = dqreg.Mesh(vertices, faces)

    def ours(effort: str) -> Callable[[np.ndarray], np.ndarray]:
        return lambda points: dqreg.register(points, part, "identity", effort=effort).T_target_source

    def open3d_planes(points: np.ndarray) -> np.ndarray:
        open3d = load_open3d()
        registration, utility = open3d.pipelines.registration, open3d.utility
        cad = open3d.geometry.TriangleMesh(utility.Vector3dVector(vertices), utility.Vector3iVector(faces))
        utility.random.seed(0)
        target = cad.sample_points_uniformly(samples, use_triangle_normal=True)
        source = open3d.geometry.PointCloud(utility.Vector3dVector(points))
        step = registration.TransformationEstimationPointToPlane()
        criteria = registration.ICPConvergenceCriteria(1e-9, 1e-9, 100)
        return registration.registration_icp(source, target, 0.1 * size, np.eye(4), step, criteria).transformation

    return {"dqreg best": ours("best"), "dqreg": ours("normal"), "Open3D point-to-plane": open3d_planes}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--pixels", type=int, default=900)
    arguments = parser.parse_args()
    main(arguments.parts, arguments.seeds, arguments.pixels, first_seed=arguments.first_seed)
