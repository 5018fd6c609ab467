from __future__ import annotations

import contextlib
import copy
import json
import multiprocessing
import pickle
import warnings
import zipfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from dqreg import prepare_target, register
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.registration.problem.target_file import VERSION
from dqreg.registration.target import Target
from dqreg.rigid import pose
from dqreg.synth import disturbance
from dqreg.synth.parts import bracket

PART = Mesh(*bracket(segments=8), units="mm")
SAMPLED = sample_mesh(PART, 3_000, np.random.default_rng(0))
POINTS = SAMPLED.points
NOISY = POINTS + np.random.default_rng(1).normal(size=POINTS.shape) * 1e-3
TRUTH = disturbance(np.random.default_rng(2), 0.1, 2.0, PART.centre)
SCAN = pose.apply(pose.inverse(TRUTH), NOISY[::3])
FAR = np.array([1e5, -2e4, 3e3])
TARGETS: dict[str, Any] = {
    "mesh": PART,
    "mesh with a flat face": Mesh(PART.vertices, np.vstack([PART.faces, [[0, 0, 1]]]), "mm"),
    "mesh far away": Mesh(PART.vertices + FAR, PART.faces),
    "cloud": PointCloud(np.vstack([POINTS, POINTS[:10]]), units="mm"),
    "cloud with normals": PointCloud(POINTS, SAMPLED.normals, [1.0, 2.0, 3.0]),
}


def answer(target: Target, start: Any = None, **options: Any) -> dict[str, Any]:
    """All of a registration that can be compared byte by byte."""
    start = pose.from_parts(np.eye(3), target.indexed.origin) if start is None else start
    result = target.register(SCAN, start, **options)
    told = result.to_dict()
    del told["timings"]
    for record in told["history"]:
        del record["seconds"]
    return told


@cache
def file_of(kind: str) -> bytes:
    """What a target of a kind is saved as."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "part.npz"
        prepare_target(TARGETS[kind]).save(path)
        return path.read_bytes()


@cache
def answered(kind: str) -> tuple[Target, str]:
    """A target of a kind, and what it answers."""
    target = prepare_target(TARGETS[kind])
    return target, json.dumps(answer(target))


def saved(kind: str, folder: Path) -> Path:
    """A file of its own with a target of a kind."""
    path = folder / "part.npz"
    path.write_bytes(file_of(kind))
    return path


@pytest.mark.parametrize("kind", TARGETS)
def test_a_saved_and_loaded_target_gives_the_same_bytes(kind: str, tmp_path: Path) -> None:
    loaded = Target.load(saved(kind, tmp_path))
    target, told = answered(kind)
    assert json.dumps(answer(loaded)) == told
    assert (loaded.indexed.kind, loaded.indexed.units) == (target.indexed.kind, target.indexed.units)
    one, other = loaded.indexed.geometry, target.indexed.geometry
    assert one.dropped == other.dropped
    if isinstance(one, Mesh) and isinstance(other, Mesh):
        np.testing.assert_array_equal(one.flat, other.flat)
        assert one.faults == other.faults
    assert loaded.nbytes == pytest.approx(target.nbytes, rel=0.05)
    assert target.seconds > 0.0
    assert loaded.seconds > 0.0


def test_the_file_holds_no_pickle_and_is_saved_again_to_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "a.target", tmp_path / "b.target"
    prepare_target(TARGETS["cloud"]).save(first)
    Target.load(first).save(second)
    with zipfile.ZipFile(first) as one, zipfile.ZipFile(second) as two:
        assert one.namelist() == two.namelist()
        for name in one.namelist():
            assert one.read(name) == two.read(name)
            assert b"|O" not in one.read(name)[:200]


def damaged(path: Path, **changes: Any) -> Path:
    """The target of a file with some arrays, or parts of its header, replaced."""
    with np.load(path) as archive:
        arrays = dict(archive)
    header = json.loads(arrays["header"].tobytes())
    header |= {name: value for name, value in changes.items() if name in header}
    arrays |= {name: value for name, value in changes.items() if name not in header}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    other = path.with_name("damaged.npz")
    np.savez(other, **{name: array for name, array in arrays.items() if array is not None})
    return other


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": "something"}, "no prepared target"),
        ({"version": VERSION + 1}, "prepare and save it again"),
        ({"faces": None}, "damaged"),
        ({"faces": np.array([[0, 1, 10_000]])}, "damaged"),
        ({"vertices": np.full((3, 3), np.nan)}, "damaged"),
    ],
)
def test_a_file_that_is_no_target_is_refused_in_words(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        Target.load(damaged(saved("mesh", tmp_path), **changes))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", pickle.dumps([1, 2])])
def test_junk_and_pickles_are_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "junk.npz").write_bytes(content)
    with pytest.raises(InputError, match="no readable prepared target"):
        Target.load(tmp_path / "junk.npz")
    with pytest.raises(InputError, match="no readable prepared target"):
        Target.load(tmp_path / "absent.npz")


def test_a_cut_file_is_refused(tmp_path: Path) -> None:
    whole = file_of("mesh")
    for share in (0.1, 0.5, 0.99):
        (tmp_path / "cut.npz").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError):
            Target.load(tmp_path / "cut.npz")


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_one_target_serves_many_threads_at_once_as_it_serves_one(kind: str) -> None:
    _, alone = answered(kind)
    shared = prepare_target(TARGETS[kind])
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: json.dumps(answer(shared)), range(4)))
    assert answers == [alone] * 4


def test_the_size_counts_the_arrays_and_the_trees() -> None:
    target = prepare_target(PART)
    mesh = target.indexed.geometry
    assert isinstance(mesh, Mesh)
    # Of the tree at least twelve numbers a face.
    least = mesh.vertices.nbytes + mesh.faces.nbytes + mesh.corners.nbytes + 96 * len(mesh.faces)
    assert least < target.nbytes < 10 * least


def test_max_time_is_the_old_name_of_time_limit() -> None:
    target = prepare_target(PART)
    with pytest.warns(DeprecationWarning, match="max_time is the old name of time_limit") as told:
        old = target.register(SCAN, TRUTH, max_time=1e-6)
    assert told[0].filename == __file__
    new = target.register(SCAN, TRUTH, time_limit=1e-6)
    assert old.status == new.status == "time limit"
    assert old.settings["time_limit"] == new.settings["time_limit"] == 1e-6
    with pytest.raises(InputError, match="max_time is the old name of time_limit"):
        target.register(SCAN, TRUTH, max_time=1.0, time_limit=1.0)


def test_a_start_that_explains_the_scan_spares_the_coarse_steps() -> None:
    # The same end from near and from farther off: the truth is known, because the scan was moved by it.
    target = prepare_target(PART)
    near = target.register(SCAN, disturbance(np.random.default_rng(4), 0.01, 0.2, PART.centre) @ TRUTH)
    far = target.register(SCAN, disturbance(np.random.default_rng(4), 0.15, 5.0, PART.centre) @ TRUTH)
    assert {record.stage for record in near.history} == {"fine"}
    assert {record.stage for record in far.history} > {"fine"}
    np.testing.assert_allclose(near.T_target_source, far.T_target_source, atol=1e-4)
    assert near.verdict.level == far.verdict.level == "accepted"


def test_a_prepared_target_answers_as_the_bare_one_does() -> None:
    bare = register(SCAN, PART, TRUTH)
    np.testing.assert_array_equal(prepare_target(PART).register(SCAN, TRUTH).T_target_source, bare.T_target_source)


COPIES = {"pickle": lambda value: pickle.loads(pickle.dumps(value)), "copy": copy.copy, "deepcopy": copy.deepcopy}


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_a_copy_of_a_target_and_of_a_result_answers_as_they_do(kind: str, how: str) -> None:
    # Open parts and clouds alike; both hold Open3D's trees and locks by now.
    part = Mesh(PART.vertices, PART.faces[:-20]) if kind == "mesh" else TARGETS["cloud"]
    target = prepare_target(part)
    options: dict[str, Any] = {"search": "never"}
    before, result, _ = answer(target, **options), target.register(SCAN, TRUTH), target.indexed.near_periods
    again = COPIES[how](target)
    # What took longest to find goes along, so that a copy is ready as soon as its tree is.
    assert kind == "cloud" or {"near_periods", "near_rotations", "spreads"} <= set(vars(again.indexed))
    assert json.dumps(answer(again, **options)) == json.dumps(before)
    twin = COPIES[how](result)
    assert json.dumps(twin.to_dict()) == json.dumps(result.to_dict())
    with warnings.catch_warnings(action="ignore"):  # neither has an inside
        np.testing.assert_array_equal(twin.deviations().values, result.deviations().values)


def test_a_target_is_equal_to_itself_alone_and_a_key() -> None:
    one, other = prepare_target(PART), prepare_target(PART)
    assert one == one
    assert one != other
    assert {one: 1, other: 2}[one] == 1
    assert one.indexed != other.indexed


def register_there(start: np.ndarray) -> Any:
    return prepare_target(PART).register(SCAN, start, effort="fast")


@pytest.mark.soak
def test_processes_hand_back_results() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (found,) = pool.map(register_there, [TRUTH])
    np.testing.assert_array_equal(found.T_target_source, register_there(TRUTH).T_target_source)
    assert len(found.deviations()) == len(SCAN)


HEADS: list[Any] = [[], 3, None, {}, {"format": "dqreg target"}, {"format": [], "version": 2}]


@pytest.mark.parametrize("head", HEADS)
def test_any_header_is_refused_in_words(head: Any, tmp_path: Path) -> None:
    text = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
    np.savez(tmp_path / "a.npz", header=text, origin=np.zeros(3))
    with pytest.raises(InputError, match="prepared target"):
        Target.load(tmp_path / "a.npz")


CHANGES: list[tuple[str, dict[str, Any]]] = [
    ("mesh", {"origin": np.zeros(2)}),
    ("mesh", {"origin": np.array([0.0, np.nan, 0.0])}),
    ("mesh", {"origin": np.array(["a", "b", "c"])}),
    ("mesh", {"origin": None}),
    ("mesh", {"flat": np.array([[0, 1, 10**9]])}),
    ("mesh", {"flat": np.array([[0.0, 1.0, 2.0]])}),
    ("mesh", {"units": "parsec"}),
    ("mesh", {"kind": "sponge"}),
    ("mesh", {"name": 3}),
    ("mesh", {"faces": np.array([["a", "b", "c"]])}),
    ("mesh", {"vertices": np.zeros((9, 2))}),
    ("mesh", {"vertices": np.zeros((9, 3), dtype=complex)}),
    ("cloud", {"fitted": np.zeros((3, 4))}),
    ("cloud", {"points": np.zeros((9, 3))}),
    ("cloud", {"points": np.full((9, 3), 1e200)}),
    ("cloud", {"dropped": -1}),
    ("cloud with normals", {"normals": np.zeros((2, 3))}),
    ("cloud with normals", {"normals": np.full((len(POINTS), 3), np.nan)}),
    ("cloud with normals", {"viewpoint": np.array([1.0, np.inf, 0.0])}),
]


@pytest.mark.parametrize(("kind", "changes"), CHANGES)
def test_a_changed_array_or_header_is_refused_in_words(kind: str, changes: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"damaged prepared target|no readable prepared target"):
        Target.load(damaged(saved(kind, tmp_path), **changes))


def test_bytes_changed_anywhere_are_refused_or_leave_a_sound_target(tmp_path: Path) -> None:
    whole, rng = file_of("mesh"), np.random.default_rng(0)
    for _ in range(60):
        torn = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            torn[place] = rng.integers(0, 256)
        (tmp_path / "torn.npz").write_bytes(bytes(torn))
        with contextlib.suppress(InputError):
            assert np.isfinite(Target.load(tmp_path / "torn.npz").indexed.origin).all()
