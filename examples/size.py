"""Time and peak memory of one registration with all deviations, from ten thousand to millions of scan points.

``python examples/size.py --points 1e4,1e5,1e6 --faces 1e6 [--effort normal] [--from-nothing] [--out size]``

Each size is made in one process and registered in another, which reads both sides from files, as a user would; what
is measured is that second process, with Python, reading, verdict and the signed deviations of every point. The part is
the bracket that ships with dqreg with a faint relief, so that no two faces lie in one plane; the scan is what a sensor
on one side of it sees, with noise of 1e-4 S (S: diagonal of the part), 8 degrees and 3 % of S off. SIZE.png, SIZE.md
and SIZE.json are written.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import dqreg
from dqreg.rigid import pose

CHUNK = 1_000_000
NOISE, TURN_DEG, SHIFT, RELIEF = 1e-4, 8.0, 0.03, 2e-4
# Linux counts in KiB, macOS in bytes.
RSS_UNIT = 1 if sys.platform == "darwin" else 1024


def make_part(faces: int) -> dqreg.Mesh:
    """Bracket in about as many faces, each quartered from the last, with a faint relief."""
    from trimesh.remesh import subdivide

    from dqreg.synth.parts import bracket

    vertices, triangles = bracket()
    while 2 * len(triangles) < faces:
        vertices, triangles = subdivide(vertices, triangles)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    waves = np.sin(vertices @ (np.array([[31.0, 17.0, 11.0], [7.0, 29.0, 13.0], [19.0, 5.0, 23.0]]).T / size))
    return dqreg.Mesh(vertices + RELIEF * size * waves, triangles)


def make_case(folder: Path, points: int, faces: int, seed: int = 0) -> None:
    """Write part.stl, scan.npy and the two poses."""
    import trimesh

    part, rng = make_part(faces), np.random.default_rng(seed)
    trimesh.Trimesh(part.vertices, part.faces, process=False).export(folder / "part.stl")
    truth = pose.random(rng, reach=part.diagonal)
    scan = np.lib.format.open_memmap(folder / "scan.npy", "w+", dtype=np.float64, shape=(points, 3))
    done = 0
    while done < points:
        some = dqreg.geometry.sample_mesh(part, min(CHUNK, 2 * points + 1000), rng)
        seen = some.points[some.normals @ np.array([0.5, 0.3, 0.8]) > 0.1][: points - done]
        scan[done : done + len(seen)] = pose.apply(
            pose.inverse(truth), seen + rng.normal(scale=NOISE * part.diagonal, size=seen.shape)
        )
        done += len(seen)
    scan.flush()
    turn, shift = rng.normal(size=(2, 3))
    off = pose.from_parts(
        pose.exp(np.r_[np.deg2rad(TURN_DEG) * turn / np.linalg.norm(turn), np.zeros(3)])[:3, :3],
        SHIFT * part.diagonal * shift / np.linalg.norm(shift),
    )
    middle = 0.5 * (part.vertices.min(axis=0) + part.vertices.max(axis=0))
    np.savetxt(folder / "truth.txt", truth)
    np.savetxt(folder / "start.txt", pose.about(off, middle) @ truth)


def measure(folder: Path, effort: str, from_nothing: bool) -> dict[str, Any]:
    """Register the files of a folder, with the deviations of every point."""
    began, began_cpu, idle = time.perf_counter(), time.process_time(), _peak()
    start = None if from_nothing else np.loadtxt(folder / "start.txt")
    result = dqreg.register(folder / "scan.npy", folder / "part.stl", start, effort=effort)
    registered, registered_cpu, peak = time.perf_counter() - began, time.process_time() - began_cpu, _peak()
    summary = result.deviations().summary()
    # Before the part is read once more for the judgement.
    every, every_cpu, every_peak = time.perf_counter() - began, time.process_time() - began_cpu, _peak()
    truth = np.loadtxt(folder / "truth.txt")
    part = dqreg.files.read_mesh(folder / "part.stl")
    size = float(result.settings["diagonal"])
    return {
        "register_s": registered,
        "register_cpu_s": registered_cpu,
        "all_s": every,
        "all_cpu_s": every_cpu,
        "idle_bytes": idle,
        "register_bytes": peak,
        "all_bytes": every_peak,
        "input_bytes": sum((folder / name).stat().st_size for name in ("scan.npy", "part.stl")),
        "faces": len(part.faces),
        "verdict": result.verdict.level,
        "worst_vertex_1e6_s": 1e6
        * dqreg.synth.worst_vertex_displacement(result.T_target_source, truth, part.vertices)
        / size,
        "deviation_rms_1e6_s": 1e6 * summary.rms / size,
        "deviations": summary.count + summary.beyond,
        "timings": result.timings,
    }


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RSS_UNIT


def run_sizes(counts: list[int], faces: int, options: argparse.Namespace) -> list[dict[str, Any]]:
    """One row a size, each made and measured in processes of their own."""
    rows = []
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            here = [sys.executable, __file__, "--folder", folder, "--effort", options.effort]
            if options.from_nothing:
                here.append("--from-nothing")
            subprocess.run([*here, "--make", str(count), "--faces", str(faces)], check=True)
            answer = subprocess.run([*here, "--measure"], check=True, capture_output=True, text=True)
        rows.append({"points": count, **json.loads(answer.stdout)})
        print(row_words(rows[-1]), flush=True)
    return rows


def row_words(row: dict[str, Any]) -> str:
    """One size in a line of Markdown."""
    per_point = (row["all_bytes"] - row["idle_bytes"]) / row["points"]
    cells = [
        f"{row['points']:,}",
        f"{row['faces']:,}",
        f"{row['register_s']:.1f} s",
        f"{row['all_s']:.1f} s",
        f"{row['all_cpu_s']:.1f} s",
        f"{row['register_bytes'] / 2**30:.2f} GiB",
        f"{row['all_bytes'] / 2**30:.2f} GiB",
        f"{per_point:,.0f} bytes",
        f"{row['worst_vertex_1e6_s']:.1f}e-6 S",
        row["verdict"],
    ]
    return f"| {' | '.join(cells)} |"


HEAD = (
    "| points | faces | register | with deviations | of it CPU | peak, register | peak, all | above idle per point | "
    "worst vertex | verdict |\n|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|"
)


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Both curves, with slope one beside each."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    counts = np.array([row["points"] for row in rows])
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    for key, words, colour in (("register_s", "registration", "#1f77c9"), ("all_s", "with deviations", "#e69f00")):
        left.loglog(counts, [row[key] for row in rows], "o-", color=colour, label=words)
    left.set(xlabel="scan points", ylabel="wall time [s]", title="Time")
    for key, words, colour in (
        ("register_bytes", "registration", "#1f77c9"),
        ("all_bytes", "with deviations", "#e69f00"),
        ("input_bytes", "both files", "#7d8590"),
    ):
        right.loglog(counts, [row[key] / 2**30 for row in rows], "o-", color=colour, label=words)
    right.set(xlabel="scan points", ylabel="peak memory [GiB]", title="Memory")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    figure.savefig(path, dpi=120)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--points", default="1e4,1e5,1e6")
    parser.add_argument("--faces", type=float, default=1e6)
    parser.add_argument("--effort", default="normal")
    parser.add_argument("--from-nothing", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("size"), help="name of the files without their endings")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--make", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.make is not None:
        make_case(options.folder, options.make, int(options.faces))
        return
    if options.measure:
        print(json.dumps(measure(options.folder, options.effort, options.from_nothing)))
        return
    print(HEAD)
    counts = [int(float(text)) for text in options.points.split(",")]
    rows = run_sizes(counts, int(options.faces), options)
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}, effort {options.effort}"
    table = "\n".join([HEAD, *map(row_words, rows), "", machine, ""])
    options.out.with_suffix(".md").write_text(table, encoding="utf-8")
    options.out.with_suffix(".json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    draw(rows, options.out.with_suffix(".png"))
    print(f"wrote {', '.join(str(options.out.with_suffix(end)) for end in ('.md', '.json', '.png'))}")


if __name__ == "__main__":
    main()
