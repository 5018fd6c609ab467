from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.main import main
from dqreg.synth import demo_case, load_case


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return int(stop.value.code or 0)


def test_from_a_suggested_plan_to_a_sheet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(demo_case())
    assert run("inspect", "--suggest", case.part) == 0
    # The scanner saw neither the part's lower face (1) nor its back (11): others take their place.
    # Tolerances of 0.08 mm are guesses; the scan's noise and the part's facets need more.
    changes = {"= 0.08": "= 0.5", "= 0.16": "= 1", "face = 1\n": "face = 0\n", "face = 11\n": "face = 12\n"}
    plan = capsys.readouterr().out
    for old, new in changes.items():
        plan = plan.replace(old, new)
    (tmp_path / "plan.toml").write_text(plan, encoding="utf-8")
    np.savetxt(tmp_path / "start.txt", case.T_start)
    common = ("inspect", case.scan, case.part, "--plan", tmp_path / "plan.toml", "--start", tmp_path / "start.txt",
              "--source-units", "mm", "--target-units", "mm")  # fmt: skip
    written = ("--report", tmp_path / "sheet.html", "--csv", tmp_path / "sheet.csv", "--json")
    code = run(*common, *written)
    found = json.loads(capsys.readouterr().out)
    assert code == (0 if found["outcome"] == "pass" else 3)
    assert found["verdict"]["level"] == "accepted"
    # The pose is the datums', near the truth that the virtual scan came with: noise 0.05 mm on faces of 100 mm.
    assert np.abs(np.array(found["T_target_source"]) - case.T_target_source).max() < 0.1
    page = (tmp_path / "sheet.html").read_text(encoding="utf-8")
    assert f"Part by its plan: {found['outcome']}" in page
    assert len((tmp_path / "sheet.csv").read_text().splitlines()) == 1 + len(found["characteristics"])


def test_what_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(demo_case())
    assert run("inspect", case.scan, case.part) == 2
    assert "--plan FILE; dqreg inspect --suggest PART" in capsys.readouterr().err
    assert run("inspect", case.scan, case.part, "--plan", tmp_path / "none.toml") == 2
    assert "cannot read the plan" in capsys.readouterr().err
