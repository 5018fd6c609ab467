"""Damaged files of every kind that is read: each is read soundly, or refused by an `InputError`."""

from __future__ import annotations

import dataclasses
import io
import json
import tempfile
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.compare.store import Store
from dqreg.compare.sweep_file import read_sweep
from dqreg.compare.truth import read_truth
from dqreg.errors import DqregError
from dqreg.files import read_geometry
from dqreg.files.poses import read_pose, read_start
from dqreg.geometry import Mesh
from dqreg.geometry.opening import as_geometry
from dqreg.odometry.scans import open_scans
from dqreg.odometry.trajectory import read_trajectory
from dqreg.registration.batch import Defaults, read_manifest
from dqreg.registration.batch.line import line_of
from dqreg.registration.batch.row import BATCH, RowResult
from dqreg.registration.batch.summary import summary_csv, to_html
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.registration.target import Target, prepare_target
from dqreg.synth import demo_case, load_case
from dqreg.synth.recipe import read_recipe
from tests.hostile.good_files import FACES, POINTS, VERTICES, gltf_tree, good_files, npy
from tests.hostile.mutations import mutated
from tests.hostile.test_files import assert_sound
from tests.registration.result.test_result import good

SEED = 2_000
EACH, SOAK = 67, 3_300


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of file: good ones, and what reads one."""

    file: str
    make: Callable[[], list[bytes]]
    read: Callable[[Path], object]

    @property
    def seeds(self) -> list[bytes]:
        """Good files, made when a test asks for them: every worker knows the names."""
        return self.make()


def _geometry(path: Path) -> None:
    assert_sound(read_geometry(path))
    as_geometry(path, "scan")


def _result(path: Path) -> None:
    found = Registration.load(path)
    record = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    _ = repr(found), found.scale, found.scale_sigma, found.verdict.codes, found._repr_html_()
    row = read_manifest(path.parent / "rows.csv")[0]
    line = line_of(row, RowResult("ran", "", {**record, BATCH: {"seconds": 1.0}}))
    _ = summary_csv([line]), to_html("t", [line])


def _target(path: Path) -> None:
    indexed = Target.load(path).indexed
    assert np.isfinite(indexed.origin).all()
    found = indexed.surface.closest(np.zeros((2, 3)))
    assert np.isfinite(found.points).all()


def _frames(path: Path) -> None:
    scans = open_scans(path)
    for number in range(min(len(scans), 3)):
        frame = scans[number]
        assert frame.points.ndim == 2
        assert frame.timestamps is None or len(frame.timestamps) == len(frame.points)


def _poses(path: Path) -> None:
    assert read_pose(path).shape == (4, 4)
    read_start(path)


def _trajectory(path: Path) -> None:
    poses, times = read_trajectory(path)
    assert np.isfinite(poses).all()
    assert times is None or len(times) == len(poses)


def _case(path: Path) -> None:
    load_case(path.parent)
    read_truth(path)


def _npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def scan() -> np.ndarray:
    return np.tile(POINTS, (4, 1)) + np.arange(48)[:, None] * [0.01, 0.02, 0.005]


@cache
def results() -> list[bytes]:
    registered = register(scan(), Mesh(VERTICES, FACES), "identity", effort="fast", max_iterations=3)
    return [json.dumps(each.to_dict()).encode() for each in (registered, good(source_scale=1.0, target_units="mm"))]


@cache
def saved(of_mesh: bool) -> list[bytes]:
    """A prepared target as a file."""
    with tempfile.TemporaryDirectory() as folder:
        prepare_target(Mesh(VERTICES, FACES) if of_mesh else scan()).save(Path(folder) / "a.npz")
        return [(Path(folder) / "a.npz").read_bytes()]


@cache
def kinds() -> dict[str, Kind]:
    """Every kind, by name."""
    by_suffix: dict[str, list[bytes]] = {}
    for suffix, content in good_files().values():
        by_suffix.setdefault(suffix, []).append(content)
    by_suffix[".gltf"] = [json.dumps(gltf_tree("data.bin")[0]).encode()]
    found = {suffix: Kind(f"a{suffix}", partial(list, seeds), _geometry) for suffix, seeds in by_suffix.items()}
    folder = demo_case()
    text = "".join(" ".join(map(str, row)) + "\n" for row in np.eye(4))
    tum = "0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0.7071 0.7071\n"
    kitti = "1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 1 1 0 0 0 0 0 1 0\n"
    rows = "scan,target,name,start,effort,time_limit,dof,seed\nscan.npy,part.obj,a,identity,fast,5,rz tx,1\n"
    recipes = sorted((Path(__file__).parents[2] / "datasets_synth" / "recipes").glob("*.toml"))
    frames = np.concatenate([POINTS, POINTS])
    return found | {
        "result": Kind("a.json", results, _result),
        "target, mesh": Kind("a.npz", partial(saved, True), _target),
        "target, cloud": Kind("a.npz", partial(saved, False), _target),
        "pose, json": Kind("a.json", results, _poses),
        "pose, text": Kind("a.txt", lambda: [text.encode(), text.replace(" ", ",").encode()], _poses),
        "pose, npy": Kind("a.npy", lambda: [npy(np.eye(4))], _poses),
        "recipe": Kind("a.toml", lambda: [file.read_bytes() for file in recipes], read_recipe),
        "manifest": Kind("a.csv", lambda: [rows.encode()], read_manifest),
        "manifest with a target": Kind(
            "b.csv",
            lambda: [rows.replace("part.obj", "").encode()],
            lambda path: read_manifest(path, Defaults(path.parent / "part.obj")),
        ),
        "trajectory": Kind("a.txt", lambda: [tum.encode(), kitti.encode()], _trajectory),
        "frame times": Kind("times.txt", lambda: [b"0.0\n0.1\n"], lambda path: _frames(path.parent / "frames")),
        "frame, bin": Kind(
            "frames/0.bin", lambda: [np.c_[POINTS, POINTS[:, :1]].tobytes()], lambda path: _frames(path.parent)
        ),
        "frame, npz": Kind(
            "one/0.npz", lambda: [_npz(points=POINTS, timestamps=np.arange(12.0))], lambda path: _frames(path.parent)
        ),
        "sequence": Kind(
            "a.npz",
            lambda: [
                _npz(
                    points=(1000 * frames).astype(np.int16),
                    offsets=np.array([0, 12, 24]),
                    scale=np.float64(1e-3),
                    timestamps=np.arange(24.0),
                    times=np.arange(2.0),
                )
            ],
            _frames,
        ),
        "truth": Kind("case/truth.json", lambda: [(folder / "truth.json").read_bytes()], _case),
        "sweep": Kind(
            "a.toml",
            lambda: [b'title = "t"\ntimeout = 5\n[base]\npart = "bracket"\n[axis.noise]\nvalues = [0.0, 0.1]\n'],
            read_sweep,
        ),
        "runs": Kind(
            "a.jsonl", lambda: [b'{"format": "dqreg comparison 1", "machine": "a", "threads": 1}\n' * 2], Store
        ),
    }


def _folder(place: Path) -> None:
    """What the damaged files stand beside."""
    (place / "data.bin").write_bytes(gltf_tree()[1])
    (place / "part.obj").write_bytes(good_files()["obj"][1])
    (place / "scan.npy").write_bytes(good_files()["npy"][1])
    (place / "rows.csv").write_text("scan,target,start\nscan.npy,part.obj,identity\n")
    for name in ("frames", "one", "case"):
        (place / name).mkdir()
    (place / "one" / "1.npz").write_bytes(_npz(points=POINTS))
    for name in ("scan.ply", "part.stl", "recipe.toml"):
        (place / "case" / name).write_bytes((demo_case() / name).read_bytes())
    for number in (0, 1):
        (place / "frames" / f"{number}.bin").write_bytes(np.c_[POINTS, POINTS[:, :1]].tobytes())


def read_damaged(name: str, place: Path, first: int, count: int) -> None:
    """Read damaged files of a kind."""
    kind = kinds()[name]
    path = place / kind.file
    for draw in range(first, first + count):
        rng = np.random.default_rng([SEED, draw])
        content = mutated(kind.seeds[int(rng.integers(len(kind.seeds)))], kind.seeds, rng)
        path.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                kind.read(path)
        except DqregError:
            continue
        except Exception as error:
            kept = place / f"draw-{draw}-{path.name}"
            kept.write_bytes(content)
            raise AssertionError(f"draw {draw} of {name}: {type(error).__name__}: {error}; kept as {kept}") from error


@pytest.mark.parametrize("name", kinds())
def test_damaged_files_are_read_soundly_or_refused(name: str, tmp_path: Path) -> None:
    _folder(tmp_path)
    kind = kinds()[name]
    for content in kind.seeds:
        (tmp_path / kind.file).write_bytes(content)
        kind.read(tmp_path / kind.file)
    read_damaged(name, tmp_path, 0, EACH)


@pytest.mark.soak
@pytest.mark.parametrize("name", kinds())
def test_many_damaged_files_are_read_soundly_or_refused(name: str, tmp_path: Path) -> None:
    _folder(tmp_path)
    read_damaged(name, tmp_path, EACH, SOAK)
