from __future__ import annotations

import json
import subprocess
import sys

import pytest

from dqreg.cli import reproduce as command
from dqreg.errors import InputError
from dqreg.papers import PAPERS


def run(*arguments: object) -> int:
    return command.reproduce.main([str(a) for a in arguments], standalone_mode=False)


@pytest.mark.parametrize("paper", sorted(PAPERS))
def test_prints_tables_and_writes_what_it_says(paper, tmp_path, capsys):
    out = tmp_path / "new" / "folder"
    assert run(paper, "--quick", "--seed", "5", "--out", out) == 0
    text = capsys.readouterr().out
    expected = {"results.json", "report.html", *(f"figure-{key}.png" for key in PAPERS[paper].figures)}
    assert {path.name for path in out.iterdir()} == expected
    for name in expected:
        assert f"wrote {out / name}" in text
    read = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert (read["paper"], read["seed"], read["quick"]) == (paper, 5, True)
    assert "numpy" in read["versions"]
    for section in read["sections"]:
        assert section["title"] in text
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == len(PAPERS[paper].figures)
    assert f"reproduce {paper} --seed 5 --quick" in page


def test_default_folder_and_quiet(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # The figures of the same paper are drawn in the test above.
    monkeypatch.setattr("dqreg.papers.output.draw_png", lambda figure: b"")
    assert run("jia2020", "--quick", "--quiet") == 0
    assert capsys.readouterr().out == ""
    assert (tmp_path / "dqreg-jia2020" / "report.html").is_file()


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_an_unwritable_folder_is_refused_before_any_work(place, tmp_path, monkeypatch):
    def work(*arguments, **options):
        raise AssertionError("the work had begun")

    monkeypatch.setattr("dqreg.papers.reproduce", work)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot make the folder"):
        run("walker1991", "--out", tmp_path / place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_loads_nothing_heavy_before_it_runs():
    code = "import sys, dqreg.cli.reproduce; print([m for m in ('matplotlib', 'jinja2', 'scipy') if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
