from __future__ import annotations

import json
from pathlib import Path

import pytest

from dqreg.synth import demo_case, load_case
from tests.cli.command import run
from tests.inspection.test_part_faces import bead


def test_faces_of_the_shipped_part_are_listed_and_found_by_a_point(capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(demo_case())
    assert run("faces", case.part) == 0
    text = capsys.readouterr().out
    assert "cylinder (hole)" in text
    assert run("faces", case.part, "--json") == 0
    faces = json.loads(capsys.readouterr().out)["faces"]
    hole = next(face for face in faces if face["is_hole"])
    rim = [c + r for c, r in zip(hole["feature"]["point"], hole["feature"]["frame"][0], strict=True)]
    assert run("faces", case.part, "--near", *rim, "--json") == 0
    near = json.loads(capsys.readouterr().out)["faces"]
    assert len(near) == 1


def test_a_cloud_has_no_faces(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faces", load_case(demo_case()).scan) == 2
    assert "has no faces: give the part as a mesh" in capsys.readouterr().err


def test_a_torus_is_listed_with_its_radii(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ring = bead()
    lines = [
        "OFF",
        f"{len(ring.vertices)} {len(ring.faces)} 0",
        *(f"{x} {y} {z}" for x, y, z in ring.vertices.tolist()),
    ]
    (tmp_path / "ring.off").write_text("\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in ring.faces)]) + "\n")
    assert run("faces", tmp_path / "ring.off") == 0
    assert "torus (radii 12, 2)" in capsys.readouterr().out
    assert run("faces", tmp_path / "ring.off", "--json") == 0
    (face,) = json.loads(capsys.readouterr().out)["faces"]
    assert face["kind"] == "torus"
    assert face["torus"]["minor_radius"] == pytest.approx(2.0, abs=1e-5)
