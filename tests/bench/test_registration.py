"""Time of whole registrations, beside peers in the same run: ``pytest tests/bench --benchmark-only``.

Peers take turns with dqreg, so that a busy machine is busy for both, and the ratio is of the shortest times. Everything
counts from raw points to pose: trees, normals, thinning. The figures inform, they never gate: nothing is asserted on a
time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg._open3d import load_open3d
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import bracket
from tests.bench.test_solve import report

VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
# Facets around each hole: about 5,000 faces.
SEGMENTS = 256
# Voxels and samples of the peers, as their users choose them.
VOXEL, SAMPLES = 1 / 200, 500_000


def in_turns(benchmark, ours: Callable[[], Any], peers: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Shortest seconds of each peer, taken between the rounds of our own."""
    seconds = dict.fromkeys(peers, np.inf)

    def others() -> None:
        for name, peer in peers.items():
            began = time.perf_counter()
            peer()
            seconds[name] = min(seconds[name], time.perf_counter() - began)

    benchmark.pedantic(ours, setup=others, rounds=rounds, warmup_rounds=1)
    return seconds


def small_gicp(source: np.ndarray, target: np.ndarray, voxel: float, reach: float) -> np.ndarray:
    gicp = pytest.importorskip("small_gicp")
    fixed, tree = gicp.preprocess_points(target, downsampling_resolution=voxel, num_threads=2)
    moving, _ = gicp.preprocess_points(source, downsampling_resolution=voxel, num_threads=2)
    options = {"registration_type": "GICP", "num_threads": 2, "max_correspondence_distance": reach}
    return gicp.align(fixed, moving, tree, **options, max_iterations=100).T_target_source


def open3d_icp(source: np.ndarray, part: dqreg.Mesh, reach: float, *, planes: bool) -> np.ndarray:
    open3d = load_open3d()
    registration, vector = open3d.pipelines.registration, open3d.utility.Vector3dVector
    mesh = open3d.geometry.TriangleMesh(vector(part.vertices), open3d.utility.Vector3iVector(part.faces))
    target = mesh.sample_points_uniformly(SAMPLES, use_triangle_normal=True)
    step = (
        registration.TransformationEstimationPointToPlane()
        if planes
        else registration.TransformationEstimationPointToPoint()
    )
    criteria = registration.ICPConvergenceCriteria(1e-9, 1e-9, 100)
    cloud = open3d.geometry.PointCloud(vector(source))
    return registration.registration_icp(cloud, target, reach, np.eye(4), step, criteria).transformation


def tracker_to_planes(source: np.ndarray, part: dqreg.Mesh, reach: float, start: np.ndarray) -> Callable[[], Any]:
    """Open3D's ICP to planes from a start; sampling the part is done beforehand, as `prepare_target` is."""
    open3d = load_open3d()
    registration, vector = open3d.pipelines.registration, open3d.utility.Vector3dVector
    mesh = open3d.geometry.TriangleMesh(vector(part.vertices), open3d.utility.Vector3iVector(part.faces))
    target = mesh.sample_points_uniformly(SAMPLES // 5, use_triangle_normal=True)
    step, criteria = (
        registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(1e-9, 1e-9),
    )
    cloud = open3d.geometry.PointCloud(vector(source))
    return lambda: registration.registration_icp(cloud, target, reach, start, step, criteria)


@pytest.fixture(scope="module")
def part() -> dqreg.Mesh:
    return dqreg.Mesh(*bracket(segments=SEGMENTS))


@pytest.fixture(scope="module")
def case(part) -> tuple[np.ndarray, np.ndarray]:
    """Two views of the bracket, about 300,000 points, 8 degrees and 3 % off; and the true pose."""
    rng = np.random.default_rng(0)
    scanner, noise = Scanner(VIEWS, pixels=640), Noise(range_sigma=3e-4 * part.diagonal)
    points = scan_mesh(part.vertices, part.faces, scanner, noise, rng=rng).points
    T = disturbance(rng, np.deg2rad(8.0), 0.03 * part.diagonal, part.centre)
    return pose.apply(pose.inverse(T), points), T


@pytest.mark.parametrize(("turn_deg", "shift"), [(0.3, 0.001), (1.0, 0.005), (3.0, 0.01)])
def test_tracking_5_000_points_on_5_000_faces(benchmark, capsys, part, case, turn_deg, shift):
    points, T = case
    some = points[np.random.default_rng(1).choice(len(points), 5_000, replace=False)]
    start = disturbance(np.random.default_rng(2), np.deg2rad(turn_deg), shift * part.diagonal, part.centre) @ T
    target = dqreg.prepare_target(part)
    began = time.perf_counter()
    result = target.register(some, start)
    first = time.perf_counter() - began
    peer = tracker_to_planes(some, part, 0.1 * part.diagonal, start)
    seconds = in_turns(benchmark, lambda: target.register(some, start), {"o3d_plane": peer}, rounds=20)
    report(
        benchmark,
        capsys,
        ms=1e3 * benchmark.stats["min"],
        times_o3d_plane=benchmark.stats["min"] / seconds["o3d_plane"],
        median_ms=1e3 * benchmark.stats["median"],
        first_ms=1e3 * first,
        prepared_ms=1e3 * target.seconds,
        target_mb=target.nbytes / 1e6,
        error_1e6=1e6 * worst_vertex_displacement(result.T_target_source, T, part.vertices) / part.diagonal,
    )
    assert result.verdict.level == "accepted"


@pytest.mark.parametrize("effort", ["fast", "normal"])
def test_a_scan_on_its_part_beside_peers(benchmark, capsys, part, case, effort):
    points, T = case
    reach = 0.1 * part.diagonal
    cad = dqreg.geometry.sample_mesh

    def run() -> np.ndarray:
        return dqreg.register(points, part, "identity", effort=effort).T_target_source

    peers = {
        "gicp": lambda: small_gicp(
            points, cad(part, SAMPLES, np.random.default_rng(0)).points, VOXEL * part.diagonal, reach
        ),
        "o3d_plane": lambda: open3d_icp(points, part, reach, planes=True),
        "o3d_point": lambda: open3d_icp(points, part, reach, planes=False),
    }
    seconds = in_turns(benchmark, run, peers, rounds=3)
    best = benchmark.stats["min"]
    figures = {f"times_{name}": best / value for name, value in seconds.items()}
    error = worst_vertex_displacement(run(), T, part.vertices) / part.diagonal
    report(benchmark, capsys, ms=1e3 * best, points=len(points), error_1e6=1e6 * error, **figures)
    assert error <= 3e-5
