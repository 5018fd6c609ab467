"""Poses from nothing: how often dqreg, FPFH with RANSAC, FGR and KISS-Matcher find a part, on the same scans.

Virtual scans of a part from random views, at random poses. Right is a pose whose worst vertex is within 2 % of the
part's size of the truth, or one that explains a second, denser scan from the same views as well as the truth does
(a part with symmetries has several right poses): mean log-likelihood of the exact distances within 0.01 of the truth's.
Every peer is refined by Open3D's point-to-plane ICP. Seconds are per scan, of search and refinement together; what is
prepared once a part (tables, samples, features) is not counted for anyone.

    python examples/from_nothing.py                                      # parts that ship with dqreg, two seeds
    python examples/from_nothing.py parts/ --seeds 3 --peers             # every mesh of a folder, with the peers
    python examples/from_nothing.py part.stl --views 1 --noise 3e-3 --outliers 0.3
    python examples/from_nothing.py --real DATA --peers                  # real scans whose pose is known

On real scans right is a root mean square error of the judged points (the whole source, or the part in a scene) within
2 % of the smaller side. "overlap" is the share of them that have a target within 1 % of that size at the true pose.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

import dqreg
from dqreg.files import read_mesh
from dqreg.icp import InlierMixture
from dqreg.open3d_gate import load_open3d
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import box, bracket, plate

if TYPE_CHECKING:
    from real_pairs import Pair

MESHES = {".stl", ".ply", ".obj", ".off", ".3mf", ".glb"}
# Right: worst vertex in sizes; or mean log-likelihood of the judge's points behind the truth's, at most.
NEAR, AS_WELL = 0.02, 0.01
# Distance, in sizes, beyond which a point tells the judge nothing more; points of the judge.
LIMIT, JUDGES = 0.05, 20_000
# Voxel of the peers in sizes, and samples of the CAD they get.
VOXEL, CAD_SAMPLES = 0.015, 100_000

Method = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class Case:
    """A scan in its own frame, a denser one from the same views that no method sees, and the truth."""

    points: np.ndarray
    held_out: np.ndarray
    T_truth: np.ndarray


def main(arguments: list[str] | None = None) -> dict[str, dict[str, tuple[int, int, float]]]:
    """Right answers, cases and median seconds for each part and method."""
    options = _parser().parse_args(arguments)
    if options.real is not None:
        return real_main(options)
    shapes = _shapes(options.parts)
    table = Table("part", "method", "right", "accepted though wrong", "median s", title=_title(options), box=None)
    totals: dict[str, list[tuple[bool, bool, float]]] = {}
    answer: dict[str, dict[str, tuple[int, int, float]]] = {}
    for name, mesh in shapes.items():
        target = dqreg.prepare_target(mesh)
        _ = target.pairs.symmetry
        for method, rows in _race(mesh, target, options).items():
            totals.setdefault(method, []).extend(rows)
            answer.setdefault(name, {})[method] = _row(table, name, method, rows)
    for method, rows in totals.items():
        answer.setdefault("all", {})[method] = _row(table, "all", method, rows)
    Console().print(table)
    return answer


def real_main(options: argparse.Namespace) -> dict[str, dict[str, tuple[int, int, float]]]:
    """As `main`, for real scans."""
    # It stands beside this file.
    from real_pairs import real_pairs

    columns = ("pair", "overlap", "method", "right", "error", "verdict", "seconds")
    table = Table(*columns, title="real scans, no start", box=None)
    answer: dict[str, dict[str, tuple[int, int, float]]] = {}
    for pair in real_pairs(options.real):
        if options.only not in pair.name:
            continue
        target = dqreg.prepare_target(pair.target)
        overlap = _overlap(pair, target)
        for method, run in {"dqreg": None, **(_peers(pair.target, pair.size) if options.peers else {})}.items():
            began = time.perf_counter()
            if run is None:
                result = target.register(pair.source)
                T, verdict = result.T_target_source, result.verdict.level
            else:
                T, verdict = run(pair.source), "none given"
            seconds = time.perf_counter() - began
            moved = [pose.apply(each, pair.judged) for each in (T, pair.T_truth)]
            error = float(np.sqrt(((moved[0] - moved[1]) ** 2).sum(axis=1).mean())) / pair.size
            right = error <= NEAR
            cells = (f"{100 * overlap:.0f} %", method, "yes" if right else "no", f"{error:.4f} S", verdict)
            table.add_row(pair.name, *cells, f"{seconds:.1f}")
            answer.setdefault(pair.name, {})[method] = (int(right), 1, seconds)
    Console(width=140).print(table)
    return answer


def _overlap(pair: Pair, target: dqreg.Target) -> float:
    some = pair.judged[:: max(1, len(pair.judged) // JUDGES)]
    distances = target.indexed.surface.closest(pose.apply(pair.T_truth, some) - target.indexed.origin).distances
    return float((distances < 0.01 * pair.size).mean())


def make_case(mesh: dqreg.Mesh, seed: int, views: int, noise: float, outliers: float, pixels: int) -> Case:
    rng = np.random.default_rng(seed)
    directions = [tuple(v) for v in rng.normal(size=(2, 3))[:views]]
    sigma = Noise(range_sigma=noise * mesh.diagonal)
    scans = [
        scan_mesh(mesh.vertices, mesh.faces, Scanner(directions, pixels=count), sigma, rng=draw).points
        for count, draw in ((pixels, rng), (5 * pixels // 3, np.random.default_rng(seed + 1_000_000)))
    ]
    low, high = scans[0].min(axis=0), scans[0].max(axis=0)
    strays = int(len(scans[0]) * outliers / (1.0 - outliers))
    room = 0.1 * (high - low)
    points = np.concatenate([scans[0], rng.uniform(low - room, high + room, size=(strays, 3))])
    T_truth = random_pose(rng, mesh.diagonal, mesh.centre)
    back = pose.inverse(T_truth)
    return Case(pose.apply(back, points), pose.apply(back, scans[1]), T_truth)


def is_right(T: np.ndarray, case: Case, mesh: dqreg.Mesh, target: dqreg.Target) -> bool:
    if not np.isfinite(T).all():
        return False
    if worst_vertex_displacement(T, case.T_truth, mesh.vertices) <= NEAR * mesh.diagonal:
        return True
    held_out = case.held_out[:: max(1, len(case.held_out) // JUDGES)]
    ours, truth = (_likelihood(pose.apply(each, held_out), mesh, target) for each in (T, case.T_truth))
    return ours >= truth - AS_WELL


def _likelihood(points: np.ndarray, mesh: dqreg.Mesh, target: dqreg.Target) -> float:
    # Width and share of the inliers are those under which this pose is likeliest: no pose is favoured.
    distances = target.indexed.surface.closest(points - target.indexed.origin).distances
    limit = LIMIT * mesh.diagonal
    near = distances < limit
    if not near.any():
        return -np.inf
    mixture = InlierMixture(0.2 * limit, 0.5, limit).learned(distances[near], floor=1e-6 * mesh.diagonal, rounds=100)
    return -mixture.surprise(distances[near], int(np.count_nonzero(~near)))


def _race(
    mesh: dqreg.Mesh, target: dqreg.Target, options: argparse.Namespace
) -> dict[str, list[tuple[bool, bool, float]]]:
    rows: dict[str, list[tuple[bool, bool, float]]] = {}
    peers = _peers(mesh, mesh.diagonal) if options.peers else {}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        case = make_case(mesh, seed, options.views, options.noise, options.outliers, options.pixels)
        began = time.perf_counter()
        result = target.register(case.points, effort="fast")
        seconds = time.perf_counter() - began
        right = is_right(result.T_target_source, case, mesh, target)
        rows.setdefault("dqreg", []).append((right, result.verdict.level == "accepted", seconds))
        for name, run in peers.items():
            began = time.perf_counter()
            T = run(case.points)
            seconds = time.perf_counter() - began
            rows.setdefault(name, []).append((is_right(T, case, mesh, target), False, seconds))
    return rows


def _peers(target: dqreg.Mesh | dqreg.PointCloud, size: float) -> dict[str, Method]:
    open3d = load_open3d()
    registration = open3d.pipelines.registration
    voxel = VOXEL * size
    cad = _stands(target, voxel)
    few_cad, cad_features = _described(cad, voxel)

    def refined(points: np.ndarray, T: np.ndarray) -> np.ndarray:
        for reach in (2.0 * voxel, 0.5 * voxel):
            T = registration.registration_icp(
                _cloud(points), cad, reach, T, registration.TransformationEstimationPointToPlane()
            ).transformation
        return np.asarray(T)

    def ransac(points: np.ndarray) -> np.ndarray:
        open3d.utility.random.seed(0)
        few, features = _described(_cloud(points), voxel)
        found = registration.registration_ransac_based_on_feature_matching(
            few,
            few_cad,
            features,
            cad_features,
            True,
            1.5 * voxel,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel),
            ],
            registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        return refined(points, found.transformation)

    def fgr(points: np.ndarray) -> np.ndarray:
        few, features = _described(_cloud(points), voxel)
        option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=voxel)
        found = registration.registration_fgr_based_on_feature_matching(few, few_cad, features, cad_features, option)
        return refined(points, found.transformation)

    peers: dict[str, Method] = {"FPFH + RANSAC + ICP": ransac, "FGR + ICP": fgr}
    if importlib.util.find_spec("kiss_matcher") is not None:
        import kiss_matcher

        def kiss(points: np.ndarray) -> np.ndarray:
            # It takes no small voxels and clamps its bounds to metres; parts come in any unit, so they are scaled.
            config = kiss_matcher.KISSMatcherConfig(1.0, enable_noise_bound_clamping=False)
            matcher = kiss_matcher.KISSMatcher(config)
            sides = [np.asarray(c.voxel_down_sample(voxel).points) / voxel for c in (_cloud(points), cad)]
            found = matcher.estimate(*sides)
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = found.rotation, voxel * np.asarray(found.translation).ravel()
            return refined(points, T)

        peers["KISS-Matcher + ICP"] = kiss
    return peers


def _stands(target: dqreg.Mesh | dqreg.PointCloud, voxel: float) -> object:
    open3d = load_open3d()
    if isinstance(target, dqreg.PointCloud):
        cloud = _cloud(target.points)
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * voxel, max_nn=30))
        return cloud
    part = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(target.vertices), open3d.utility.Vector3iVector(target.faces)
    )
    open3d.utility.random.seed(0)
    return part.sample_points_uniformly(CAD_SAMPLES, use_triangle_normal=True)


def _cloud(points: np.ndarray) -> object:
    open3d = load_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


def _described(cloud: object, voxel: float) -> tuple[object, object]:
    open3d = load_open3d()
    few = cloud.voxel_down_sample(voxel)
    few.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * voxel, max_nn=30))
    # The histograms depend on the signs of the normals: the peers do far better with consistent ones.
    few.orient_normals_consistent_tangent_plane(15)
    near = open3d.geometry.KDTreeSearchParamHybrid(radius=5.0 * voxel, max_nn=100)
    return few, open3d.pipelines.registration.compute_fpfh_feature(few, near)


def _row(table: Table, name: str, method: str, rows: list[tuple[bool, bool, float]]) -> tuple[int, int, float]:
    right, seconds = sum(row[0] for row in rows), float(np.median([row[2] for row in rows]))
    false_success = str(sum(row[1] and not row[0] for row in rows)) if method == "dqreg" else "no verdict"
    table.add_row(name, method, f"{right} of {len(rows)}", false_success, f"{seconds:.2f}")
    return right, len(rows), seconds


def _shapes(paths: list[Path]) -> dict[str, dqreg.Mesh]:
    if not paths:
        made = {"bracket": bracket(), "box": box((5.0, 3.0, 2.0)), "plate": plate()}
        return {name: dqreg.Mesh(*shape) for name, shape in made.items()}
    files = [f for p in paths for f in (sorted(p.iterdir()) if p.is_dir() else [p])]
    meshes = [f for f in files if f.suffix.lower() in MESHES]
    read = {f.name: read_mesh(f) for f in meshes}
    return {name: dqreg.Mesh(data.vertices, data.faces) for name, data in read.items()}


def _title(options: argparse.Namespace) -> str:
    noise = f"noise {options.noise:g} S, {100 * options.outliers:g} % outliers"
    return f"poses from nothing: {options.views} view(s), {noise}, {options.seeds} seed(s) a part"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("parts", nargs="*", type=Path, help="meshes, or folders of meshes")
    parser.add_argument("--seeds", type=int, default=2, help="random poses a part")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--views", type=int, choices=(1, 2), default=2)
    parser.add_argument("--noise", type=float, default=3e-4, help="sigma of the range, in sizes")
    parser.add_argument("--outliers", type=float, default=0.0, help="share of uniform strays, below 1")
    parser.add_argument("--pixels", type=int, default=200, help="pixels along one side of a view")
    parser.add_argument("--peers", action="store_true", help="run the peers as well")
    parser.add_argument("--real", type=Path, metavar="DATA", help="real scans in the folders of DATA instead")
    parser.add_argument("--only", default="", help="with --real: pairs whose name holds this")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
