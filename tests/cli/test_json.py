"""`--json`: standard output holds the answer as strict JSON and nothing else; lengths say their unit."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dqreg.registration.batch.row import Targets, run_row
from dqreg.rigid import pose
from dqreg.synth import demo_case, load_case
from tests.cli.command import run
from tests.registration.batch.scenes import make_scene

CASE = load_case(demo_case())
TRUTH = CASE.folder / "truth.json"
RECIPE = 'name = "tiny"\nseed = 1\n[part]\nkind = "prism"\n[scanner]\nviews = [[1, 2, 3]]\npixels = 30\n'


def strictly(text: str):
    def never(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=never)


@pytest.fixture
def shifted(tmp_path):
    np.savetxt(tmp_path / "pose.txt", pose.from_parts(np.eye(3), [0.0, 3.0, 4.0]) @ CASE.T_target_source)
    return tmp_path / "pose.txt"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("json"), 1)


def test_evaluate(shifted, tmp_path, capsys):
    assert run("evaluate", shifted, "--truth", TRUTH, "--json", "--out", tmp_path / "e.json") == 0
    text = capsys.readouterr().out
    values = strictly(text)
    assert values == json.loads((tmp_path / "e.json").read_text())
    assert values["worst"] == pytest.approx(5.0, abs=1e-9)
    assert values["units"] == "mm"
    # Without a part there is no vertex to measure: null, not NaN.
    np.savetxt(tmp_path / "truth.txt", CASE.T_target_source)
    assert run("evaluate", shifted, "--truth", tmp_path / "truth.txt", "--json") == 0
    assert strictly(capsys.readouterr().out)["size"] is None


def test_evaluate_names_the_unit_of_every_length(shifted, tmp_path, capsys):
    assert run("evaluate", shifted, "--truth", TRUTH, "--scan", CASE.scan, "--within", "6") == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(re.search(r"worst +5 mm \(", line) for line in lines), lines
    for word in ("offset", "rms", "worst", "within"):
        assert all(" mm" in line for line in lines if word in line), lines
    # No file says a unit: the words say whose it is.
    np.savetxt(tmp_path / "truth.txt", CASE.T_target_source)
    assert run("evaluate", shifted, "--truth", tmp_path / "truth.txt", "--target", CASE.part, "--within", "1") == 1
    text = capsys.readouterr().out
    assert "NOT within 1 target units" in text


def test_synth(tmp_path, capsys):
    (tmp_path / "recipe.toml").write_text(RECIPE)
    assert run("synth", tmp_path / "recipe.toml", "--out", tmp_path / "case", "--json") == 0
    values = strictly(capsys.readouterr().out)
    assert Path(values["scan"]).is_file()
    assert values["truth"] == json.loads((tmp_path / "case" / "truth.json").read_text())


def test_show(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    sides = scene.folder / "scan0.npy", scene.folder / "bracket.off"
    assert run("register", *sides, "--start", "identity", "--effort", "fast", "--quiet", "--out", tmp_path / "r.json",
               "--target-units", "mm", "--source-units", "mm") == 0  # fmt: skip
    assert run("show", tmp_path / "r.json", "--json", "--tolerance", "0.5") == 0
    values = strictly(capsys.readouterr().out)
    assert values["T_target_source"] == json.loads((tmp_path / "r.json").read_text())["T_target_source"]
    assert values["deviations"]["units"] == "mm"
    assert values["deviations"]["summary"]["count"] <= 3_000
    assert values["deviations"]["bands"]["within"] > 0.99


def test_batch(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("dqreg.registration.batch.run.Workers.answers", lambda _, rows, *__: (
        (row, run_row(row, Targets())) for row in rows
    ))  # fmt: skip
    assert run("batch", scene.manifest, "--out", tmp_path / "out", "--no-thumbnails", "--json") == 0
    captured = capsys.readouterr()
    values = strictly(captured.out)
    (row,) = values["rows"]
    assert (row["name"], row["verdict"], captured.err) == ("scan0", "accepted", "")
    record = json.loads((tmp_path / "out" / row["result"]).read_text())
    assert [row["pose"][name] for name in ("tx", "ty", "tz")] == [r[3] for r in record["T_target_source"][:3]]
    assert str(tmp_path / "out" / "summary.csv") in values["files"]


def test_compare_list(capsys):
    assert run("compare", "--list", "--json", "-e", "dqreg") == 0
    assert [each["engine"] for each in strictly(capsys.readouterr().out)] == ["dqreg"]


def test_compare(tmp_path, capsys):
    (tmp_path / "own.py").write_text(
        "import numpy as np\nclass Own:\n    name = 'own'\n    settings = ('manual',)\n"
        "    def register(self, task):\n        return np.eye(4) if task.start is None else task.start\nown = Own()\n"
    )
    words = ["compare", CASE.folder, "-e", tmp_path / "own.py", "--setting", "manual", "--repeats", 1, "--json"]
    assert run(*words) == 0
    values = strictly(capsys.readouterr().out)
    assert [each["engine"] for each in values["runs"]] == ["own"]
    # The start of the shipped case is 20 degrees off, as its truth.json says.
    assert values["runs"][0]["angle_rad"] == pytest.approx(np.deg2rad(20.0), abs=1e-6)


def test_odometry(tmp_path, capsys):
    pytest.importorskip("kiss_icp", reason="the odometry stands on dqreg[odometry]")
    rng = np.random.default_rng(0)
    walls = rng.uniform(-1, 1, (3, 4000, 3)) * [8, 6, 3]
    side = np.arange(4000) % 3
    for number, wall in enumerate(walls):
        rows = np.arange(4000)
        wall[rows, side] = np.sign(wall[rows, side]) * np.array([8, 6, 3])[side]
        wall[:, 0] -= 0.2 * number
    np.savez(tmp_path / "hall.npz", points=np.vstack(list(walls)), offsets=np.arange(4) * 4000)
    assert run("odometry", tmp_path / "hall.npz", "--json") in (0, 1)
    values = strictly(capsys.readouterr().out)
    assert [frame["frame"] for frame in values["frames"]] == [0, 1, 2]
    # The sensor moves by 0.2 a frame; the walls are 4,000 points drawn anew.
    assert values["frames"][2]["T_target_source"][0][3] == pytest.approx(0.4, abs=0.03)
