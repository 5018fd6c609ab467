from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.overwriting import require_apart
from dqreg.errors import InputError
from dqreg.files import write_cloud
from tests.cli.command import run

FILES = ("scan.ply", "other.ply", "part.stl", "truth.json", "plan.toml", "poses.txt", "times.txt", "recipe.toml")
# Of each command one way of losing each kind of file that it reads.
LOSSES = [
    "register scan.ply part.stl --out scan.ply",
    "register scan.ply part.stl --aligned ./scan.ply",
    "register scan.ply other.ply --deviations other.ply",
    "register scan.ply link.stl --out part.stl",
    "inspect scan.ply part.stl --tolerance 1 --deviations scan.ply",
    "inspect scan.ply part.stl --plan plan.toml --csv plan.toml",
    "multiway scan.ply other.ply --fused other.ply",
    "multiway *.ply --out scan.ply",
    "multiway scan.ply other.ply --target part.stl --out part.stl",
    "odometry . --truth poses.txt --out poses.txt",
    "odometry . --out times.txt",
    "evaluate truth.json --truth poses.txt --out truth.json",
    "evaluate poses.txt --truth truth.json --out truth.json",
    "batch summary.csv --out .",
    "hand-eye poses.txt --out poses.txt",
    "compare scan.ply part.stl --truth truth.json --out truth.json",
    "compare recipe.toml --markdown recipe.toml",
    "compare scan.ply other.ply --multiway --truth poses.txt --markdown poses.txt",
]
# Two results into one file: the first would be lost.
CLASHES = [
    "register scan.ply part.stl --out a.ply --aligned a.ply",
    "inspect scan.ply part.stl --tolerance 1 --csv a.csv --deviations ./a.csv",
    "multiway scan.ply other.ply --out a.g2o --graph a.g2o",
    "odometry . --out a.csv --frames a.csv",
    "compare scan.ply part.stl --csv a --markdown a",
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files of every kind that a command reads, and that nobody reads here."""
    for name in FILES:
        (tmp_path / name).write_text(name)
    write_cloud(tmp_path / "scan.ply", np.random.default_rng(0).uniform(size=(50, 3)))
    (tmp_path / "summary.csv").write_text("scan,target\nscan.ply,other.ply\n")
    (tmp_path / "link.stl").symlink_to("part.stl")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("words", LOSSES)
def test_no_result_takes_the_place_of_a_file_that_is_read(words: str, folder: Path, capsys: pytest.CaptureFixture[str]):
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert run(*words.split()) == 2
    assert "would write over a file that is read; choose another name" in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


@pytest.mark.parametrize("words", CLASHES)
def test_two_results_do_not_share_a_file(words: str, folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run(*words.split()) == 2
    assert "; give each a file of its own" in capsys.readouterr().err


def test_devices_links_and_files_that_are_not_there(tmp_path: Path):
    null, scan = Path(os.devnull), tmp_path / "scan.ply"
    require_apart((scan, None), {"--out": null, "--report": null, "--aligned": None, "--deviations": tmp_path / "b"})
    # By the folder, before either file is there.
    (tmp_path / "link").symlink_to(tmp_path)
    with pytest.raises(InputError, match="--out"):
        require_apart((scan,), {"--out": tmp_path / "link" / "scan.ply"})


def test_what_is_refused_costs_no_pairs_of_an_earlier_run(folder: Path):
    (folder / "poses-pairs").mkdir()
    kept = folder / "poses-pairs" / "0-1.json"
    kept.write_text("{}")
    assert run("multiway", "scan.ply", "other.ply", "--out", "poses.json", "--graph", "graph.txt") == 2
    assert kept.exists()


# Names that promise another kind of file than the option writes, and what is said of each before anything is read.
PROMISES = [
    ("register scan.ply part.stl --report r.html --aligned a.pcd", "clouds are written as PLY"),
    ("multiway scan.ply other.ply --fused a.pcd", "clouds are written as PLY"),
    ("multiway scan.ply other.ply --out p.foo", "--out writes the result as JSON, or poses alone; give a name"),
    ("evaluate poses.txt --truth truth.json --out ev.txt", "--out writes JSON; give a name that ends in .json, not"),
    ("inspect scan.ply part.stl --tolerance 1 --csv s.xlsx", "--csv writes a table of comma-separated values"),
    ("inspect scan.ply part.stl --tolerance 1 --sections s.png", "--sections writes a table of comma-separated"),
    ("inspect scan.ply part.stl --tolerance 1 --out r.txt", "--out writes the registration as JSON; give a name"),
    ("odometry . --frames f.xlsx", "--frames writes a table of comma-separated values"),
]


@pytest.mark.parametrize(("words", "message"), PROMISES)
def test_a_name_that_promises_another_format_is_refused_before_the_work(
    words: str, message: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    before = sorted(folder.iterdir())
    assert run(*words.split()) == 2
    assert message in capsys.readouterr().err
    assert sorted(folder.iterdir()) == before
