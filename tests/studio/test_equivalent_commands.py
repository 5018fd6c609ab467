"""Every step's command and Python, run as they are shown, give what the page shows."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from dqreg.cli.lazy_group import cli
from dqreg.files import read_geometry, write_cloud
from dqreg.files.strict_json import plain
from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose, twist
from dqreg.studio import judging
from dqreg.studio.aligning import align
from dqreg.studio.cleaning import kept_rows
from dqreg.studio.equivalent_commands import cleaned_name, commands_of
from dqreg.studio.visit import Cut, FaceTolerance, Pair, PlaneCut, Reference, Side, Visit
from dqreg.studio.worker_cache import Place
from dqreg.synth.parts import box

pytestmark = pytest.mark.soak
PART = Mesh(*box((30.0, 20.0, 10.0)))
T = twist.exp(np.array([0.02, -0.03, 0.05, 0.4, -0.3, 0.2]))
TURNED = tuple(map(tuple, (T @ twist.exp(np.array([0.05, 0.0, 0.02, 0.3, 0.1, 0.0]))).tolist()))
CORNERS = np.array([[15.0, 10.0, 5.0], [-15.0, 10.0, 5.0], [15.0, -10.0, 5.0], [-15.0, -10.0, -5.0]])
PAIRS = tuple(
    Pair(tuple(a), tuple(b), weight)
    for a, b, weight in zip(
        pose.apply(pose.inverse(T), CORNERS).tolist(), CORNERS.tolist(), (1.0, 2.0, 1.0, 0.5), strict=True
    )
)
PLACES = [(9.0, 5.0, 5.0), (-9.0, 5.0, 5.0), (0.0, -6.0, 5.0), (10.0, 10.0, 0.0), (-10.0, 10.0, 0.0), (15.0, 0.0, 0.0)]
NORMALS = [(0.0, 0.0, 1.0)] * 3 + [(0.0, 1.0, 0.0)] * 2 + [(1.0, 0.0, 0.0)]
CASES: dict[str, dict[str, Any]] = {
    "search": {},
    "as scanned, a tolerance": {"start": "identity", "tolerance": 0.1},
    "pairs, two sides": {"start": "pairs", "pairs": PAIRS, "tolerance": 0.1, "minus": 0.05, "required": 99.0},
    "by hand, locked": {"start": "hand", "T_start": TURNED, "dof": "tx ty tz rz", "tolerance": 0.5},
    "a rival, a reach": {"start": "rival", "T_start": TURNED, "reach": 1.5, "tolerance": 0.1},
    "a reach alone": {"start": "identity", "reach": 1.5},
    "faces": {
        "start": "identity",
        "faces": (FaceTolerance(2, 0.05), FaceTolerance(0, 0.1, 0.0)),
        "head": (("serial", 'no. 7 "b"'),),
    },
    "a cut": {
        "start": "identity", "cuts": (Cut("box", low=(-4.0, -4.0, 0.0), high=(4.0, 4.0, 9.0)),), "tolerance": 0.1,
    },
    "a box kept, a plane and a lasso left out": {
        "start": "identity", "tolerance": 0.1, "cuts": (
            Cut("box", keep=True, low=(-40.0, -40.0, -40.0), high=(40.0, 40.0, 14.0)),
            Cut("plane", normal=(0.0, 0.0, 1.0), offset=5.0, half=0.2),
            Cut("lasso", polygon=((-3.0, -3.0), (3.0, -3.0), (0.0, 3.0))),
        ),
    },
    "mirrored": {"mirrored": True, "tolerance": 0.1},
    "a plan that was read": {
        "start": "identity", "tolerance": 0.1, "alignment": "plan", "plan": (
            '[[datum]]\nname = "A"\nnear = [0, 0, 5]\n[[datum]]\nname = "B"\nnear = [0, 10, 0]\n[[datum]]\nname = "C"\n'
            'near = [15, 0, 0]\n[[characteristic]]\nname = "flat"\nkind = "form"\nface = 0\ntolerance = 0.2\n'
        ),
    },
    "chosen faces": {
        "start": "identity", "alignment": "faces", "chosen": (0, 2, 4), "weights": (1.0, 3.0), "goal": "minimax",
        "tolerance": 0.1,
    },
    "most within": {
        "start": "identity", "alignment": "faces", "chosen": (0, 2, 4), "goal": "tolerance", "tolerance": 0.1,
    },
    "3-2-1": {"start": "identity", "alignment": "datums", "datums": (4, 2, 0), "tolerance": 0.1},
    "RPS": {
        "start": "identity", "alignment": "points", "references": tuple(map(Reference, PLACES, NORMALS)),
        "tolerance": 0.1,
    },
    "sections": {"start": "identity", "sections": (PlaneCut((1.0, 2.0, 3.0), (0.0, 1.0, 0.0)),), "tolerance": 0.1},
    "sections alone": {"start": "identity", "sections": (PlaneCut((1.0, 2.0, 3.0), (0.0, 1.0, 0.0)),)},
    "labels and views": {
        "start": "identity", "tolerance": 0.1, "labels": ((4.0, 3.0, 5.0),), "views": ((35.0, 30.0),),
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    import trimesh

    folder = tmp_path_factory.mktemp("files")
    rng = np.random.default_rng(0)
    points = sample_mesh(PART, 6000, rng).points + rng.normal(0.0, 0.02, (6000, 3))
    write_cloud(folder / "a scan.ply", pose.apply(pose.inverse(T), points))
    trimesh.Trimesh(PART.vertices, PART.faces, process=False).export(folder / "part.stl")
    return folder


def run(line: str) -> str:
    """What a shell would do with a line, without the start of a process; `test_page` asks a shell."""
    name, *words = shlex.split(line)
    assert name == "dqreg"
    answer = CliRunner().invoke(cli, words, standalone_mode=False)
    # Trusted or not, within or not: it ran.
    assert answer.exception is None, (line, answer.output, answer.exception)
    assert answer.return_value in (0, 1, 3), (line, answer.output)
    return answer.stdout


@pytest.mark.parametrize("case", CASES)
def test_what_is_shown_gives_what_is_shown(files, tmp_path, case, monkeypatch):
    sides = [Side(name, str(files / name), "mm") for name in ("a scan.ply", "part.stl")]
    visit = dataclasses.replace(Visit(*sides), **CASES[case])
    place = Place(tmp_path, visit)
    visit.save(tmp_path / "visit.json")
    shown, judged = align(place), plain(judging.judge(place))
    judging.write_sheet(place)
    words = commands_of(visit)
    for name in ("a scan.ply", "part.stl"):
        (tmp_path / name).symlink_to(files / name)
    pose_file = tmp_path / "result.json"
    expected = json.loads(pose_file.read_text())["T_target_source"]
    assert shown["T"] == expected

    monkeypatch.chdir(tmp_path)
    cleaned = cleaned_name(visit)
    if cleaned is not None:
        # The step Clean without the page: the same points, byte for byte.
        points = (tmp_path / cleaned).read_bytes()
        (tmp_path / cleaned).unlink()
        run(words["clean"]["command"])
        assert (tmp_path / cleaned).read_bytes() == points
        if visit.cuts:
            left = np.count_nonzero(kept_rows(place.scan().points, visit.cuts))
            assert len(read_geometry(tmp_path / cleaned).points) == left < 6000
    pose_file.unlink()
    run(words["align"]["command"])
    assert json.loads(pose_file.read_text())["T_target_source"] == expected
    if "--plan" in words["judge"]["command"]:
        found = json.loads(run(words["judge"]["command"] + " --json"))
        assert found["decision"]["regions"] == judged["faces"]
        for figure in ("outcome", "share_within", "uncertainty"):
            assert found["decision"][figure] == judged["decision"][figure]
        assert found["counts"] == judged["counts"]
    else:
        run(words["judge"]["command"])
    before = (tmp_path / "report.html").read_text()
    (tmp_path / "report.html").unlink()
    run(words["report"]["command"])
    after = (tmp_path / "report.html").read_text()
    assert cells(after) == cells(before)
    assert len(cells(after)) > 20


def cells(page: str) -> list[str]:
    """Cells of the tables of a report but for times, which no two runs share."""
    page = re.sub(r"<h3>Seconds</h3>.*?</table>", "", page, flags=re.S)
    return re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", page, flags=re.S)


@pytest.mark.parametrize("case", ["pairs, two sides", "a rival, a reach", "RPS", "a reach alone"])
def test_the_python_gives_what_is_shown(files, tmp_path, case, monkeypatch, capsys):
    sides = [Side(name, str(files / name), "mm") for name in ("a scan.ply", "part.stl")]
    visit = dataclasses.replace(Visit(*sides), **CASES[case])
    place = Place(tmp_path, visit)
    visit.save(tmp_path / "visit.json")
    shown, judged = align(place), plain(judging.judge(place))
    for name in ("a scan.ply", "part.stl"):
        (tmp_path / name).symlink_to(files / name)
    monkeypatch.chdir(tmp_path)
    words = commands_of(visit)
    for step in ("load", "align", "judge", "report"):
        names: dict[str, Any] = {}
        exec(words[step]["python"], names)
        if step in ("align", "judge"):
            assert names["result"].T_target_source.tolist() == shown["T"]
        if step == "judge" and "found" in names:
            assert names["found"].decision.share_within == judged["decision"]["share_within"]
            assert names["found"].outcome == judged["decision"]["outcome"]
    assert (tmp_path / "report.html").is_file()
