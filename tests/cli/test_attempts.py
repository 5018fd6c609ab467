from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import write_cloud
from dqreg.files.poses import read_start
from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket
from tests.cli.command import run

# Half a turn would be its own inverse; this is 100 degrees, and more than the part away.
T_PART_SCAN = twist.exp(np.array([0.9, -0.8, 1.2, 150.0, -200.0, 90.0]))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("attempts")
    part = Mesh(*bracket())
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 6_000, rng).points + rng.normal(scale=0.02, size=(6_000, 3))
    write_cloud(folder / "scan.ply", pose.apply(pose.inverse(T_PART_SCAN), points))
    lines = [
        f"OFF\n{len(part.vertices)} {len(part.faces)} 0",
        *(" ".join(map(repr, v)) for v in part.vertices.tolist()),
    ]
    (folder / "part.off").write_text("\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in part.faces)]) + "\n")
    np.savetxt(folder / "inverted.txt", pose.inverse(T_PART_SCAN))
    return folder


def test_an_inverted_start_is_tried_and_said(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Without a search only the inverse can lead there.
    common = ("register", files / "scan.ply", files / "part.off", "--start", files / "inverted.txt", "--effort", "fast")
    out = files / "result.json"
    assert run(*common, "--search", "never", "--out", out) == 0
    assert "is inverted (it maps the target to the scan)" in capsys.readouterr().out
    found = json.loads(out.read_text())
    assert found["settings"]["start"] == "inverted"
    # Six unknowns follow 0.02 mm of noise of 6,000 points by the root of 6 / 6,000, root mean square along the normals;
    # a corner moves by some times as much, by 5.4 times at most in four draws.
    corners = Mesh(*bracket()).vertices
    moved = pose.apply(np.array(found["T_target_source"]) @ pose.inverse(T_PART_SCAN), corners)
    np.testing.assert_allclose(moved, corners, atol=10.0 * 0.02 * np.sqrt(6.0 / 6_000.0))


@pytest.mark.parametrize("search", ["doubt", "never"])
def test_a_start_whose_inverse_lies_nearer_by_chance_is_far_off_and_not_inverted(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], search: str
) -> None:
    # Its inverse puts the scan upon the part, turned by 90 degrees.
    inverse = T_PART_SCAN.copy()
    turn = twist.exp(np.array([0.0, 0.0, np.pi / 2.0, 0.0, 0.0, 0.0]))
    middle = Mesh(*bracket()).centre
    inverse = pose.about(turn, middle) @ inverse
    np.savetxt(tmp_path / "far.txt", pose.inverse(inverse))
    common = ("register", files / "scan.ply", files / "part.off", "--start", tmp_path / "far.txt", "--effort", "fast")
    code = run(*common, "--search", search)
    said = capsys.readouterr().out
    assert "is inverted" not in said
    assert (code, "the initial pose is far off" in said) == ((0, True) if search == "doubt" else (1, False))
    # One that is near says nothing of the kind.
    np.savetxt(tmp_path / "near.txt", T_PART_SCAN)
    assert run(*common[:4], tmp_path / "near.txt", *common[5:]) == 0
    assert "the initial pose is" not in capsys.readouterr().out


def test_swapped_files_are_said(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("register", files / "part.off", files / "scan.ply", "--start", files / "inverted.txt", "--search", "never",
        "--clutter", "none", "--max-distance", "0.001", "--effort", "fast")  # fmt: skip
    assert "the first file is a mesh and the second a cloud of points" in capsys.readouterr().out.lower()


def test_an_accepted_pose_of_a_mesh_on_a_cloud_says_which_way_it_maps(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = files / "swapped.html"
    assert run("register", files / "part.off", files / "scan.ply", "--start", files / "inverted.txt",
               "--report", page) == 0  # fmt: skip
    words = "the pose maps the mesh to the cloud. The usual order is the scan first"
    assert words in capsys.readouterr().out
    assert words in page.read_text(encoding="utf-8")
    assert run("register", files / "scan.ply", files / "part.off", "--start", files / "inverted.txt") == 0
    assert "The usual order" not in capsys.readouterr().out


def test_an_alternative_of_a_result_is_a_start(tmp_path: Path) -> None:
    T = twist.exp(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
    record = {"T_target_source": np.eye(4).tolist(), "alternatives": [{"T_target_source": T.tolist()}]}
    (tmp_path / "r.json").write_text(json.dumps(record))
    np.testing.assert_array_equal(read_start(f"{tmp_path}/r.json#1"), T)
    for number in (0, 2):
        with pytest.raises(InputError, match="has 1 alternatives; they are counted from 1"):
            read_start(f"{tmp_path}/r.json#{number}")
    with pytest.raises(InputError, match="found no such file"):
        read_start(f"{tmp_path}/none.json#1")
