from __future__ import annotations

import json

import numpy as np
import pytest

from dqreg.rigid import pose
from dqreg.synth import demo_case, load_case
from tests.cli.command import run

CASE = load_case(demo_case())
TRUTH = CASE.folder / "truth.json"


@pytest.fixture
def shifted(tmp_path):
    np.savetxt(tmp_path / "pose.txt", pose.from_parts(np.eye(3), [0.0, 3.0, 4.0]) @ CASE.T_target_source)
    return tmp_path / "pose.txt"


def test_a_shift_is_its_own_length_at_every_vertex(tmp_path, shifted, capsys):
    assert run("evaluate", shifted, "--truth", TRUTH, "--out", tmp_path / "errors.json") == 0
    text = capsys.readouterr().out
    assert "rigid" in text
    assert "5" in text
    values = json.loads((tmp_path / "errors.json").read_text())
    for name in ("worst", "rms", "offset"):
        assert values[name] == pytest.approx(5.0, abs=1e-9)
    assert values["angle_rad"] == pytest.approx(0.0, abs=1e-7)


def test_within_decides_the_exit_code(shifted, tmp_path):
    assert run("evaluate", shifted, "--truth", TRUTH, "--within", "5.1", "--quiet") == 0
    assert run("evaluate", shifted, "--truth", TRUTH, "--within", "4.9", "--quiet") == 1
    np.savetxt(tmp_path / "mirrored.txt", CASE.T_target_source @ np.diag([1.0, 1.0, -1.0, 1.0]))
    assert run("evaluate", tmp_path / "mirrored.txt", "--truth", TRUTH, "--within", "1e9", "--quiet") == 1
    (tmp_path / "none.json").write_text(json.dumps({"T_target_source": [[None] * 4] * 4}))
    assert run("evaluate", tmp_path / "none.json", "--truth", TRUTH, "--within", "1e9", "--quiet") == 1


def test_a_pose_that_was_written_the_wrong_way_round_is_told(tmp_path, shifted, capsys):
    np.savetxt(tmp_path / "inverse.txt", pose.inverse(CASE.T_target_source) @ pose.from_parts(np.eye(3), [0.0, 0.1, 0]))
    assert run("evaluate", tmp_path / "inverse.txt", "--truth", TRUTH) == 0
    assert "its inverse is near the truth" in capsys.readouterr().out
    assert run("evaluate", shifted, "--truth", TRUTH) == 0
    assert "inverse" not in capsys.readouterr().out


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1 / 25.4])
def test_a_translation_in_another_unit_is_told(tmp_path, shifted, capsys, factor):
    T = CASE.T_target_source.copy()
    T[:3, 3] *= factor
    np.savetxt(tmp_path / "other.txt", T)
    assert run("evaluate", tmp_path / "other.txt", "--truth", TRUTH) == 0
    assert f"translation times {1 / factor:g} it is near the truth: it is in another" in capsys.readouterr().out
    assert run("evaluate", shifted, "--truth", TRUTH) == 0
    assert "another length unit" not in capsys.readouterr().out


def test_scan_points_are_measured_too(tmp_path):
    truth, out = tmp_path / "truth.txt", tmp_path / "errors.json"
    np.savetxt(truth, CASE.T_target_source)
    sides = ["--target", CASE.part, "--scan", CASE.scan]
    assert run("evaluate", truth, "--truth", truth, *sides, "--out", out, "--quiet") == 0
    values = json.loads(out.read_text())
    # 1185 of the 60194 points of the shipped case are strays, as its truth.json says; a few of them lie on the part.
    # Its noise is 0.05 mm along the ray, less across the surface.
    assert values["overlap"] == pytest.approx(1.0 - 1185 / 60194, abs=0.005)
    assert 0.025 < values["surface_rms"] < 0.05


def test_without_a_part_the_origin_is_followed(shifted, tmp_path, capsys):
    np.savetxt(tmp_path / "truth.txt", CASE.T_target_source)
    assert run("evaluate", shifted, "--truth", tmp_path / "truth.txt") == 0
    text = capsys.readouterr().out
    assert "offset at the origin" in text
    assert "--target" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["no.txt", "--truth", "{truth}"], "no.txt"),
        (["{pose}", "--truth", "no.json"], "no.json"),
        (["{pose}"], "--truth"),
        (["{pose}", "--truth", "{truth}", "--target", "no.stl"], "no.stl"),
        (["{pose}", "--truth", "{pose}", "--scan", "{scan}"], "--target"),
        (["{pose}", "--truth", "{truth}", "--out", "no/where.json"], "no"),
        (
            ["{pose}", "--truth", "{truth}", "--within", "-1"],
            "--within must be a length above 0, in target units; got -1",
        ),
        (["{pose}", "--truth", "{truth}", "--within", "nan"], "--within must be a length above 0"),
    ],
)
def test_bad_input_is_exit_2_and_one_line(arguments, said, shifted, capsys):
    names = {"truth": TRUTH, "pose": shifted, "scan": CASE.scan}
    assert run("evaluate", *(word.format(**names) for word in arguments)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("dqreg: error: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
