from __future__ import annotations

import json

import pytest

from dqreg.cli.main import main
from dqreg.synth import demo_case, load_case


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return int(stop.value.code or 0)


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
