from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqreg.cli.main import main
from dqreg.odometry import write_trajectory
from dqreg.rigid import pose
from tests.solvers.hand_eye_cases import SIGMAS, drawn_pose, noisy, stations


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main(["hand-eye", *map(str, arguments)])
    return int(stop.value.code or 0)


def answer(capsys, *arguments):
    assert run(*arguments, "--json") == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def cell():
    """Stations of a hand, the target in the eye's frame, and T_hand_eye: without noise."""
    rng = np.random.default_rng(20)
    hands = drawn_pose(rng, 0.5) @ stations(rng, 8)
    X, target = drawn_pose(rng, 0.2), drawn_pose(rng, 1.0)
    return hands, pose.inverse(X) @ pose.inverse(hands) @ target, X, target


def write_json(path, hands, eyes):
    path.write_text(json.dumps({"hand": hands.tolist(), "eye": eyes.tolist()}))
    return path


def seven(T):
    return np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()])


@pytest.mark.parametrize("form", ["json", "csv of quaternions", "csv of matrices", "text of 3x4", "KITTI", "TUM"])
def test_every_format_gives_the_pose_of_the_sensor(form, cell, tmp_path, capsys):
    hands, eyes, X, target = cell
    files = [tmp_path / "stations.csv"]
    if form == "json":
        files = [write_json(tmp_path / "stations.json", hands, eyes)]
    elif form == "csv of quaternions":
        rows = np.hstack([seven(hands), seven(eyes)])
        np.savetxt(files[0], rows, delimiter=",", header="x,y,z,qx,qy,qz,qw,x,y,z,qx,qy,qz,qw", comments="")
    elif form == "csv of matrices":
        np.savetxt(files[0], np.hstack([hands.reshape(-1, 16), eyes.reshape(-1, 16)]), delimiter=";")
    elif form == "text of 3x4":
        np.savetxt(files[0], np.hstack([hands.reshape(-1, 16)[:, :12], eyes.reshape(-1, 16)[:, :12]]))
    else:
        files = [tmp_path / f"{name}.{form.lower()}" for name in ("hand", "eye")]
        times = np.arange(8.0)
        # The sensor's clock ticks at other instants, and it saw one station less.
        keep = slice(0, 7) if form == "TUM" else slice(None)
        write_trajectory(files[0], hands, times)
        write_trajectory(files[1], eyes[keep], times[keep] + 0.1)
    values = answer(capsys, *files)
    np.testing.assert_allclose(values["T_hand_eye"], X, rtol=0, atol=1e-9)
    np.testing.assert_allclose(values["T_base_target"], target, rtol=0, atol=1e-9)
    assert values["stations"] == (7 if form == "TUM" else 8)
    assert values["other_convention"] is None


def test_conventions_of_the_poses(cell, tmp_path, capsys):
    hands, eyes, X, _ = cell
    for hand, eye, options in (
        (hands, pose.inverse(eyes), ["--eye-poses", "sensor"]),
        (pose.inverse(hands), eyes, ["--hand-poses", "base"]),
    ):
        file = write_json(tmp_path / "stations.json", hand, eye)
        np.testing.assert_allclose(answer(capsys, file, *options)["T_hand_eye"], X, rtol=0, atol=1e-9)
        # Read the wrong way round the poses disagree, and the option that mends it is named.
        code = run(file, "--json")
        said = capsys.readouterr()
        words = said.err.split("They agree with ")[-1] if code else json.loads(said.out)["other_convention"]
        assert " ".join(options) in words
    # The sensor stands beside the robot and sees a target on its hand.
    file = write_json(tmp_path / "fixed.json", hands, pose.inverse(X) @ hands @ cell[3])
    values = answer(capsys, file, "--sensor", "world")
    np.testing.assert_allclose(values["T_base_eye"], X, rtol=0, atol=1e-9)
    np.testing.assert_allclose(values["T_hand_target"], cell[3], rtol=0, atol=1e-9)


def test_what_is_printed_says_how_sure_it_is(cell, tmp_path, capsys):
    hands, eyes, X, _ = cell
    file = write_json(tmp_path / "stations.json", hands, noisy(np.random.default_rng(1), eyes, SIGMAS))
    degrees = np.rad2deg(SIGMAS[0])
    assert run(file, "--sensor-noise", degrees, SIGMAS[1], "--out", tmp_path / "result.json") == 0
    text = capsys.readouterr().out
    for words in ("T_hand_eye from 8 stations", "standard deviation", "rotation residual", "at station", "wrote"):
        assert words in text
    values = json.loads((tmp_path / "result.json").read_text())
    error = np.array(values["T_hand_eye"])[:3, 3] - X[:3, 3]
    assert (np.abs(error) < 4.0 * np.array(values["sigma_translation"])).all()
    assert values["noise_rotation_deg"] == pytest.approx(degrees)
    assert run(file, "--quiet") == 0
    assert capsys.readouterr().out == ""


BAD = {
    "missing.json": (None, "missing.json"),
    "words.csv": ("a,b\nc,d\n", "no row of numbers"),
    "few.csv": ("1,2,3\n4,5,6\n", "3 numbers a row"),
    "ragged.csv": ("1,2,3\n4,5\n", "cannot read"),
    "scalar_first.csv": ("0,0,0,2,0,0,0," * 2 + "\n", "length 1"),
    "keys.json": ('{"robot": []}', "keys hand and eye"),
    "uneven.json": (json.dumps({"hand": [np.eye(4).tolist()] * 3, "eye": [np.eye(4).tolist()] * 2}), "of each a row"),
    "empty.json": ('{"hand": [], "eye": []}', "no stations are given: hand and eye are empty; three are needed"),
    "flat.json": ('{"hand": [1, 2], "eye": [1, 2]}', "list of 4x4"),
    "broken.json": ('{"hand": [', "cannot read"),
    "still.json": (
        json.dumps({"hand": [np.eye(4).tolist()] * 4, "eye": [np.eye(4).tolist()] * 4}),
        "no motion rotates",
    ),
    "mirror.json": (
        json.dumps({"hand": [np.diag([1.0, 1, -1, 1]).tolist()] * 4, "eye": [np.eye(4).tolist()] * 4}),
        "poses of the hand",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_one_line_and_exit_two(name, tmp_path, capsys):
    text, words = BAD[name]
    if text is not None:
        (tmp_path / name).write_text(text)
    assert run(tmp_path / name, "--out", tmp_path / "out.json") == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.startswith("dqreg: error: ")
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out.json").exists()


def test_trajectories_on_two_clocks_are_told(cell, tmp_path, capsys):
    hands, eyes, *_ = cell
    write_trajectory(tmp_path / "hand.tum", hands, np.arange(8.0))
    write_trajectory(tmp_path / "eye.tum", eyes, np.arange(8.0) + 1e6)
    assert run(tmp_path / "hand.tum", tmp_path / "eye.tum") == 2
    assert "are both on one clock?" in capsys.readouterr().err
    write_trajectory(tmp_path / "hand.txt", hands, np.arange(8.0), form="kitti")
    write_trajectory(tmp_path / "eye.txt", eyes[:5], np.arange(5.0), form="kitti")
    assert run(tmp_path / "hand.txt", tmp_path / "eye.txt") == 2
    assert "without times the rows must match" in capsys.readouterr().err
