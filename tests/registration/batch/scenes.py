"""Small manifests: two parts, and scans of them with a known pose."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket, feeder

ROOT = Path(__file__).parents[3]
PARTS = {"bracket": bracket, "feeder": feeder}
# Each process of a test carries it in its environment, so that those left over are found.
TOKEN = "DQREG_TEST_TOKEN"
# A shell that runs tests in the background has its children ignore Ctrl-C.
CODE = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from dqreg.cli.main import console; console()"
)


@dataclasses.dataclass(frozen=True)
class Scene:
    folder: Path
    manifest: Path
    truths: dict[str, Any]


def make_scene(folder: Path, rows: int, points: int = 3_000) -> Scene:
    """Scans drawn from the parts' surfaces, noise 1e-4 S, 4 degrees and 1 % off; the truth is the inverse motion."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    meshes = {name: Mesh(*make()) for name, make in PARTS.items()}
    for name, mesh in meshes.items():
        write_off(folder / f"{name}.off", mesh)
    lines, truths = ["scan,target,start,effort"], {}
    for number in range(rows):
        part = list(PARTS)[number % 2]
        mesh = meshes[part]
        cloud = sample_mesh(mesh, points, rng).points
        cloud = cloud + rng.normal(scale=1e-4 * mesh.diagonal, size=cloud.shape)
        turn, shift = rng.normal(size=(2, 3))
        turn *= np.deg2rad(4.0) / np.linalg.norm(turn)
        shift *= 0.01 * mesh.diagonal / np.linalg.norm(shift)
        T = twist.exp(np.r_[turn, shift])
        np.save(folder / f"scan{number}.npy", pose.apply(T, cloud))
        truths[f"scan{number}"] = pose.inverse(T)
        lines.append(f"scan{number}.npy,{part}.off,identity,fast")
    (folder / "rows.csv").write_text("\n".join(lines) + "\n")
    return Scene(folder, folder / "rows.csv", truths)


def write_off(path: Path, mesh: Mesh) -> None:
    corners = "\n".join(" ".join(map(repr, row)) for row in mesh.vertices.tolist())
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist())
    path.write_text(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n{corners}\n{faces}\n")


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-c", CODE, *map(str, arguments)]


def environment(token: str = "") -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", TOKEN: token}


@contextlib.contextmanager
def started(*arguments: object, token: str = "", **options: Any) -> Iterator[subprocess.Popen[str]]:
    run = subprocess.Popen(
        command(*arguments),
        env=environment(token),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )
    try:
        yield run
    finally:
        run.kill()
        run.wait()
        run.stdout.close()
        run.stderr.close()


def alive(token: str) -> list[int]:
    """Processes that carry a token."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdecimal() and f"{TOKEN}={token}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def all_gone(token: str, seconds: float = 20.0) -> bool:
    deadline = time.monotonic() + seconds
    while alive(token):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def results(out: Path) -> dict[str, Any]:
    """Result files by name, without what is wall time."""
    return {path.stem: without_times(json.loads(path.read_text())) for path in (out / "results").glob("*.json")}


def without_times(record: dict[str, Any]) -> dict[str, Any]:
    history = [{key: value for key, value in each.items() if key != "seconds"} for each in record["history"]]
    batch = {key: value for key, value in record["batch"].items() if key != "seconds"}
    return {**record, "history": history, "batch": batch, "timings": sorted(record["timings"])}


def stamps(out: Path) -> dict[str, tuple[int, int]]:
    """Which file each result is: its inode and time; a result written twice has others."""
    found = {}
    for path in (out / "results").glob("*.json"):
        status = path.stat()
        found[path.stem] = (status.st_ino, status.st_mtime_ns)
    return found


def summary(out: Path) -> list[dict[str, str]]:
    with (out / "summary.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def left_over(out: Path) -> list[str]:
    """Half-written files; those of a kill may stand until the next run."""
    return [str(path) for path in out.rglob("*.tmp")]
