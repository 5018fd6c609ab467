from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dqreg.files import read_cloud, read_mesh
from dqreg.rigid import pose
from dqreg.synth import load_case, worst_vertex_displacement
from tests.cli.command import run


def test_register_writes_what_it_says(tmp_path, case, start, capsys):
    out, aligned = tmp_path / "result.json", tmp_path / "aligned.ply"
    code = run("register", case.scan, case.part, "--start", start, "--out", out, "--aligned", aligned)
    text = capsys.readouterr().out
    assert code == 0
    assert "ACCEPTED" in text
    assert f"wrote {out}" in text
    T = np.array(json.loads(out.read_text())["T_target_source"])
    # Truth: truth.json of the shipped case; 2e-5 S is six times the Cramer-Rao bound of this scan.
    assert worst_vertex_displacement(T, case.T_target_source, read_mesh(case.part).vertices) < 2e-5 * case.part_diagonal
    moved = pose.apply(T, read_cloud(case.scan).points)
    # Float32 in the PLY file: 156 mm in steps of 1e-5.
    np.testing.assert_allclose(read_cloud(aligned).points, moved, atol=2e-5)


def test_a_result_is_a_start(tmp_path, case, start):
    out = tmp_path / "result.json"
    assert run("register", case.scan, case.part, "--start", start, "--out", out, "--quiet") == 0
    assert run("register", case.scan, case.part, "--start", out, "--effort", "fast", "--quiet") == 0


def test_quiet_prints_nothing(case, start, capsys):
    run("register", case.scan, case.part, "--start", start, "--quiet", "--effort", "fast")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_a_pipe_gets_a_line_for_each_run_of_the_loop(case, start, capsys):
    run("register", case.scan, case.part, "--start", start, "--effort", "fast")
    captured = capsys.readouterr()
    # The answer alone is on the standard output.
    assert "loop 1" not in captured.out
    lines = captured.err.splitlines()
    assert lines[0].startswith("loop 1  ")
    assert [line.split()[1] for line in lines] == [str(k) for k in range(1, len(lines) + 1)]
    assert len(lines) < 5


def test_not_accepted_is_exit_1(tmp_path, capsys):
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(size=(2000, 2)), np.zeros(2000)])
    np.save(tmp_path / "a.npy", flat)
    np.save(tmp_path / "b.npy", flat + np.array([0.001, 0.0, 0.001]))
    assert run("register", tmp_path / "a.npy", tmp_path / "b.npy", "--start", "identity") == 1
    assert "unconstrained: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["register", "no.ply", "{part}"], "no.ply"),
        (["register", "{scan}", "no.stl"], "no.stl"),
        (["register", "{scan}", "{part}", "--method", "foo"], "'foo'"),
        (["register", "{scan}", "{part}", "--effort", "huge"], "'huge'"),
        (["register", "{scan}", "{part}", "--start", "nowhere.txt"], "nowhere.txt"),
        (["register", "{scan}", "{part}", "--start", "{scan}"], "4x4"),
        (["register", "{scan}", "{part}", "--start", "{mirror}"], "mirror"),
        (["register", "{scan}", "{part}", "--out", "no/such/folder/r.json"], "folder"),
        (["register", "{scan}", "{part}", "--max-distance", "-1"], "-1"),
        (["register", "{scan}"], "TARGET"),
        (["register", "{scan}", "{part}", "--strt", "none"], "--start"),
        (["regster"], "regster"),
        (["synth", "no.toml"], "no.toml"),
    ],
)
def test_bad_input_is_exit_2_and_one_line(arguments, said, tmp_path, case, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savetxt(tmp_path / "mirror.txt", np.diag([1.0, 1.0, -1.0, 1.0]))
    names = {"scan": case.scan, "part": case.part, "mirror": tmp_path / "mirror.txt"}
    before = sorted(tmp_path.iterdir())
    assert run(*(a.format(**names) for a in arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("dqreg: error: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
    assert sorted(tmp_path.iterdir()) == before


def test_demo_reports_the_true_error(tmp_path, capsys):
    assert run("demo", "--out", tmp_path / "demo") == 0
    text = capsys.readouterr().out
    assert "against the truth" in text
    assert sorted(p.name for p in (tmp_path / "demo").iterdir()) == ["aligned.ply", "report.html", "result.json"]


@pytest.mark.parametrize("out", ["file", "file/folder"])
def test_the_demo_refuses_a_place_where_no_folder_can_be(out, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert run("demo", "--out", tmp_path / out) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"dqreg: error: cannot make the folder {tmp_path / out}: ")
    assert (captured.out, captured.err.count("\n")) == ("", 1)


def test_synth_makes_a_case(tmp_path, case):
    assert run("synth", case.folder / case.recipe.name, "--out", tmp_path / "made", "--seed", "3", "--quiet") == 0
    assert load_case(tmp_path / "made").seed == 3


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom dqreg.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('open3d', 'scipy', 'trimesh', 'matplotlib') if m in sys.modules])"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert answer.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("width", ["0", "00", ""])
def test_a_terminal_of_no_width_is_told_all_the_same(width, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", width)
    monkeypatch.setenv("LINES", width)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    np.savetxt(tmp_path / "pose.txt", np.eye(4))
    assert run("evaluate", tmp_path / "pose.txt", "--truth", tmp_path / "pose.txt") == 0
    assert "offset at the origin" in capsys.readouterr().out


def started(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    code = f"import os, sys; os.rmdir({str(folder)!r}); from dqreg.cli.main import main; main({list(arguments)!r})"
    folder.mkdir()
    words = [sys.executable, "-P", "-c", code]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_deleted_working_folder_is_one_line(tmp_path, case):
    # Open3D's own libraries end the process there.
    told = started(tmp_path / "gone", "register", str(case.scan), str(case.part), "--out", "result.json")
    assert (told.returncode, told.stdout) == (2, "")
    assert told.stderr.count("\n") == 1
    assert told.stderr.startswith("dqreg: error: ")


def test_the_module_is_the_command_and_takes_no_standard_module_of_the_working_folder(tmp_path):
    # What Python itself imports before any program begins is not ours to keep out: `python -P -m` does.
    for name in sys.stdlib_module_names - {"__future__", "importlib"}:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'a').write({f'{name} '!r})\n")
    (tmp_path / "blank.py").write_text("")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    environment.pop("PYTHONSAFEPATH", None)
    marks = []
    for words in (["blank"], ["dqreg", "evaluate", "--help"]):
        command = [sys.executable, "-m", *words]
        told = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        mark = tmp_path / "mark"
        marks.append(set(mark.read_text().split()) if mark.exists() else set())
        mark.unlink(missing_ok=True)
    assert marks[1] <= marks[0]
    assert "json" not in marks[0]
    told = subprocess.run(
        [sys.executable, "-P", *command[1:]], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (told.returncode, told.stderr, (tmp_path / "mark").exists()) == (0, "", False)
    assert told.stdout.startswith("Usage: dqreg evaluate")


def test_where_no_code_can_be_kept_one_plain_line_says_so(tmp_path):
    (tmp_path / "file").touch()
    folders = {"NUMBA_CACHE_DIR": str(tmp_path / "file" / "none"), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "dqreg", "doctor"]
    answer = subprocess.run(command, env=os.environ | folders, capture_output=True, text=True, check=False)
    (line,) = answer.stderr.splitlines()
    assert line.startswith("dqreg: warning: none of ")
    assert line.endswith("set NUMBA_CACHE_DIR to a folder that can")
