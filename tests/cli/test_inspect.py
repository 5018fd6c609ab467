from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dqreg.files import write_cloud
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.synth import demo_case, load_case
from dqreg.synth.parts import box, bracket, plate
from tests.cli.command import run


def test_from_a_suggested_plan_to_a_sheet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(demo_case())
    assert run("inspect", "--suggest", case.part) == 0
    # The scanner saw neither the part's lower face (1) nor its back (11): others take their place.
    # Tolerances of 0.08 mm are guesses; the scan's noise and the part's facets need more.
    changes = {"= 0.08": "= 0.5", "= 0.16": "= 1", "face = 1  ": "face = 0  ", "face = 11  ": "face = 12  "}
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
    assert list(found["sha256"]) == ["source", "target"]
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
    swapped = (case.part, case.scan, "--tolerance", "0.1", "--time-limit", "0.1")
    for command in ("inspect", "register"):
        assert run(command, *swapped, "--source-units", "mm", "--target-units", "mm") == 2
        assert "the files look swapped: part.stl is a mesh and scan.ply a cloud" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["register", "inspect", "batch"])
def test_a_share_is_no_percentage(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(demo_case())
    (tmp_path / "parts.csv").write_text(f"scan,target\n{case.scan},{case.part}\n", encoding="utf-8")
    files = (tmp_path / "parts.csv", "--out", tmp_path / "out") if command == "batch" else (case.scan, case.part)
    # Read as 0.95 %, nearly every part would pass.
    for given, words in (("0.95", "--required is in per cent; got 0.95: was 95 meant?"), ("1", "was 100 meant?")):
        assert run(command, *files, "--tolerance", "0.1", "--required", given) == 2
        assert words in capsys.readouterr().err
    assert run(command, *files, "--tolerance", "0.1", "--required", "101") == 2
    assert "--required is a percentage above 1 and at most 100; got 101" in capsys.readouterr().err


def test_sides_of_a_tolerance_stand_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # A virtual part whose base is 0.05 thicker, with noise of 0.01; the pose is that of the part itself.
    rng = np.random.default_rng(3)
    part = Mesh(*bracket())
    cloud = sample_mesh(part, 4_000, rng)
    normals = part.face_normals[MeshSurface(part).closest(cloud.points).elements]
    points = cloud.points + rng.normal(scale=0.01, size=(4_000, 1)) * normals
    points[np.abs(points[:, 2] - 10.0) < 0.05, 2] += 0.05
    write_cloud(tmp_path / "scan.ply", points)
    case = load_case(demo_case())
    common = ("inspect", tmp_path / "scan.ply", case.part, "--start", "identity", "--source-units", "mm",
              "--target-units", "mm")  # fmt: skip
    assert run(*common, "--tolerance", "+0.12/-0.06", "--csv", tmp_path / "s.csv", "--json", tmp_path / "s.json") == 0
    assert "PASS: part against +0.12/-0.06 mm" in capsys.readouterr().out
    found = json.loads((tmp_path / "s.json").read_text())
    assert (found["units"], found["angle_units"]) == ("mm", "rad")
    assert {"T_target_source", "alignment", "characteristics"} == set(found["conventions"]) <= set(found)
    assert (found["decision"]["low"], found["decision"]["high"]) == (-0.06, 0.12)
    rows = [line.split(",") for line in (tmp_path / "s.csv").read_text().splitlines()]
    assert rows[1][1:9] == ["points within the tolerance", "share", "%", "100", "95", "", "100", ""]
    # Points are spread over the whole part.
    assert found["decision"]["scanned"] > 0.95
    assert float(rows[1][11]) == pytest.approx(100.0 * found["decision"]["scanned"], abs=0.5)
    # The same with the lower side first.
    assert run(*common, "--tolerance", "-0.06/+0.12") == 0
    assert "PASS: part against +0.12/-0.06 mm" in capsys.readouterr().out
    assert run(*common, "--tolerance", "+0.03/-0.12", "--quiet") == 3
    assert run(*common, "--tolerance", "500") == 2
    assert "is not below the reach" in capsys.readouterr().err


def test_the_sheet_is_in_the_unit_that_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # The same part and scan in metres: every length of the sheet is in mm all the same.
    rng = np.random.default_rng(0)
    part = Mesh(*bracket())
    points = sample_mesh(part, 6_000, rng).points + rng.normal(scale=0.01, size=(6_000, 3))
    write_cloud(tmp_path / "scan.ply", points / 1000.0)
    corners = [" ".join(map(repr, v)) for v in (part.vertices / 1000.0).tolist()]
    sides = [f"3 {a} {b} {c}" for a, b, c in part.faces]
    off = [f"OFF\n{len(corners)} {len(sides)} 0", *corners, *sides]
    (tmp_path / "part.off").write_text("\n".join(off) + "\n")
    plan = '[[characteristic]]\nkind = "distance"\nname = "base"\nfaces = [0, 1]\ntolerance = 0.1\n'
    (tmp_path / "plan.toml").write_text(f'units = "mm"\n{plan}')
    common = ("inspect", tmp_path / "scan.ply", tmp_path / "part.off", "--plan", tmp_path / "plan.toml", "--start",
              "identity", "--source-units", "m", "--target-units", "m", "--json")  # fmt: skip
    assert run(*common) == 0
    found = json.loads(capsys.readouterr().out)
    (row,) = found["characteristics"]
    assert found["units"] == "mm"
    assert row["nominal"] == pytest.approx(10.0, rel=1e-5)
    # Noise of 0.01 mm on hundreds of points.
    assert row["value"] == pytest.approx(10.0, abs=0.01)
    assert run(*common, "--quiet", "--out", tmp_path / "r.json") == 0
    # A scan that names no unit is in that of the part's file.
    unnamed = tuple(word for k, word in enumerate(common) if "--source-units" not in common[max(k - 1, 0) : k + 1])
    capsys.readouterr()
    assert run(*unnamed) == 0
    assert json.loads(capsys.readouterr().out)["characteristics"][0]["value"] == pytest.approx(row["value"], rel=1e-9)
    # The result maps the scan to the part's file, which is in metres.
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["settings"]["target_units"] == "m"
    inner = np.array(result["T_target_source"])[:3, 3], np.array(found["T_target_source"])[:3, 3]
    np.testing.assert_allclose(inner[0], inner[1] / 1000.0, atol=1e-12)
    assert run("inspect", *common[1:3], "--tolerance", "1", "--display-units", "mm") == 2
    assert "names no length unit; name it with --target-units" in capsys.readouterr().err


@pytest.mark.parametrize("named", ["plan", "option", "plan and option"])
@pytest.mark.parametrize(("shown", "of_mm"), [("mm", 1.0), ("inch", 1.0 / 25.4)])
def test_the_lengths_of_a_plan_are_shown_in_the_unit_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], named: str, shown: str, of_mm: float
) -> None:
    """The plan's unit is that of a part whose file does not say, and the part's that of a plan that does not say."""
    rng = np.random.default_rng(0)
    part = Mesh(*bracket())
    write_cloud(tmp_path / "scan.ply", sample_mesh(part, 6_000, rng).points + rng.normal(scale=0.01, size=(6_000, 3)))
    corners = [" ".join(map(repr, v)) for v in part.vertices.tolist()]
    sides = [f"3 {a} {b} {c}" for a, b, c in part.faces]
    off = [f"OFF\n{len(corners)} {len(sides)} 0", *corners, *sides]
    (tmp_path / "part.off").write_text("\n".join(off) + "\n")
    row = '[[characteristic]]\nkind = "distance"\nfaces = [[60, 40, 0], [100, 40, 10]]\nnominal = 10\ntolerance = 0.1\n'
    (tmp_path / "plan.toml").write_text(f'units = "mm"\n{row}' if "plan" in named else row)
    assert run("inspect", tmp_path / "scan.ply", tmp_path / "part.off", "--plan", tmp_path / "plan.toml", "--start",
               "identity", "--json", "--display-units", shown,
               *(["--target-units", "mm"] * ("option" in named))) == 0  # fmt: skip
    found = json.loads(capsys.readouterr().out)
    (line,) = found["characteristics"]
    assert found["units"] == shown
    assert [line[name] / of_mm for name in ("nominal", "low", "high")] == pytest.approx([10.0, 9.9, 10.1], rel=1e-9)
    assert line["value"] / of_mm == pytest.approx(10.0, abs=0.01)


def test_without_a_pose_all_is_written_that_can_be_and_no_old_file_passes_for_new(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Starts ten sizes off, where a search may not help.
    case = load_case(demo_case())
    far = np.eye(4)
    far[:3, 3] = 1_000.0
    np.savetxt(tmp_path / "far.txt", far)
    common = ("inspect", case.scan, case.part, "--tolerance", "0.1", "--start", tmp_path / "far.txt", "--search",
              "never", "--source-units", "mm", "--target-units", "mm")  # fmt: skip
    goals = {name: tmp_path / f"old.{name}" for name in ("json", "html", "csv", "npy")}
    for goal in goals.values():
        goal.write_text("old")
    out = tmp_path / "new.json"
    assert run(*common, "--head", "serial=7", "--json", goals["json"], "--report", goals["html"], "--csv", goals["csv"],
               "--deviations", goals["npy"], "--out", out) == 1  # fmt: skip
    told = capsys.readouterr()
    found = json.loads(goals["json"].read_text())
    assert (found["verdict"]["level"], found["outcome"], found["alignment_trusted"]) == ("failed", "undecided", False)
    assert (found["decision"], found["head"]) == (None, {"serial": "7"})
    assert json.loads(out.read_text())["verdict"]["level"] == "failed"
    assert "no pose" in goals["html"].read_text(encoding="utf-8")
    for name in ("csv", "npy"):
        assert goals[name].read_text() == "old"
        words = f"not written: {goals[name]} (no pose was found; the file of that name is of an earlier run)"
        assert words in told.err
    assert str(goals["csv"]) not in told.out
    assert run(*common, "--csv", tmp_path / "none.csv", "--json") == 1
    told = capsys.readouterr()
    assert json.loads(told.out)["verdict"]["reasons"] == found["verdict"]["reasons"]
    assert f"not written: {tmp_path / 'none.csv'} (no pose was found)" in told.err


def test_regions_of_the_record_stand_where_the_part_does(tmp_path: Path) -> None:
    # The middle of the part lies far from the origin of its file: a centre about it would be another place.
    rng, away = np.random.default_rng(7), np.array([300.0, -200.0, 50.0])
    part = Mesh(*box((80.0, 50.0, 20.0)))
    cloud = sample_mesh(part, 6_000, rng)
    trimesh.Trimesh(part.vertices + away, part.faces).export(tmp_path / "part.stl")
    write_cloud(tmp_path / "scan.ply", cloud.points + rng.normal(0.0, 0.01, cloud.points.shape) + away)
    run("inspect", tmp_path / "scan.ply", tmp_path / "part.stl", "--tolerance", "0.2", "--start", "identity", "--quiet",
        "--source-units", "mm", "--target-units", "mm", "--json", tmp_path / "found.json")  # fmt: skip
    regions = json.loads((tmp_path / "found.json").read_text())["decision"]["regions"]
    middles = [
        away + side * half * axis for half, axis in zip((40, 25, 10), np.eye(3), strict=True) for side in (1, -1)
    ]
    assert len(regions) == 6
    for right in middles:
        assert min(np.linalg.norm(np.array(region["centre"]) - right) for region in regions) < 3.0


def test_a_part_out_of_tolerance_is_that_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # A plate 0.4 too thick, scanned on all sides where it stands, of which a best fit lays half on either side.
    rng = np.random.default_rng(4)
    nominal, made = Mesh(*plate(size=(80.0, 60.0, 6.0))), Mesh(*plate(size=(80.0, 60.0, 6.4)))
    trimesh.Trimesh(nominal.vertices, nominal.faces, process=False).export(tmp_path / "part.stl")
    write_cloud(tmp_path / "scan.ply", sample_mesh(made, 8_000, rng).points + 0.01 * rng.normal(size=(8_000, 3)))
    common = ("inspect", tmp_path / "scan.ply", tmp_path / "part.stl", "--start", "identity")
    # By its own tolerance, twice of which is expected; one that is small against what is off; and by word.
    assert run(*common, "--tolerance", "0.15") == 3
    assert run(*common, "--tolerance", "0.02") == 1
    assert "--expected-deviation" in capsys.readouterr().out
    assert run(*common, "--tolerance", "0.02", "--expected-deviation", "0.4") == 3
    (tmp_path / "plan.toml").write_text("tolerance = 0.02\nexpected_deviation = 0.4\n", encoding="utf-8")
    assert run(*common, "--plan", tmp_path / "plan.toml") == 3
    for wrong in ("-1", "0"):
        assert run(*common, "--tolerance", "0.1", "--expected-deviation", wrong) == 2
        assert "must be a length above 0" in capsys.readouterr().err
