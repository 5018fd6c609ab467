"""Poses from nothing: how often dqreg, FPFH with RANSAC, FGR and KISS-Matcher find a part, on the same scans.

Virtual scans of a part from random views, at random poses. Right is a pose whose worst vertex is within 2 % of the
part's size of the truth; or one that a symmetry of the part turns into the truth, to 0.1 % of the size; or one that
explains a second, denser scan from the same views as well as the truth does, where they do not show what tells them
apart: mean log-likelihood of the exact distances within 0.01 of the truth's.
Seconds are per scan, of search and refinement together; what is prepared once a part (tables, samples, features) is
not counted for anyone.

    python examples/from_nothing.py                                      # parts that ship with dqreg, two seeds
    python examples/from_nothing.py parts/ --seeds 10 --cells two,one,noise,strays --methods dqreg,ransac,fgr,kiss
    python examples/from_nothing.py parts/ --keep runs.jsonl             # what the file holds is not run again
    python examples/from_nothing.py --real DATA --methods dqreg,ransac   # real scans whose pose is known

Cells: two views; one view; two views with noise of 3e-3 of the size instead of 3e-4; two views with 30 % of strays.
On real scans right is a root mean square error of the judged points (the whole source, or the part in a scene) within
2 % of the smaller side. "overlap" is the share of them that have a target within 1 % of that size at the true pose.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

# These stand beside this file.
from kept_runs import NO_VERDICT, Keeper, Run, as_markdown, on_screen, rows_of
from peers import missing_peers, peers_of
from random_views import CELLS, JUDGES, NEAR, is_right, make_case
from real_pairs import Pair, real_pairs
from rich.console import Console

import dqreg
from dqreg.files import read_mesh
from dqreg.rigid import pose
from dqreg.synth import worst_vertex_displacement
from dqreg.synth.parts import box, bracket, plate

MESHES = {".stl", ".ply", ".obj", ".off", ".3mf", ".glb"}
METHODS = ("dqreg", "ransac", "fgr", "kiss")

# From the points of a scan to the pose, the level of the verdict and the seconds of the search.
Answer = tuple[np.ndarray, str, float | None]


def main(arguments: list[str] | None = None) -> list[Run]:
    """All runs that were asked for, those of the file included."""
    options = _parser().parse_args(arguments)
    missing = missing_peers(options.methods)
    if missing:
        raise SystemExit(f"pip install {' '.join(missing)}, or leave the method out")
    keeper = Keeper(options.keep)
    runs = list((_real if options.real is not None else _virtual)(options, keeper))
    rows = rows_of(runs, options.apart)
    if options.markdown:
        print(as_markdown(rows))
    else:
        Console(width=140).print(on_screen(rows, "poses from nothing"))
    return runs


def _virtual(options: argparse.Namespace, keeper: Keeper) -> Any:
    racers: dict[str, _Racers] = {}
    shapes = _shapes(options.parts)
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for cell in options.cells:
            for name, mesh in shapes.items():
                left = [m for m in options.methods if not keeper.has(name, cell, seed, m)]
                if left and name not in racers:
                    racers[name] = _Racers(mesh, mesh.diagonal, options.methods, "fast")
                case = make_case(mesh, seed, CELLS[cell], options.pixels) if left else None
                for method in left:
                    T, timed = racers[name].run(method, case.points)
                    right = is_right(T, case, mesh, racers[name].target)
                    error = worst_vertex_displacement(T, case.T_truth, mesh.vertices) / mesh.diagonal
                    keeper.add(Run(name, cell, seed, method, right, error=_finite(error), **timed))
                    print(keeper.runs[name, cell, seed, method].line, flush=True)
                yield from (keeper.runs[name, cell, seed, m] for m in options.methods)


def _real(options: argparse.Namespace, keeper: Keeper) -> Any:
    for pair in real_pairs(options.real):
        if options.only not in pair.name:
            continue
        left = [m for m in options.methods if not keeper.has(pair.name, "real", 0, m)]
        racers = _Racers(pair.target, pair.size, left, "normal") if left else None
        for method in left:
            T, timed = racers.run(method, pair.source)
            moved = [pose.apply(each, pair.judged) for each in (T, pair.T_truth)]
            error = float(np.sqrt(((moved[0] - moved[1]) ** 2).sum(axis=1).mean())) / pair.size
            note = f"overlap {100 * _overlap(pair, racers.target):.0f} %"
            keeper.add(Run(pair.name, "real", 0, method, error <= NEAR, error=_finite(error), note=note, **timed))
            print(f"{keeper.runs[pair.name, 'real', 0, method].line}, {error:.4f} S off, {note}", flush=True)
        yield from (keeper.runs[pair.name, "real", 0, m] for m in options.methods)


class _Racers:
    """The methods, prepared for one target."""

    def __init__(self, geometry: dqreg.Mesh | dqreg.PointCloud, size: float, methods: list[str], effort: str) -> None:
        began = time.perf_counter()
        self.target = dqreg.prepare_target(geometry)
        if "dqreg" in methods:
            _ = self.target.pairs.symmetry
        self.prepare_seconds = time.perf_counter() - began
        peers = peers_of(geometry, size, [m for m in methods if m != "dqreg"])
        self.methods: dict[str, Callable[[np.ndarray], Answer]] = {
            "dqreg": lambda points: self._ours(points, effort),
            **{name: self._without_verdict(peer) for name, peer in peers.items()},
        }

    def run(self, method: str, points: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
        wall, cpu = time.perf_counter(), time.process_time()
        T, verdict, search = self.methods[method](points)
        seconds = {"cpu_seconds": time.process_time() - cpu, "wall_seconds": time.perf_counter() - wall}
        ours = {"search_seconds": search, "prepare_seconds": self.prepare_seconds} if method == "dqreg" else {}
        return T, {"verdict": verdict, **seconds, **ours, "T_target_source": tuple(T.ravel().tolist())}

    def _ours(self, points: np.ndarray, effort: str) -> Answer:
        result = self.target.register(points, effort=effort)
        return result.T_target_source, result.verdict.level, result.timings["start"]

    @staticmethod
    def _without_verdict(peer: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], Answer]:
        def run(points: np.ndarray) -> Answer:
            try:
                return peer(points), NO_VERDICT, None
            except RuntimeError:
                return np.full((4, 4), np.nan), NO_VERDICT, None

        return run


def _overlap(pair: Pair, target: dqreg.Target) -> float:
    some = pair.judged[:: max(1, len(pair.judged) // JUDGES)]
    distances = target.indexed.surface.closest(pose.apply(pair.T_truth, some) - target.indexed.origin).distances
    return float((distances < 0.01 * pair.size).mean())


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _shapes(paths: list[Path]) -> dict[str, dqreg.Mesh]:
    if not paths:
        made = {"bracket": bracket(), "box": box((5.0, 3.0, 2.0)), "plate": plate()}
        return {name: dqreg.Mesh(*shape) for name, shape in made.items()}
    files = [f for p in paths for f in (sorted(p.iterdir()) if p.is_dir() else [p])]
    meshes = [f for f in files if f.suffix.lower() in MESHES]
    read = {f.name: read_mesh(f) for f in meshes}
    return {name: dqreg.Mesh(data.vertices, data.faces) for name, data in read.items()}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("parts", nargs="*", type=Path, help="meshes, or folders of meshes")
    parser.add_argument("--seeds", type=int, default=2, help="random poses a part")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--cells", type=_some_of(tuple(CELLS)), default=["two"], help=",".join(CELLS))
    parser.add_argument("--methods", type=_some_of(METHODS), default=["dqreg"], help=",".join(METHODS))
    parser.add_argument("--pixels", type=int, default=200, help="pixels along one side of a view")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="one JSON line a run; runs that it holds are done")
    parser.add_argument("--markdown", action="store_true", help="the table at the end as Markdown")
    parser.add_argument("--apart", nargs="+", default=[], metavar="NAME", help="parts with rows of their own as well")
    parser.add_argument("--real", type=Path, metavar="DATA", help="real scans in the folders of DATA instead")
    parser.add_argument("--only", default="", help="with --real: pairs whose name holds this")
    return parser


def _some_of(known: tuple[str, ...]) -> Callable[[str], list[str]]:
    def read(text: str) -> list[str]:
        names = text.split(",")
        for name in names:
            if name not in known:
                raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(known)}")
        return names

    return read


if __name__ == "__main__":
    main(sys.argv[1:])
