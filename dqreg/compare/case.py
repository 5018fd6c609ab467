"""A benchmark case: the task that every engine gets, and the ground truth that only the judge gets."""

from __future__ import annotations

import dataclasses
import hashlib

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.engines.protocol import Setting, Task
from dqreg.compare.judge import SUCCESS_THRESHOLD, GroundTruth
from dqreg.compare.truth import TruePoses
from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh, MeshSurface, PointCloud, Surface, sample_mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.spacing import measure_spacing
from dqreg.rigid import pose

# Scan points held out for the judge: this fraction, and at most so many.
HELD_OUT_FRACTION, MAX_HELD_OUT = 0.1, 5_000
MAX_PROBES = 20_000
# Scan points of a run that warms an engine up.
WARMING_POINTS = 1_000


@dataclasses.dataclass(frozen=True)
class SameLoop:
    """What "same loop" means: identical for everyone."""

    # source_points, target_points: Points drawn once for all engines from scan and target (a mesh is sampled, with
    # normals)
    source_points: int = 10_000
    target_points: int = 100_000
    max_distance: float = 0.1  # Maximum correspondence distance, in S, the diagonal of the target's bounding box
    max_iterations: int = 50  # Iteration cap


@dataclasses.dataclass(frozen=True, eq=False)
class BenchmarkCase:
    """A task with its ground truth."""

    key: str  # Names the task in files: the same key is the same task
    case: str  # Name of the case or of the pair of files
    axis: str  # What is varied: "case" for a single task, or the axis of a sweep
    value: str | float | None  # Where on the axis
    trial: int  # Which repetition with other draws
    task: Task  # What every engine gets
    ground_truth: GroundTruth  # What the judge gets
    units: str = ""  # Length unit, "" if unknown


def make_case(
    name: str,
    source: PointCloud,
    target: PointCloud | Mesh,
    start: FloatArray | None,
    truth: TruePoses | None,
    *,
    setting: Setting = "manual",
    noise: float = 0.0,
    loop: SameLoop | None = None,
    threads: int = 2,
    seed: int = 0,
    success_threshold: float = SUCCESS_THRESHOLD,
    units: str = "",
    axis: str = "case",
    value: str | float | None = None,
    trial: int = 0,
) -> BenchmarkCase:
    """Split a scan into what engines get and what is held out, and draw the points of the same loop."""
    # Lengths are converted here; no engine shall do it again.
    source, target = dataclasses.replace(source, units=None), dataclasses.replace(target, units=None)
    held_rng, loop_rng = np.random.default_rng(seed).spawn(2)
    given, held_out = _hold_out(source, held_rng)
    surface: Surface = MeshSurface(target) if isinstance(target, Mesh) else CloudSurface(target)
    size = surface.diagonal
    task = Task(given, target, start, setting, threads=threads, seed=seed)
    if setting == "same-loop":
        if start is None:
            raise InputError("the same loop needs an initial pose; without one use --setting manual")
        task = _same_loop(task, loop or SameLoop(), size, loop_rng)
    truths = np.zeros((0, 4, 4)) if truth is None else truth.poses
    spacing = 0.0 if isinstance(target, Mesh) else measure_spacing(NeighbourTree(target.points), target.points)
    ground_truth = GroundTruth(
        probes=_probes(given, target, truths),
        size=size,
        truths=truths,
        axis=None if truth is None else truth.axis,
        held_out=held_out,
        surface=surface,
        gate=max(5.0 * noise, 1e-3 * size, 2.0 * spacing),
        success_threshold=success_threshold,
    )
    return BenchmarkCase(_key(name, task), name, axis, value, trial, task, ground_truth, units)


def small_copy(task: Task) -> Task:
    """The same task with few scan points, for warming up."""
    return dataclasses.replace(
        task,
        source=task.source._taken(np.arange(0, len(task.source), max(1, len(task.source) // WARMING_POINTS))),
        source_points=None if task.source_points is None else task.source_points[:WARMING_POINTS],
    )


def _hold_out(source: PointCloud, rng: np.random.Generator) -> tuple[PointCloud, FloatArray]:
    held = min(int(HELD_OUT_FRACTION * len(source)), MAX_HELD_OUT)
    chosen = np.zeros(len(source), dtype=bool)
    chosen[rng.choice(len(source), size=held, replace=False)] = True
    return source._taken(~chosen), source.points[chosen]


def _same_loop(task: Task, loop: SameLoop, size: float, rng: np.random.Generator) -> Task:
    target = task.target
    if isinstance(target, Mesh):
        target = sample_mesh(target, loop.target_points, rng)
    target = _subsampled(target, loop.target_points, rng)
    return dataclasses.replace(
        task,
        source_points=_subsampled(task.source, loop.source_points, rng).points,
        target_points=target.points,
        target_normals=_normals(target),
        max_distance=loop.max_distance * size,
        max_iterations=loop.max_iterations,
    )


def _subsampled(cloud: PointCloud, count: int, rng: np.random.Generator) -> PointCloud:
    if len(cloud) <= count:
        return cloud
    return cloud._taken(np.sort(rng.choice(len(cloud), size=count, replace=False)))


def _normals(cloud: PointCloud) -> FloatArray:
    """Normals of the same loop's target: the cloud's own, or estimated once for all engines."""
    if cloud.normals is not None:
        return cloud.normals
    from dqreg.geometry.normals import fit_planes

    return np.nan_to_num(fit_planes(NeighbourTree(cloud.points), cloud.points, cloud.points).normals)


def _probes(given: PointCloud, target: PointCloud | Mesh, truths: FloatArray) -> FloatArray:
    if isinstance(target, Mesh):
        return _few(target.vertices[np.unique(target.faces)])
    # For a target cloud, the part is what was scanned.
    return _few(pose.apply(truths[0], given.points) if len(truths) else target.points)


def _few(points: FloatArray) -> FloatArray:
    return points[:: max(1, -(-len(points) // MAX_PROBES))]


def _key(name: str, task: Task) -> str:
    """Name and fingerprint: files of the same name with other contents are another task."""
    digest = hashlib.blake2b(digest_size=8)
    target = task.target.vertices[task.target.faces] if isinstance(task.target, Mesh) else task.target.points
    for array in (task.source.points, target, np.zeros(0) if task.start is None else task.start):
        digest.update(np.ascontiguousarray(array).tobytes())
    loop = (task.setting, task.max_distance, task.max_iterations, task.threads, task.seed)
    sizes = [None if array is None else len(array) for array in (task.source_points, task.target_points)]
    digest.update(repr((loop, sizes)).encode())
    return f"{name}|{task.setting}|{'none' if task.start is None else 'start'}|{digest.hexdigest()}"
