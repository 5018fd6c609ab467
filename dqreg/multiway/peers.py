"""Ways to bring many scans into one frame: ours and Open3D's, each from scans to poses, on one case."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, bounds
from dqreg._open3d import load_open3d
from dqreg.geometry import PointCloud
from dqreg.multiway.register_many import register_many
from dqreg.multiway.result import Multiway
from dqreg.multiway.scores import ManyScore, score
from dqreg.rigid import pose

# Open3D's example of multiway registration (0.19): voxels of 0.02 in clouds two metres wide, as a fraction of the size;
# threshold below which it prunes an edge.
VOXEL_SIZES, PRUNED_EDGE_WEIGHT = 0.01, 0.25
# Distances of its coarse and fine ICP.
COARSE_REACH_VOXELS, FINE_REACH_VOXELS = 15.0, 1.5


@dataclasses.dataclass(frozen=True)
class ManyTask:
    """Scans to be placed; the pairs that ours registered are there for peers that cannot find their own."""

    clouds: Sequence[PointCloud]
    ours: Multiway
    size: float  # Typical diagonal of a scan


def pairwise_chain(task: ManyTask) -> FloatArray:
    """Neighbour after neighbour, Open3D's point-to-plane from our poses of the pairs where there are any: no graph."""
    clouds = _downsampled(task)
    T = [np.eye(4)]
    for k in range(1, len(clouds)):
        step, _ = _icp(clouds[k], clouds[k - 1], _start(task, k - 1, k), task.size)
        T.append(T[-1] @ step)
    return np.stack(T)


def open3d_example(task: ManyTask) -> FloatArray:
    """Open3D's example as it stands: all pairs from the identity, odometry edges sure, all others uncertain."""
    count = len(task.clouds)
    pairs = [(i, j, np.eye(4)) for i in range(count) for j in range(i + 1, count)]
    return _optimised(task, pairs)


def open3d_on_our_pairs(task: ManyTask) -> FloatArray:
    """The same from the poses of the pairs that ours found and used."""
    pairs = [
        (edge.target, edge.source, edge.registration.T_target_source)
        for edge in task.ours.edges
        if edge.used and edge.target >= 0
    ]
    return _optimised(task, pairs)


ENGINES: dict[str, Callable[[ManyTask], FloatArray]] = {
    "dqreg multiway": lambda task: task.ours.T_world_scan,
    "Open3D, its example": open3d_example,
    "Open3D, our pairs": open3d_on_our_pairs,
    "chain of ICP, our pairs": pairwise_chain,
}


def compare_many(
    clouds: Sequence[PointCloud],
    truth: FloatArray,
    *,
    observe: Callable[[str], object] | None = None,
    **options: Any,
) -> list[ManyScore]:
    """Scores of all engines; options are those of `dqreg.register_many`. Shapes: truth (n, 4, 4), T_world_scan."""
    began = time.perf_counter()
    result = register_many(clouds, **options)
    spent = time.perf_counter() - began
    size = float(np.median([np.linalg.norm(np.subtract(*bounds(cloud.points))) for cloud in clouds]))
    task = ManyTask(clouds, result, size)
    scores = []
    for name, engine in ENGINES.items():
        if observe is not None:
            observe(name)
        began = time.perf_counter()
        T = engine(task)
        seconds = time.perf_counter() - began + (spent if engine is ENGINES["dqreg multiway"] else 0.0)
        remark = result.verdict.level if engine is ENGINES["dqreg multiway"] else ""
        scores.append(dataclasses.replace(score(name, T, truth, clouds, task.size), seconds=seconds, remark=remark))
    return scores


def _downsampled(task: ManyTask) -> list[Any]:
    open3d = load_open3d()
    found = []
    for cloud in task.clouds:
        points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
        points = points.voxel_down_sample(VOXEL_SIZES * task.size)
        points.estimate_normals(
            open3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * VOXEL_SIZES * task.size, max_nn=30)
        )
        found.append(points)
    return found


def _icp(source: Any, target: Any, start: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Pose and information of a pair, as the example finds them; a start that is near needs the fine distance alone."""
    registration = load_open3d().pipelines.registration
    T = start
    far = (COARSE_REACH_VOXELS * VOXEL_SIZES * size,) if np.array_equal(start, np.eye(4)) else ()
    for reach in (*far, FINE_REACH_VOXELS * VOXEL_SIZES * size):
        plane = registration.TransformationEstimationPointToPlane()
        T = registration.registration_icp(source, target, reach, T, plane).transformation
    information = registration.get_information_matrix_from_point_clouds(
        source, target, FINE_REACH_VOXELS * VOXEL_SIZES * size, T
    )
    return np.asarray(T), np.asarray(information)


def _start(task: ManyTask, i: int, j: int) -> FloatArray:
    for edge in task.ours.edges:
        if (edge.target, edge.source) == (i, j) and edge.found:
            return edge.registration.T_target_source
        if (edge.target, edge.source) == (j, i) and edge.found:
            return pose.inverse(edge.registration.T_target_source)
    return np.eye(4)


def _optimised(task: ManyTask, pairs: Sequence[tuple[int, int, FloatArray]]) -> FloatArray:
    registration = load_open3d().pipelines.registration
    clouds = _downsampled(task)
    found = {(i, j): _icp(clouds[j], clouds[i], start, task.size) for i, j, start in pairs}
    graph = registration.PoseGraph()
    T = _initial(found, len(clouds))
    for each in T:
        graph.nodes.append(registration.PoseGraphNode(each))
    for (i, j), (T_ij, information) in found.items():
        # Its edge maps the source node's points to the target node's.
        graph.edges.append(registration.PoseGraphEdge(j, i, T_ij, information, uncertain=abs(i - j) > 1))
    option = registration.GlobalOptimizationOption(
        FINE_REACH_VOXELS * VOXEL_SIZES * task.size, PRUNED_EDGE_WEIGHT, 1.0, 0
    )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        option,
    )
    poses = np.array([node.pose for node in graph.nodes])
    joined = _reached(found, len(clouds))
    poses[~joined] = np.nan
    return poses


def _reached(found: dict[tuple[int, int], Any], count: int) -> BoolArray:
    seen, stack = {0}, [0]
    while stack:
        k = stack.pop()
        near = [j for i, j in found if i == k] + [i for i, j in found if j == k]
        stack += [n for n in near if n not in seen]
        seen |= set(near)
    return np.isin(np.arange(count), sorted(seen))


def _initial(found: dict[tuple[int, int], tuple[FloatArray, FloatArray]], count: int) -> FloatArray:
    """Initial poses of the nodes: along the pairs, neighbours first."""
    T = np.tile(np.eye(4), (count, 1, 1))
    seen = {0}
    while len(seen) < count:
        open_pairs = [(abs(i - j), i, j) for i, j in found if (i in seen) != (j in seen)]
        if not open_pairs:
            break
        _, i, j = min(open_pairs)
        step = found[i, j][0]
        if i in seen:
            T[j] = T[i] @ step
            seen.add(j)
        else:
            T[i] = T[j] @ pose.inverse(step)
            seen.add(i)
    return T
