"""Many scans of a part on a turntable: poses in one frame, and their covariance, against the exact truth.

Virtual scans at equal steps of a table; the part lies tilted and off the axis. Errors are of the worst vertex of the
part, after the best common motion of all views, in sizes of the part: of the answer, and of the chain of its pairs.
NEES is the squared error of the poses of neighbours in units of their covariance: 6 where that is right; its 95 %
interval is over seeds where there are several, else over the pairs of neighbours.

    python examples/turntables.py                                    # a part that dqreg generates, from nothing
    python examples/turntables.py part.stl other.stl --seed 202 --start near
    python examples/turntables.py part.stl --seed 300 301 302 --start joint   # near starts, no pairs: refined together
    python examples/turntables.py part.stl --views 12 --foreign other.stl
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import dqreg
from dqreg.files import read_mesh
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.refinement.refine import refined
from dqreg.multiway.scans.scans import read_views, typical_size
from dqreg.multiway.scores import squared_errors, worst_vertices
from dqreg.multiway.visibility.sides import Sides
from dqreg.rigid import pose
from dqreg.synth.many_views import ManyViews, turntable_views
from dqreg.synth.parts import bracket

# Standard deviation of a near start, in radians about each axis of the part and in sizes along it.
OFF = 2e-3, 1e-3
FOREIGN = 2
# Scans that stand together within this share of the size are right: among wrong ones a best common motion says nothing.
RIGHT = 0.01


@dataclasses.dataclass(frozen=True)
class Answer:
    """Poses of all scans, how sure they are, and what was said of them."""

    T: np.ndarray  # (n, 4, 4): T_world_scan
    joint: np.ndarray  # (6 n, 6 n)
    centre: np.ndarray
    level: str
    codes: tuple[str, ...] = ()
    edges: tuple[Edge, ...] = ()


@dataclasses.dataclass(frozen=True)
class Run:
    """What came of one turntable; errors in sizes of the part."""

    part: str
    seed: int
    views: int
    placed: int
    right: int  # Of these, the largest set that stands together as it truly does
    level: str
    codes: tuple[str, ...]
    worst: float
    median: float
    chained: float
    squared: np.ndarray  # NEES of each pair of neighbours
    foreign: int  # Scans of another part that were placed
    cpu_seconds: float


def main(arguments: list[str] | None = None) -> list[Run]:
    """All runs that were asked for, and one line for each."""
    options = _parser().parse_args(arguments)
    runs = []
    for path in options.parts or [None]:
        mesh = dqreg.Mesh(*bracket()) if path is None else _read(path)
        of_part = [_run("bracket" if path is None else path.stem, mesh, seed, options) for seed in options.seed]
        runs += of_part
        if len(of_part) > 1:
            print(f"{of_part[0].part}: NEES of neighbours {_interval([_mean(run.squared) for run in of_part])}")
    _show(runs)
    return runs


def _run(name: str, mesh: dqreg.Mesh, seed: int, options: argparse.Namespace) -> Run:
    rng = np.random.default_rng(seed)
    made = turntable_views((mesh.vertices, mesh.faces), options.views, pixels=options.pixels, rng=rng)
    starts = None if options.start == "none" else _near(made, mesh, rng)
    scans, own = list(made.scans), options.views
    if options.foreign is not None:
        scans += _foreign(_read(options.foreign), mesh.diagonal, options.pixels, rng)
    cpu = time.process_time()
    answer = _jointly(scans[:own], starts) if options.start == "joint" else _registered(scans, starts, options)
    cpu = time.process_time() - cpu
    truth, size = made.T_world_scan, mesh.diagonal
    off = worst_vertices(answer.T[:own], truth, mesh.vertices) / size
    neighbours = [(k, (k + 1) % own) for k in range(own)]
    run = Run(
        part=name,
        seed=seed,
        views=own,
        placed=int(np.isfinite(off).sum()),
        right=_right(answer.T[:own], truth, mesh),
        level=answer.level,
        codes=answer.codes,
        worst=float(np.nanmax(off, initial=0.0)),
        median=float(np.median(off[np.isfinite(off)])),
        chained=_chained(answer.edges, truth, mesh.vertices) / size,
        squared=squared_errors(answer.T, answer.joint, answer.centre, truth, neighbours, size),
        foreign=int(np.isfinite(answer.T[own:, 0, 0]).sum()),
        cpu_seconds=cpu,
    )
    print(_line(run), flush=True)
    return run


def _registered(scans: list[np.ndarray], starts: list[np.ndarray] | None, options: argparse.Namespace) -> Answer:
    """What a user gets."""
    if starts is not None:
        starts = [*starts, *([None] * (len(scans) - len(starts)))]
    result = dqreg.register_many(scans, starts=starts, edges=options.edges, order="turntable", effort=options.effort)
    verdict = result.verdict
    return Answer(result.T_world_scan, result.joint, result.centre, verdict.level, verdict.codes, result.edges)


def _jointly(scans: list[np.ndarray], starts: list[np.ndarray]) -> Answer:
    """The joint refinement of all scans from where they are: no pairs, no verdict."""
    views = read_views(scans, 0)
    bodies, T = Sides.of(views, "turntable").bodies, np.stack(starts)
    found = refined(views, bodies, None, T, 0, typical_size(views), "normal", on_table=True)
    return Answer(found.T_world_scan, found.covariance, found.centre, "-" if found.converged else "not converged")


def _read(path: Path) -> dqreg.Mesh:
    data = read_mesh(path)
    return dqreg.Mesh(data.vertices, data.faces)


def _near(made: ManyViews, mesh: dqreg.Mesh, rng: np.random.Generator) -> list[np.ndarray]:
    """The true poses, each moved a little about the part's centre."""
    centre = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    scale = np.r_[np.full(3, OFF[0]), np.full(3, OFF[1] * mesh.diagonal)]
    return [pose.about(pose.exp(scale * rng.normal(size=6)), centre) @ T for T in made.T_world_scan]


def _foreign(other: dqreg.Mesh, size: float, pixels: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Two scans of another part, of the same size: or the size alone would tell."""
    shape = other.vertices * (size / other.diagonal), other.faces
    return list(turntable_views(shape, 12, pixels=pixels, rng=rng).scans[:FOREIGN])


def _right(T: np.ndarray, truth: np.ndarray, mesh: dqreg.Mesh) -> int:
    """How many views stand together within a share of the size, seen from that one with which most do."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    moved = np.stack([pose.apply(E, corners) for E in T @ pose.inverse(truth)])
    off = np.linalg.norm(moved[:, None] - moved[None], axis=3).max(axis=2)
    return int((off <= RIGHT * mesh.diagonal).sum(axis=1).max())


def _chained(edges: Sequence[Edge], truth: np.ndarray, vertices: np.ndarray) -> float:
    """Worst vertex of the poses that neighbours give one after the other; NaN where a pair has none."""
    steps = {(edge.target, edge.source): edge.registration.T_target_source for edge in edges if edge.found}
    T = [np.eye(4)]
    for k in range(1, len(truth)):
        back = steps.get((k, k - 1))
        step = steps.get((k - 1, k), np.full((4, 4), np.nan) if back is None else pose.inverse(back))
        T.append(T[-1] @ step)
    off = worst_vertices(np.stack(T), truth, vertices)
    return float(off.max()) if np.isfinite(off).all() else np.nan


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan


def _interval(values: np.ndarray | list[float]) -> str:
    """Mean and the normal 95 % interval of it."""
    known = np.asarray(values)[np.isfinite(values)]
    if len(known) < 2:
        return "-" if not len(known) else f"{known[0]:.1f}"
    half = 1.96 * known.std(ddof=1) / np.sqrt(len(known))
    return f"{known.mean():.1f} ({known.mean() - half:.1f} to {known.mean() + half:.1f})"


def _line(run: Run) -> str:
    return (
        f"{run.part} seed {run.seed}: {run.placed} of {run.views} placed, {run.right} right, {run.level}"
        f"{' (' + ', '.join(run.codes) + ')' if run.codes else ''}, worst vertex {1e4 * run.worst:.2f}e-4, "
        f"median {1e4 * run.median:.2f}e-4, chained {1e4 * run.chained:.1f}e-4, NEES {_interval(run.squared)}, "
        f"{run.foreign} foreign placed, {run.cpu_seconds:.1f} s of CPU"
    )


def _show(runs: list[Run]) -> None:
    table = Table(
        "part", "seed", "placed", "right", "verdict", "worst vertex", "median", "chained", "NEES", "foreign", "CPU s"
    )
    for run in runs:
        table.add_row(
            run.part,
            str(run.seed),
            f"{run.placed}/{run.views}",
            str(run.right),
            run.level,
            *(f"{1e4 * value:.2f}e-4" for value in (run.worst, run.median, run.chained)),
            _interval(run.squared),
            str(run.foreign),
            f"{run.cpu_seconds:.1f}",
        )
    Console(width=140).print(table)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", type=Path, help="meshes; default: a generated bracket")
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--pixels", type=int, default=150, help="along each side of an image")
    parser.add_argument("--seed", type=int, nargs="+", default=[202])
    parser.add_argument("--start", choices=["none", "near", "joint"], default="none")
    parser.add_argument("--edges", choices=["ring", "auto"], default="auto")
    parser.add_argument("--foreign", type=Path, help="a part of which two scans are mixed in")
    parser.add_argument("--effort", choices=["fast", "normal", "best"], default="normal")
    return parser


if __name__ == "__main__":
    main()
