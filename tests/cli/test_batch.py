from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.batch import _kept_words, batch, thumbnail
from dqreg.registration.batch import BatchProgress, Workers
from dqreg.registration.batch.row import Targets, run_row
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from tests.cli.command import run
from tests.registration.batch.scenes import make_scene


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("batch"), 2)


@pytest.fixture
def here(monkeypatch):
    """Rows run in this process: what is tested here is the command around them."""

    def answers(self, rows, thumbnail, stop):
        targets = Targets()
        for row in rows:
            if stop():
                return
            yield row, run_row(row, targets, thumbnail)

    monkeypatch.setattr("dqreg.registration.batch.run.Workers.answers", answers)


def test_a_row_may_take_as_long_as_from_python():
    # The command does not load the room for its help, so it states the limit once more.
    (timeout,) = (option.default for option in batch.params if option.name == "timeout")
    assert timeout == Workers().timeout


def test_rows_that_other_code_did_are_told_of():
    assert _kept_words(BatchProgress(0, 9, math.nan)) == ""
    assert _kept_words(BatchProgress(3, 9, math.nan)) == "3 of 9 rows are done already"
    words = _kept_words(BatchProgress(3, 9, math.nan, outdated=2))
    assert words == "3 of 9 rows are done already; 2 are done again: another dqreg, or other versions, did them"


def test_writes_what_it_says_and_resumes(scene, tmp_path, capsys, monkeypatch, here):
    monkeypatch.chdir(tmp_path)
    assert run("batch", scene.manifest) == 0
    text = capsys.readouterr().out
    out = tmp_path / "rows-results"
    for name in ("summary.csv", "summary.html"):
        assert f"wrote {Path('rows-results') / name}" in text
    assert "2 accepted" in text
    assert "1/2  scan0: accepted" in text
    lines = list(csv.DictReader((out / "summary.csv").read_text().splitlines()))
    assert [line["name"] for line in lines] == ["scan0", "scan1"]
    for line in lines:
        result = Registration.load(out / line["result"])
        # Truth: the motion that made the scan, inverted; 0.2 mm is above the noise of parts 100 mm and more across.
        assert np.abs(result.T_target_source - scene.truths[line["name"]]).max() < 0.2
        assert float(line["rms"]) == result.rms
        assert [float(line[name]) for name in ("tx", "ty", "tz")] == result.T_target_source[:3, 3].tolist()
    page = (out / "summary.html").read_text()
    assert page.count("data:image/jpeg;base64,/9j/") == 2
    files = {path: path.read_bytes() for path in out.rglob("*.json")}
    assert run("batch", scene.manifest) == 2
    assert "--resume" in capsys.readouterr().err
    assert run("batch", scene.manifest, "--resume") == 0
    assert "2 of 2 rows are done already" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in out.rglob("*.json")} == files
    # Another option for one row: that row alone is done again.
    json_of = {path.stem: path.stat().st_ino for path in files}
    manifest = scene.folder / "again.csv"
    manifest.write_text(
        scene.manifest.read_text().replace("scan1.npy,feeder.off,identity,fast", "scan1.npy,feeder.off")
    )
    code = run("batch", manifest, "--start", "identity", "--out", out, "--resume", "--quiet", "--no-thumbnails")
    assert code in (0, 1)
    now = {path.stem: path.stat().st_ino for path in out.rglob("*.json")}
    assert now["scan0"] == json_of["scan0"]
    assert now["scan1"] != json_of["scan1"]
    assert capsys.readouterr().out == ""


def test_a_folder_and_a_row_that_fails_is_exit_1(scene, tmp_path, capsys, here):
    scans = tmp_path / "scans"
    scans.mkdir()
    (scans / "good.npy").write_bytes((scene.folder / "scan0.npy").read_bytes())
    np.save(scans / "line.npy", np.outer(np.arange(40.0), [1.0, 2.0, 2.0]))
    target, out = scene.folder / "bracket.off", tmp_path / "out"
    assert run("batch", scans, "--target", target, "--start", "identity", "--effort", "fast", "--out", out) == 1
    text = capsys.readouterr().out
    assert "1 accepted, 1 error" in text
    assert "line: ERROR: " in text
    assert sorted(path.name for path in (out / "results").iterdir()) == ["good.json"]
    settings = json.loads((out / "results" / "good.json").read_text())["settings"]
    assert settings["effort"] == "fast"


def test_a_thumbnail_is_a_small_jpeg_for_meshes_and_clouds(scene, tmp_path):
    scan = scene.folder / "scan0.npy"
    for target in (scene.folder / "bracket.off", scan):
        picture = thumbnail(register(scan, target, "identity", effort="fast"))
        assert picture.startswith(b"\xff\xd8\xff")
        assert 500 < len(picture) < 30_000
    assert thumbnail(register(scan, target, "identity", effort="fast", keep_inputs=False)) is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.csv"], "nowhere.csv"),
        (["{folder}"], "--target"),
        (["{manifest}", "--target", "no.stl", "--effort", "huge"], "'huge'"),
        (["{manifest}", "--max-distance", "-1"], "-1"),
        (["{manifest}", "--workers", "0"], "workers"),
        (["{manifest}", "--threads", "0"], "threads"),
        (["{manifest}", "--timeout", "-3"], "timeout"),
        (["{manifest}", "--workers", "2", "--scheduler", "tcp://x:1"], "workers"),
        (["{manifest}", "--out", "{manifest}"], "file"),
        (["{bad}"], "line 2"),
        (["{bad}", "--resume"], "line 2"),
        ([], "MANIFEST"),
    ],
)
def test_bad_input_is_exit_2_one_line_and_nothing_written(arguments, said, scene, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # A row of a missing file costs that row; a manifest of such rows only has nothing to run.
    (scene.folder / "bad.csv").write_text("scan,target\nscan9.npy,bracket.off\n")
    names = {"folder": scene.folder, "manifest": scene.manifest, "bad": scene.folder / "bad.csv"}
    assert run("batch", *(word.format(**names) for word in arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("dqreg: error: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
    assert list(tmp_path.iterdir()) == []


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom dqreg.cli.main import main\n"
        "try:\n    main(['batch', '--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = ('open3d', 'scipy', 'trimesh', 'matplotlib', 'jinja2', 'distributed', 'PIL')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "[]"
    assert "--resume" in answer.stdout
