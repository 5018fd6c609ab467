"""`dqreg studio`: what it refuses before it serves, and what it does without a page."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from dqreg.cli.studio import studio
from dqreg.errors import InputError, MissingDependencyError
from dqreg.files import write_cloud
from dqreg.geometry import Mesh, sample_mesh
from dqreg.studio.visit import Side, Visit
from dqreg.synth.parts import box


def refused(*words: str) -> Exception:
    with pytest.raises((InputError, MissingDependencyError)) as caught:
        CliRunner().invoke(studio, list(words), catch_exceptions=False, standalone_mode=False)
    return caught.value


def test_wrong_words_are_refused_before_anything_is_served(tmp_path):
    assert "SCAN and PART" in str(refused("scan.ply"))
    assert "no such file" in str(refused(str(tmp_path / "scan.ply"), str(tmp_path / "part.stl")))
    assert "expected the path of a visit" in str(refused("--replay", str(tmp_path / "visit.json")))
    assert "dqreg batch" in str(refused("--batch", str(tmp_path / "none")))
    (tmp_path / "file").write_text("x")
    assert "cannot keep visits" in str(refused("--folder", str(tmp_path / "file" / "inside")))


def test_without_its_packages_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    error = refused()
    assert isinstance(error, MissingDependencyError)
    assert "pip install 'dqreg[studio]'" in str(error)


def test_its_help_loads_no_server():
    code = (
        "import sys; from dqreg.cli.lazy_group import cli; import click\n"
        "cli.get_command(click.Context(cli), 'studio').get_help(click.Context(cli))\n"
        "print([name for name in ('starlette', 'uvicorn', 'numpy', 'open3d') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.soak
def test_a_visit_is_done_again_without_the_page(tmp_path):
    import trimesh

    part = Mesh(*box((30.0, 20.0, 10.0)))
    trimesh.Trimesh(part.vertices, part.faces, process=False).export(tmp_path / "part.stl")
    off = np.array([0.2, 0.1, -0.1])
    write_cloud(tmp_path / "scan.ply", sample_mesh(part, 2000, np.random.default_rng(0)).points + off)
    sides = [Side(name, name, "mm") for name in ("scan.ply", "part.stl")]
    Visit(*sides, start="identity", tolerance=0.1, head=(("serial", "7"),)).save(tmp_path / "visit.json")
    words = ["--replay", str(tmp_path / "visit.json"), "--out", str(tmp_path / "out")]
    assert CliRunner().invoke(studio, words, catch_exceptions=False, standalone_mode=False).return_value == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"result.json", "plan.toml", "report.html"}
    T = np.array(json.loads((tmp_path / "out" / "result.json").read_text())["T_target_source"])
    np.testing.assert_allclose(T[:3, 3], -off, atol=1e-6)
    # A part whose upper face is worn, far beyond its tolerance, fails.
    points = sample_mesh(part, 2000, np.random.default_rng(0)).points
    points[points[:, 2] > points[:, 2].max() - 1e-6, 2] -= 0.05
    write_cloud(tmp_path / "scan.ply", points)
    Visit(*sides, start="identity", tolerance=0.01).save(tmp_path / "visit.json")
    assert CliRunner().invoke(studio, words, catch_exceptions=False, standalone_mode=False).return_value == 3
