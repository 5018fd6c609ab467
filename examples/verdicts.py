"""How often the verdict is right: good tasks ought to be accepted, bad ones not, and for the right reason.

Virtual scans with a stated seed. A bad task whose pose comes out right all the same is dropped and counted.

    python examples/verdicts.py                              # parts that dqreg generates, three seeds
    python examples/verdicts.py part.stl other.stl --seeds 10
"""

from __future__ import annotations

import argparse
import dataclasses
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import dqreg
from dqreg.files import read_mesh
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import box, bracket, cylinder

TWO_VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
ONE_VIEW = [(0.8, 0.6, 1.0)]
NOISE = 3e-4
WRONG = 0.02


@dataclasses.dataclass(frozen=True)
class Task:
    """A scan, a target, a start, and codes of which one ought to be among the reasons of a refusal."""

    kind: str
    good: bool
    source: np.ndarray
    target: dqreg.Mesh
    start: np.ndarray | str | None
    T_truth: np.ndarray | None
    codes: tuple[str, ...] = ()


MISFIT = (
    *("low_inlier_fraction", "large_residuals", "deviating_patches", "disagreeing_normals", "few_inliers", "stretched"),
    *("no_correspondences", "degenerate_correspondences", "too_few_points", "no_pose"),
)
EXPECTED = {
    "another part": MISFIT,
    "mirrored part": MISFIT,
    "no overlap": MISFIT,
    "wrong units": ("UnitsError", *MISFIT),
    "wrong minimum": (*MISFIT, "alternative_poses"),
    "plane only": ("unconstrained",),
    "cylinder only": ("unconstrained",),
    "60 % strays": ("outliers", *MISFIT),
}


def size_of(vertices: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def scan(mesh: tuple, rng: np.random.Generator, views: list, noise: float = NOISE, pixels: int = 250) -> np.ndarray:
    vertices, faces = mesh
    sigma = Noise(range_sigma=noise * size_of(vertices))
    return scan_mesh(vertices, faces, Scanner(views, pixels=pixels), sigma, rng=rng).points


def with_strays(points: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.75 * (high - low).max()
    count = round(len(points) * share / (1.0 - share))
    return np.vstack([points, rng.uniform(middle - half, middle + half, (count, 3))])


def good_tasks(mesh: tuple, rng: np.random.Generator) -> Iterator[Task]:
    vertices, faces = mesh
    part, size = dqreg.Mesh(vertices, faces), size_of(vertices)
    scans = {
        "two views": scan(mesh, rng, TWO_VIEWS),
        "one view": scan(mesh, rng, ONE_VIEW),
        "noise 1e-3": scan(mesh, rng, TWO_VIEWS, 1e-3),
        "10 % strays": with_strays(scan(mesh, rng, TWO_VIEWS), 0.1, rng),
        "30 % strays": with_strays(scan(mesh, rng, TWO_VIEWS), 0.3, rng),
    }
    for kind, points in scans.items():
        T = disturbance(rng, np.deg2rad(8.0), 0.03 * size, vertices.mean(axis=0))
        yield Task(kind, True, pose.apply(pose.inverse(T), points), part, "identity", T)


def bad_tasks(mesh: tuple, others: list[tuple], rng: np.random.Generator) -> Iterator[Task]:
    vertices, faces = mesh
    part, size, centre = dqreg.Mesh(vertices, faces), size_of(vertices), vertices.mean(axis=0)
    points = scan(mesh, rng, TWO_VIEWS)

    def moved(cloud: np.ndarray, degrees: float = 8.0, shift: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
        T = disturbance(rng, np.deg2rad(degrees), shift * size, centre)
        return pose.apply(pose.inverse(T), cloud), T

    if others:
        other = others[rng.integers(len(others))]
        alike = (other[0] - other[0].mean(axis=0)) * (size / size_of(other[0])) + centre
        yield Task("another part", False, moved(scan((alike, other[1]), rng, TWO_VIEWS))[0], part, None, None)
    if not mirror_symmetric(part):
        mirrored = vertices * [-1.0, 1.0, 1.0] + [2 * centre[0], 0.0, 0.0]
        yield Task("mirrored part", False, moved(scan((mirrored, faces[:, ::-1]), rng, TWO_VIEWS))[0], part, None, None)
    yield Task("no overlap", False, points + np.array([1.5 * size, 0.0, 0.0]), part, "identity", None)
    source, T = moved(points)
    yield Task("wrong units", False, source / 1000.0, part, None, None)
    turned, T = moved(points, rng.uniform(60.0, 180.0), 0.1)
    yield Task("wrong minimum", False, turned, part, "identity", T)
    # The largest flat face alone; and, below, a shaft without its ends.
    normals = part.face_normals
    areas = np.array([part.face_areas[normals @ n > 0.9999].sum() for n in normals])
    flat = normals @ normals[areas.argmax()] > 0.9999
    on_face = dqreg.geometry.sample_mesh(dqreg.Mesh(vertices, faces[flat]), 8_000, rng).points
    on_face = on_face + NOISE * size * rng.normal(size=on_face.shape)
    middle = on_face.mean(axis=0)
    inner = on_face[np.linalg.norm(on_face - middle, axis=1) < 0.1 * size]
    if len(inner) > 300:
        yield Task("plane only", False, moved(inner, 2.0, 0.005)[0], part, "identity", None)
    yield Task("60 % strays", False, moved(with_strays(points, 0.6, rng))[0], part, "identity", T)
    shaft = dqreg.Mesh(*cylinder(diameter=0.4, height=1.0))
    side = dqreg.geometry.sample_mesh(shaft, 8_000, rng).points
    side = side[np.abs(side[:, 2]) < 0.4] + NOISE * shaft.diagonal * rng.normal(
        size=(np.sum(np.abs(side[:, 2]) < 0.4), 3)
    )
    T = disturbance(rng, np.deg2rad(4.0), 0.02, np.zeros(3))
    yield Task("cylinder only", False, pose.apply(pose.inverse(T), side), shaft, "identity", None)


def mirror_symmetric(part: dqreg.Mesh) -> bool:
    points = dqreg.geometry.sample_mesh(part, 20_000, np.random.default_rng(0)).points
    result = dqreg.register(points * [-1.0, 1.0, 1.0], part, effort="fast")
    if not np.isfinite(result.rms):
        return False
    surface = dqreg.geometry.MeshSurface(part)
    distances = surface.closest(result.apply(points * [-1.0, 1.0, 1.0])).distances
    return float(np.mean(distances > 0.005 * part.diagonal)) < 0.02


def judge(task: Task) -> tuple[str, str, bool]:
    """Level, first reason, and whether the reason is a right one."""
    try:
        result = dqreg.register(task.source, task.target, task.start, effort="fast")
    except dqreg.DqregError as error:
        return "error", str(error), type(error).__name__ in task.codes
    if task.T_truth is not None:
        off = worst_vertex_displacement(result.T_target_source, task.T_truth, task.target.vertices)
        right = off <= WRONG * task.target.diagonal
        if task.kind == "wrong minimum" and (right or explains_as_well(result, task)):
            return "dropped", "the pose came out right", True
        if task.good and not right:
            return (
                result.verdict.level,
                f"WRONG POSE {off / task.target.diagonal:.1e}: {result.verdict.reasons[0]}",
                True,
            )
    return result.verdict.level, result.verdict.reasons[0], bool(set(task.codes) & set(result.verdict.codes))


def explains_as_well(result: dqreg.Registration, task: Task) -> bool:
    if not np.isfinite(result.rms):
        return False
    surface = dqreg.geometry.MeshSurface(task.target)
    mean = [
        float(np.minimum(surface.closest(pose.apply(T, task.source)).distances, WRONG * task.target.diagonal).mean())
        for T in (result.T_target_source, task.T_truth)
    ]
    return mean[0] <= 1.1 * mean[1]


def main(paths: list[str], seeds: int = 3, verbose: bool = False, first_seed: int = 0) -> dict[str, Counter]:
    parts = [(read_mesh(p).vertices, read_mesh(p).faces) for p in paths] or [bracket(), box((3.0, 2.0, 1.0))]
    names = [Path(p).stem for p in paths] or ["bracket", "box"]
    rows: dict[tuple[bool, str], Counter] = {}
    for seed in range(first_seed, first_seed + seeds):
        for i, mesh in enumerate(parts):
            rng = np.random.default_rng([seed, i])
            for task in [*good_tasks(mesh, rng), *bad_tasks(mesh, parts[:i] + parts[i + 1 :], rng)]:
                task = dataclasses.replace(task, codes=EXPECTED.get(task.kind, ()))
                level, reason, right = judge(task)
                row = rows.setdefault((task.good, task.kind), Counter())
                row[level] += 1
                row["right reason"] += level != "accepted" and right and level != "dropped"
                if verbose and (level == "accepted") != task.good and level != "dropped":
                    print(names[i], seed, task.kind, level, reason)
    show(rows)
    return {kind: count for (_, kind), count in rows.items()}


def show(rows: dict[tuple[bool, str], Counter]) -> None:
    levels = ("accepted", "suspect", "failed", "error", "dropped")
    table = Table("tasks", "kind", *levels, "right reason", box=None)
    for good in (True, False):
        total: Counter = Counter()
        for (is_good, kind), count in rows.items():
            if is_good is good:
                table.add_row(
                    "good" if good else "bad",
                    kind,
                    *(str(count[x]) for x in levels),
                    "" if good else str(count["right reason"]),
                )
                total += count
        table.add_row(
            "good" if good else "bad",
            "all",
            *(str(total[x]) for x in levels),
            "" if good else str(total["right reason"]),
            style="bold",
        )
    Console().print(table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0, help="the verdict's limits were set on seeds 0 to 7")
    parser.add_argument("--verbose", action="store_true", help="print each verdict that is wrong")
    arguments = parser.parse_args()
    main(arguments.parts, arguments.seeds, arguments.verbose, arguments.first_seed)
