from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg.cli.odometry_engines import run_others
from dqreg.cli.outputs import consoles
from dqreg.odometry import Odometry, OdometrySettings
from dqreg.odometry.scans import open_scans
from tests.cli.command import run


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    # A hall's walls, sampled anew for every frame; the sensor moves by 0.2 a frame.
    rng, folder = np.random.default_rng(0), tmp_path_factory.mktemp("scans")
    poses, frames = [], []
    for i in range(4):
        walls = rng.uniform(-1, 1, (4000, 3)) * [8, 6, 3]
        side = np.arange(4000) % 3
        rows = np.arange(4000)
        walls[rows, side] = np.sign(walls[rows, side]) * np.array([8, 6, 3])[side]
        frames.append(walls - [0.2 * i, 0, 0])
        poses.append([1, 0, 0, 0.2 * i, 0, 1, 0, 0, 0, 0, 1, 0])
    np.savetxt(folder / "truth.txt", poses)
    matrices = [[*np.reshape(rows, (3, 4)).tolist(), [0, 0, 0, 1]] for rows in poses]
    (folder / "truth.json").write_text(json.dumps({"T_world_scan": matrices}))
    matrices[2] = [[None] * 4] * 4
    (folder / "holes.json").write_text(json.dumps({"T_world_scan": matrices}))
    np.savez(folder / "good.npz", points=np.vstack(frames), offsets=np.arange(5) * 4000)
    np.savez(folder / "gap.npz", points=np.vstack(frames), offsets=[0, 4000, 4000, 12000, 16000])
    return folder


def test_a_sequence_becomes_a_trajectory_with_all_its_outputs(sequence, tmp_path, capsys):
    out, frames, plot = tmp_path / "poses.txt", tmp_path / "frames.csv", tmp_path / "run.png"
    truth = sequence / "truth.txt"
    code = run("odometry", sequence / "good.npz", "--out", out, "--truth", truth, "--frames", frames, "--plot", plot)
    text = capsys.readouterr().out
    assert code == 0
    assert "4 accepted, 0 suspect, 0 failed" in text
    assert "NEES" in text
    np.testing.assert_allclose(np.loadtxt(out), np.loadtxt(truth), atol=0.02)
    rows = list(csv.DictReader(frames.read_text().splitlines()))
    assert [row["level"] for row in rows] == ["accepted"] * 4
    assert 0.0 < float(rows[1]["sigma_shift"]) < 0.1
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_the_frames_that_are_done(sequence, tmp_path, monkeypatch, capfd, number):
    out, frames = tmp_path / "poses.tum", tmp_path / "frames.csv"
    register = Odometry._registered

    def told(odometry, *given):
        found = register(odometry, *given)
        if len(odometry.poses) == 2:
            os.kill(os.getpid(), number)
        return found

    monkeypatch.setattr(Odometry, "_registered", told)
    options = ("--truth", sequence / "truth.txt", "--out", out, "--frames", frames)
    # Whoever starts the tests in the background has it ignored.
    before = signal.signal(number, signal.default_int_handler)
    try:
        assert run("odometry", sequence / "good.npz", *options) == 128 + number
    finally:
        signal.signal(number, before)
    captured = capfd.readouterr()
    assert "dqreg: stopped after 2 of 4 frames" in captured.err
    assert "2 accepted, 0 suspect, 0 failed" in captured.out
    assert len(np.loadtxt(out)) == 2
    assert len(frames.read_text().splitlines()) == 3


def test_a_frame_without_points_is_named_and_the_code_says_so(sequence, tmp_path, capsys):
    out = tmp_path / "poses.txt"
    assert run("odometry", sequence / "gap.npz", "--out", out) == 1
    text = capsys.readouterr().out
    assert "frame 1: FAILED: the frame holds no finite point" in text
    assert "frames without a pose are bridged: 1" in text
    assert len(np.loadtxt(out)) == 4


def test_the_comparison_is_one_command(sequence, capsys):
    pytest.importorskip("small_gicp")
    assert run("odometry", sequence / "good.npz", "--truth", sequence / "truth.txt", "--compare", "--first", "3") == 0
    text = capsys.readouterr().out
    for name in ("KISS-ICP, defaults", "GenZ-ICP, range", "small_gicp, scan to scan", "dqreg"):
        assert name in text


def test_a_comparison_that_is_stopped_keeps_the_engines_that_are_done(sequence):
    frames, asked = open_scans(sequence / "good.npz"), iter([False] * (len(open_scans(sequence / "good.npz")) + 3))
    trips = run_others(consoles(quiet=True, as_json=False)[0], frames, OdometrySettings(), lambda: next(asked, True))
    assert [trip.name for trip in trips] == ["KISS-ICP, defaults"]


def test_a_comparison_begins_with_the_first_frame_that_holds_points(sequence, tmp_path, capsys):
    with np.load(sequence / "good.npz") as file:
        later = np.r_[0, file["offsets"]]
        np.savez(tmp_path / "late.npz", points=file["points"], offsets=later)
    assert run("odometry", tmp_path / "late.npz", "--compare", "--first", "2") == 1
    assert "KISS-ICP, defaults" in capsys.readouterr().out


def test_kiss_icp_runs_through_the_same_command(sequence, tmp_path):
    out = tmp_path / "k.tum"
    assert run("odometry", sequence / "good.npz", "--engine", "kiss-icp", "--out", out, "--quiet") == 0
    assert np.loadtxt(out).shape == (4, 8)


def test_kiss_icp_keeps_to_the_minimum_range(sequence, tmp_path):
    """A shell about the sensor goes with it, and holds the motion of 0.6 back unless it is left out."""
    with np.load(sequence / "good.npz") as file:
        frames = np.split(file["points"], 4)
    shell = np.random.default_rng(1).normal(size=(4000, 3))
    shell *= 2.0 / np.linalg.norm(shell, axis=1)[:, None]
    np.savez(
        tmp_path / "shell.npz", points=np.vstack([np.vstack([f, shell]) for f in frames]), offsets=np.arange(5) * 8000
    )
    moved = []
    for nearest in (0.0, 2.2):
        options = ("--engine", "kiss-icp", "--out", tmp_path / "k.txt", "--quiet", "--min-range", nearest)
        assert run("odometry", tmp_path / "shell.npz", *options) == 0
        moved.append(np.loadtxt(tmp_path / "k.txt")[-1, 3])
    assert abs(moved[1] - 0.6) < 0.1 < 0.15 < abs(moved[0] - 0.6)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (["--method", "dq"], "--method is the estimator of our engine, and --engine kiss-icp was asked for"),
        (["--method", "plane"], "--method is the estimator of our engine"),
        (["--search", "10"], "--search-deg is the search of our engine"),
        (["--motion", "/odom"], "--motion guides our engine"),
        (["--view"], "--view shows our engine"),
        (["--compare"], "--compare runs all engines"),
    ],
)
def test_what_kiss_icp_does_not_have_is_refused_before_the_run(sequence, tmp_path, capsys, option, words):
    out = tmp_path / "k.txt"
    assert run("odometry", sequence / "good.npz", "--engine", "kiss-icp", "--out", out, *option) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["absent"], "no such file or folder"),
        (["good.npz", "--voxel-size", "-1"], "voxel_size must be a length above 0"),
        (["good.npz", "--first", "0"], "--first must be at least 1"),
        (["good.npz", "--first", "1"], "the only frame, good.npz[0], places nothing"),
        (["good.npz", "--truth", "good.npz"], "expected a trajectory"),
        (["good.npz", "--out", "no/such/folder/a.txt"], "does not exist"),
        (["good.npz", "--method", "magic"], "unknown method"),
        (["good.npz", "--times", "absent.txt"], "error: cannot read absent.txt: found no such file"),
        (["good.npz", "--plot", "run.gif"], "expected a name that ends in .png, .svg or .pdf"),
        ([".", "--loader", "kitti"], "--sequence"),
        (["good.npz", "--truth", "holes.json"], "scans without a pose"),
    ],
)
def test_bad_input_is_one_line_and_code_2(sequence, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(sequence)
    assert run("odometry", *arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert len(error.splitlines()) == 1


def test_a_name_that_cannot_be_drawn_is_refused_before_the_run(sequence, tmp_path, monkeypatch):
    monkeypatch.chdir(sequence)
    assert run("odometry", "good.npz", "--out", tmp_path / "poses.txt", "--plot", "run.gif") == 2
    assert not (tmp_path / "poses.txt").exists()


def test_the_truth_of_a_virtual_case_is_one_of_odometry_too(sequence, capsys):
    said = []
    for name in ("truth.txt", "truth.json"):
        assert run("odometry", sequence / "good.npz", "--truth", sequence / name) == 0
        said.append([line for line in capsys.readouterr().out.splitlines() if "NEES" in line])
    assert said[0] == said[1] != []


def test_a_view_is_open_while_it_runs(sequence, monkeypatch, capsys):
    pytest.importorskip("viser")
    from dqreg.report import live_server

    servers = []
    monkeypatch.setattr(live_server, "wait", servers.append)
    assert run("odometry", sequence / "good.npz", "--view", "--port", 18_270, "--first", 2) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"http://127.0.0.1:{servers[0].get_port()}" in said
    servers[0].stop()


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from dqreg.cli.odometry import odometry_command; "
        "print([m for m in ('open3d', 'kiss_icp', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ}, check=True)
    assert done.stdout.strip() == "[]"
