from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dqreg.compare import Protocol
from dqreg.compare import plan as plan_room
from dqreg.synth import demo_case, load_case
from tests.cli.command import run

ENGINES = Path(__file__).parents[1] / "compare" / "toy_engines.py"
CASE = load_case(demo_case())
ROOT = Path(__file__).parents[2]
SWEEP, RECIPE = ROOT / "dqreg/compare/quick.toml", ROOT / "datasets_synth/recipes/gear.toml"


@pytest.fixture
def alone(tmp_path):
    """A file with one engine: whatever the case, it says what it was given as start."""
    path = tmp_path / "engine.py"
    path.write_text(
        "import numpy as np\nclass Own:\n    name = 'own'\n    settings = ('manual', 'same-loop')\n"
        "    def register(self, task):\n        return np.eye(4) if task.start is None else task.start\nown = Own()\n"
    )
    return path


def test_writes_every_file_it_says_and_goes_on_where_it_stopped(tmp_path, alone, capsys):
    out = {name: tmp_path / f"r.{name}" for name in ("json", "html", "md", "csv")}
    arguments = [CASE.folder, "--engine", alone, "--repeats", 2, "--out", out["json"], "--report", out["html"],
                 "--markdown", out["md"], "--csv", out["csv"], "--plots", tmp_path / "plots"]  # fmt: skip
    assert run("compare", *arguments) == 0
    text = capsys.readouterr().out
    for path in out.values():
        assert f"wrote {path}" in text
        assert path.stat().st_size > 0
    assert "as its manual says" in text
    assert "same loop" in text
    assert "wrong pose" in text
    stems = [{path.stem for path in (tmp_path / "plots").glob(f"*.{kind}")} for kind in ("png", "svg", "pdf")]
    assert stems[0]
    assert stems[0] == stems[1] == stems[2]
    data = json.loads(out["json"].read_text())
    assert [(each["setting"], each["repeat"]) for each in data["runs"]] == [
        ("manual", 0), ("manual", 1), ("same-loop", 0), ("same-loop", 1),
    ]  # fmt: skip
    # The start of the shipped case is 20 degrees off, as its truth.json says.
    assert data["runs"][0]["angle_rad"] == pytest.approx(np.deg2rad(20.0), abs=1e-6)
    lines = (tmp_path / "r.jsonl").read_bytes()
    assert run("compare", *arguments) == 0
    assert (tmp_path / "r.jsonl").read_bytes() == lines
    assert "bracket, manual: own" not in capsys.readouterr().out


def test_scan_and_target_with_a_truth(tmp_path, alone, capsys):
    np.savetxt(tmp_path / "truth.txt", CASE.T_target_source)
    arguments = [CASE.scan, CASE.part, "--engine", alone, "--repeats", 1, "--setting", "manual"]
    assert run("compare", *arguments, "--start", tmp_path / "truth.txt", "--truth", tmp_path / "truth.txt") == 0
    assert re.search(r"\nown +1/1 +0 ", capsys.readouterr().out)
    assert run("compare", *arguments, "--quiet") == 0
    assert capsys.readouterr().out == ""


def test_a_device_takes_the_runs_and_none_are_kept_beside_it(alone, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["compare", CASE.folder, "--engine", alone, "--repeats", 1, "--setting", "manual", "--quiet"]
    assert run(*words, "--out", os.devnull) == 0
    assert {path.name for path in tmp_path.iterdir()} <= {alone.name, "__pycache__"}


def test_list_names_every_engine(capsys, alone):
    assert run("compare", "--list", "--engine-file", alone) == 0
    text = capsys.readouterr().out
    assert "dqreg" in text
    assert "open3d point-to-plane" in text
    assert "own" in text


def test_a_sweep_may_name_an_engine_of_a_file(tmp_path, alone, capsys):
    sweep = tmp_path / "mine.toml"
    sweep.write_text("engines = ['own']\n[base]\npoints = 200\n[axis.noise]\nvalues = [0.0]\n")
    out = tmp_path / "r.json"
    assert run("compare", "--sweep", sweep, "--engine-file", alone, "--out", out, "--quiet") == 0
    assert [each["engine"] for each in json.loads(out.read_text())["runs"]] == ["own"]


def test_stopped_before_the_first_run_names_no_file(tmp_path, alone, capsys, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("dqreg.compare.compare", stop)
    out = tmp_path / "r.json"
    assert run("compare", CASE.folder, "--engine-file", alone, "--out", out) == 130
    assert "r.jsonl" not in capsys.readouterr().err
    out.with_suffix(".jsonl").write_text("")
    assert run("compare", CASE.folder, "--engine-file", alone, "--out", out) == 130
    assert "r.jsonl" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "give a case"),
        (["nowhere"], "nowhere"),
        (["{case}", "--engine", "dqregg"], "dqreg"),
        (["{case}", "--engine-file", "none.py"], "none.py"),
        (["{case}", "--truth", "t.txt"], "--truth"),
        (["{case}", "--start", "identity"], "--start"),
        (["{case}", "--start", "none", "--setting", "same-loop"], "start"),
        (["{case}", "--report", "no/where/r.html"], "no/where"),
        (["{case}", "--timeout", "-1"], "timeout"),
        (["--sweep", "standrad"], "did you mean standard?"),
        (["--sweep", "standard.toml"], "did you mean standard?"),
        (["trust"], "did you mean --sweep trust?"),
        (["{sweep}"], "a sweep, not a recipe; did you mean dqreg compare --sweep FILE?"),
        (["--sweep", "{recipe}"], "a recipe, not a sweep; give it as CASE, without --sweep"),
        (["{scan}", "no.stl"], "no.stl"),
        (["{scan}", "{part}", "--truth", "no.txt"], "no.txt"),
        (["no.toml"], "no.toml"),
    ],
)
def test_bad_input_is_exit_2_and_one_line(arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"case": CASE.folder, "scan": CASE.scan, "part": CASE.part, "sweep": SWEEP, "recipe": RECIPE}
    assert run("compare", *(word.format(**names) for word in arguments)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("dqreg: error: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
    assert list(tmp_path.iterdir()) == []


def test_recipe_is_made_into_a_case(tmp_path):
    (tmp_path / "small.toml").write_text(
        'name = "small"\nseed = 1\n[part]\nkind = "bracket"\n[scanner]\npixels = 40\nviews = [[1, 2, 3], [-1, 1, 2]]\n'
    )
    items, title = plan_room.plan(tmp_path / "small.toml", Protocol(settings=("manual",)))
    assert title == "small"
    assert len(items[0].make().task.source) > 100


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom dqreg.cli.main import main\n"
        "try:\n    main(['compare', '--help'])\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('open3d', 'scipy', 'trimesh', 'matplotlib', 'jinja2') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "[]"
