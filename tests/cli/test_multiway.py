"""`dqreg multiway` from scans on disk to poses, model, graph and report; and what it says of a wrong call."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.cli.multiway import _files
from dqreg.files import read_cloud, write_cloud
from dqreg.multiway import Multiway
from dqreg.rigid import pose
from tests.cli.command import run
from tests.multiway.test_register_many import views_of_a_part


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scans of a part, a file of their poses, and one in which the second pose is wrong."""
    where = tmp_path_factory.mktemp("scans")
    scans, truth = views_of_a_part(2)
    for k, points in enumerate(scans):
        write_cloud(where / f"view{k}.ply", points)
    truth = pose.inverse(truth[0]) @ truth
    wrong = truth.copy()
    wrong[1] = wrong[1] @ pose.exp(np.r_[2.5, 0.0, 1.0, 0.0, 0.0, 0.0])
    for name, poses in (("truth", truth), ("wrong", wrong)):
        np.savetxt(where / f"{name}.txt", poses[:, :3].reshape(2, 12))
    return where


@pytest.fixture(scope="module")
def made(folder: Path) -> Path:
    names = {"out": "poses.json", "fused": "model.ply", "graph": "graph.g2o", "report": "report.html"}
    options: list[Any] = [part for key, name in names.items() for part in (f"--{key}", folder / name)]
    starts = ("--starts", folder / "truth.txt", "--effort", "fast", "--workers", 1, "--quiet")
    assert run("multiway", f"{folder}/view*.ply", *options, *starts) in (0, 1)
    return folder


def test_one_command_makes_poses_model_graph_and_report(made: Path) -> None:
    record = json.loads((made / "poses.json").read_text())
    truth = np.loadtxt(made / "truth.txt").reshape(2, 3, 4)
    size = np.linalg.norm(np.ptp(read_cloud(made / "view0.ply").points, axis=0))
    # As of the library's test of the same scans: a tenth of the distance of the points.
    np.testing.assert_allclose(np.array(record["T_world_scan"])[:, :3, 3], truth[:, :, 3], atol=2e-3 * size)
    assert {"verdict", "covariances", "edges", "overlap", "loop_errors", "names"} <= set(record)
    # Nothing tells from which side these scans were taken, and normals of a file have a sign.
    assert read_cloud(made / "model.ply").normals is None
    assert (made / "graph.g2o").read_text().count("EDGE_SE3:QUAT") == 1
    assert "view1" in (made / "report.html").read_text()


def test_scans_of_a_pattern_come_as_they_are_numbered(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        (tmp_path / f"scan_{number}.ply").touch()
    found = _files((f"{tmp_path}/scan_10.ply", f"{tmp_path}/*.ply"))
    assert [path.stem for path in found] == ["scan_10", "scan_1", "scan_2", "scan_10"]


@pytest.mark.parametrize("order", ["turntable", "any"])
def test_scans_that_a_shell_listed_are_taken_as_they_are_numbered(
    order: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [tmp_path / f"scan{number}.ply" for number in (1, 10, 2)]
    for name, of in zip(names, (0, 1, 1), strict=True):
        points = read_cloud(folder / f"view{of}.ply").points
        write_cloud(name, points[:: 10 + (name.stem == "scan2")])
    run("multiway", *names, "--order", order, "--effort", "fast", "--workers", 1, "--out", tmp_path / "poses.json")
    told = capsys.readouterr().err
    found = json.loads((tmp_path / "poses.json").read_text())["names"]
    assert found == (["scan1", "scan2", "scan10"] if order == "turntable" else ["scan1", "scan10", "scan2"])
    assert ("as they are numbered: scan1, scan2, scan10, ... (the shell gave" in told) == (order == "turntable")


@pytest.mark.parametrize("unit", [None, "mm"])
def test_lengths_have_the_unit_of_the_scans_and_progress_is_no_result(
    unit: str | None, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for k in range(2):
        comments = () if unit is None else (f"units {unit}",)
        write_cloud(tmp_path / f"view{k}.ply", read_cloud(folder / f"view{k}.ply").points, comments=comments)
    starts = ("--starts", folder / "truth.txt", "--effort", "fast", "--workers", 1)
    run("multiway", f"{tmp_path}/view*.ply", "--report", tmp_path / "r.html", *starts)
    told = capsys.readouterr()
    assert ("sigma of translation [mm]" in told.out) == (unit is not None)
    assert ("which no file names" in told.out) == (unit is None)
    assert ("which no file names" in (tmp_path / "r.html").read_text()) == (unit is None)
    assert "1/1  view0 - view1" in told.err
    assert "1/1" not in told.out


def test_nothing_is_kept_beside_a_device(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # A pipe of our own stands for the devices of the machine.
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()), daemon=True)
    reader.start()
    starts = ("--starts", folder / "truth.txt", "--effort", "fast", "--workers", 1, "--quiet")
    assert run("multiway", f"{folder}/view*.ply", "--out", pipe, *starts) in (0, 1)
    reader.join()
    assert len(json.loads(read[0])["T_world_scan"]) == 2
    assert list(tmp_path.iterdir()) == [pipe]
    assert run("multiway", f"{folder}/view*.ply", "--out", pipe, "--resume") == 2
    assert "name of a file" in capsys.readouterr().err


def test_a_resumed_run_takes_the_finished_pairs(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = sorted((made / "poses-pairs").glob("*.json"))
    before = [path.stat().st_mtime_ns for path in kept]
    assert kept
    starts = ("--starts", made / "truth.txt", "--effort", "fast", "--workers", 1)
    assert run("multiway", f"{made}/view*.ply", "--out", made / "poses.json", "--resume", *starts) in (0, 1)
    assert [path.stat().st_mtime_ns for path in kept] == before
    assert "verdict:" in capsys.readouterr().out


def test_a_new_run_removes_pairs_alone_and_says_so(folder: Path, tmp_path: Path) -> None:
    words = ("multiway", f"{folder}/view*.ply", "--out", tmp_path / "poses.json")
    starts = ("--starts", folder / "truth.txt", "--effort", "fast", "--workers", 1)
    assert run(*words, *starts, "--quiet") in (0, 1)
    pairs = tmp_path / "poses-pairs"
    theirs = {pairs / "mine.json": '{"a": 1}', pairs / "0-1-start.json.json": "[]", pairs / "7-8-search.json": "{}"}
    for path, text in theirs.items():
        path.write_text(text)
    (pairs / "9-8-search.json").write_text((pairs / "0-1-start.json").read_text())
    assert run(*words, *starts, "--quiet") in (0, 1)
    assert all(path.read_text() == text for path, text in theirs.items())
    assert not (pairs / "9-8-search.json").exists()
    assert json.loads((pairs / "0-1-start.json").read_text())["multiway"]["code"]


def test_pairs_of_a_killed_run_are_not_removed_without_a_word(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("multiway", f"{folder}/view*.ply", "--out", tmp_path / "poses.json")
    starts = ("--starts", folder / "truth.txt", "--effort", "fast", "--workers", 1)
    assert run(*words, *starts, "--quiet") in (0, 1)
    capsys.readouterr()
    assert run(*words, *starts) in (0, 1)
    told = capsys.readouterr()
    assert "removed 1 finished pair of an earlier run" in told.out + told.err
    assert "--resume" in told.out + told.err


def test_two_runs_are_not_at_work_in_one_folder(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fcntl = pytest.importorskip("fcntl")
    (tmp_path / "poses-pairs").mkdir()
    with (tmp_path / "poses-pairs" / ".lock").open("ab") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert run("multiway", f"{folder}/view*.ply", "--out", tmp_path / "poses.json", "--quiet") == 2
    assert "another dqreg multiway is at work" in capsys.readouterr().err


def test_whoever_ends_a_run_is_told_what_is_kept_of_it(
    made: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def ended(*_: object, **__: object) -> None:
        raise SystemExit(143)

    monkeypatch.setattr("dqreg.multiway.register_many", ended)
    assert run("multiway", f"{made}/view*.ply", "--out", made / "poses.json", "--resume") == 143
    kept = len(list((made / "poses-pairs").glob("*.json")))
    assert f"{kept} finished pair" in (told := capfd.readouterr().err)
    assert "--resume" in told


def test_a_contradictory_start_is_no_reason_to_give_up(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    starts = ("--starts", made / "wrong.txt", "--effort", "fast", "--workers", 1, "--json")
    run("multiway", f"{made}/view*.ply", *starts)
    found = np.array(json.loads(capsys.readouterr().out)["T_world_scan"], dtype=float)
    wrong = np.loadtxt(made / "wrong.txt").reshape(2, 3, 4)
    # Either the right pose, or none: never the start, which puts the scan on nothing.
    assert not np.allclose(found[1, :3], wrong[1], atol=0.05)


def test_a_truth_with_gaps_is_no_truth(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.tum").write_text("1 0 0 0 0 0 0 1\n")
    scans = folder / "view0.ply", folder / "view1.ply"
    assert run("compare", *scans, "--multiway", "--truth", tmp_path / "truth.tum") == 2
    assert "truth.tum holds scans without a pose" in capsys.readouterr().err


def test_poses_alone_are_of_the_format_that_their_name_says(made: Path, tmp_path: Path) -> None:
    found = Multiway.load(made / "poses.json")
    for name in ("a.tum", "a_tum.txt", "a.txt"):
        found.save(tmp_path / name)
    tum, again, kitti = (np.loadtxt(tmp_path / name, ndmin=2) for name in ("a.tum", "a_tum.txt", "a.txt"))
    np.testing.assert_array_equal(tum, again)
    assert (tum.shape[1], kitti.shape[1]) == (8, 12)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["nothing*.ply"], "no file"),
        (["{folder}"], "folder"),
        (["{folder}/view0.ply"], "two scans"),
        (["{folder}/view*.ply", "--resume"], "--resume needs --out"),
        (["{folder}/view*.ply", "--fused", "model.obj"], "PLY"),
        (["{folder}/view*.ply", "--graph", "graph.txt"], "g2o"),
        (["{folder}/view*.ply", "--voxel", "-1"], "--voxel"),
        (["{folder}/view*.ply", "--viewpoint", "here"], "--viewpoint"),
        (["{folder}/view*.ply", "--viewpoint", "1,2"], "--viewpoint"),
        (["{folder}/view*.ply", "--viewpoint", "none"], "--viewpoint"),
        (["{folder}/view*.ply", "--viewpoint"], "--viewpoint"),
        (["{folder}/view*.ply", "--starts", "{folder}/view0.ply"], "initial poses"),
        (["{folder}/view*.ply", "--anchor", "7"], "anchor"),
    ],
)
def test_a_wrong_call_is_one_line(
    arguments: list[str], named: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("multiway", *(text.format(folder=folder) for text in arguments)) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
