from __future__ import annotations

import importlib.util
import runpy
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dqreg.compare import from_case
from dqreg.files import write_cloud
from dqreg.rigid import pose
from dqreg.synth import demo_case, load_case, worst_vertex_displacement
from dqreg.synth.parts import bracket

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
# Runs with a stub of ROS in tests/odometry/test_ros2_node.py.
ELSEWHERE = {"ros2_node"}
# Run by hand, for their minutes.
LONG = {"verdicts", "covariances", "cramer_rao", "real_pairs", "cloud_pairs"}
# Imported by "from_nothing".
BESIDE = {"peers", "random_views", "kept_runs"}


@pytest.fixture(autouse=True)
def beside_each_other(monkeypatch):
    # As for `python examples/one.py`, which finds what stands beside it.
    monkeypatch.syspath_prepend(str(EXAMPLES))


def main_of(name: str) -> Callable[..., Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]


def error_of(result: Any) -> float:
    # TruePoses: truth.json of the shipped case.
    case = load_case(demo_case())
    return worst_vertex_displacement(result.T_target_source, case.T_target_source, bracket()[0]) / case.part_diagonal


def test_every_example_is_run_here():
    tested = Path(__file__).read_text(encoding="utf-8")
    names = {path.stem for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")}
    assert {
        name for name in names - LONG - ELSEWHERE if f'"{name}"' not in tested and f'"{name}.ipynb"' not in tested
    } == set()


@pytest.mark.parametrize("name", ["quick_start", "open3d_objects"])
def test_shipped_case_is_brought_home(name, capsys):
    # 2e-5 of the part's diagonal is 3 um, six times the Cramer-Rao bound.
    assert error_of(main_of(name)()) < 2e-5
    assert "accepted" in capsys.readouterr().out


def test_real_pairs_become_cases(tmp_path):
    # A stand-in for the data: a street of two planes, and its pose as drawn here.
    folder, rng = tmp_path / "data" / "small_gicp_kitti_pair", np.random.default_rng(5)
    folder.mkdir(parents=True)
    points = rng.uniform(-1.0, 1.0, size=(600, 3)) * [[4.0, 2.0, 1.0]]
    points[::2, 2], points[1::2, 1] = 0.0, 2.0
    T = pose.exp([0.1, 0.0, 0.3, 1.0, 2.0, 0.5])
    write_cloud(folder / "target.ply", points)
    write_cloud(folder / "source.ply", pose.apply(pose.inverse(T), points))
    np.savetxt(folder / "T_target_source.txt", T)
    (written,) = main_of("real_cases")([str(tmp_path / "data"), str(tmp_path / "cases")])
    case = load_case(written)
    np.testing.assert_allclose(case.T_target_source, T, rtol=0.0, atol=1e-12)
    assert pose.angle_between(case.T_start, T) == pytest.approx(np.deg2rad(5.0), abs=1e-9)
    challenge = from_case(case)
    # Files hold float32: 4 m to 2.4e-7.
    np.testing.assert_allclose(challenge.task.target.points, points, rtol=0.0, atol=1e-6)


@pytest.mark.usefixtures("small_pictures")
def test_from_nothing_with_a_report(tmp_path, capsys):
    result = main_of("from_nothing_report")([], tmp_path)
    text = capsys.readouterr().out
    assert error_of(result) < 2e-5
    assert "proposed: " in text
    assert "% of the points lie within 0.15" in text
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!")
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_a_loop_follows_the_part(capsys):
    # TruePoses by construction of the frames. 2e-4 S is 0.03 mm: a frame has 9,000 points with 0.05 mm of noise.
    errors = main_of("perception_loop")(3)
    size = float(np.linalg.norm(np.ptp(bracket()[0], axis=0)))
    assert max(errors) < 2e-4 * size
    assert capsys.readouterr().out.count("accepted") == 3


@pytest.mark.soak
def test_each_failure_has_its_verdict(capsys):
    answers = main_of("gallery_of_failures")()
    page = (ROOT / "docs" / "failures.md").read_text(encoding="utf-8")
    for name, (level, codes) in answers.items():
        counts = Counter(codes)
        said = ", ".join(f"`{code}`" + (f" ({n} times)" if n > 1 else "") for code, n in counts.items()) or "none"
        shown = level if codes else f"`{level}`"
        assert f"| {name} | {shown} | {said}" in page
    text = capsys.readouterr().out
    for words in (
        "unconstrained: rotation",
        "unconstrained: translation",
        "faces that continue beyond the target",
        "inch",
        "looks the same after a",
    ):
        assert words in text
    # Three motions of a plane are free, and two of the sides of a shaft: about and along its axis.
    plane, shaft = (text.split(f"{name}: ")[1].split("what to do")[0] for name in ("plane only", "round part"))
    assert (plane.count("unconstrained: "), shaft.count("unconstrained: ")) == (3, 2)


def test_own_weight_counts_what_it_says(capsys):
    run = main_of("own_weight")()
    # The samples lie on the part itself, so the truth is the identity; the tolerance is that of the loop's stop.
    assert pose.angle_between(run.T_target_source, np.eye(4)) < 1e-6
    kept = run.weights > 0.0
    assert (run.pairs.closest.points[kept, 2] > 2.0).all()
    assert 0 < np.count_nonzero(kept) < len(kept)
    assert "converged" in capsys.readouterr().out


def test_own_engine_runs_beside_ours(capsys):
    main_of("own_engine")()
    text = capsys.readouterr().out
    assert "my trimmed ICP" in text
    assert "crashed" not in text
    assert "1/1" in text


def test_race_ranks_exact_mesh_before_sampled_cad(capsys):
    # Known truth by construction of the virtual scans; both run on the same scan of about 20,000 points.
    errors = main_of("against_builtin_icp")([], pixels=150, seeds=1, samples=50_000)
    assert errors["dqreg"][0] < 5e-5
    assert errors["dqreg"][0] < errors["Open3D point-to-point"][0]
    assert "worst vertex" in capsys.readouterr().out


@pytest.mark.soak
def test_poses_from_nothing_are_found_and_kept(tmp_path, capsys):
    kept = tmp_path / "runs.jsonl"
    race = main_of("from_nothing")
    asked = ["--seeds", "1", "--pixels", "100", "--keep", str(kept)]
    runs = race(asked)
    assert [run.right for run in runs] == [True, True, True]
    assert "accepted though wrong" in capsys.readouterr().out
    # A race that is killed leaves half a line; the next one runs what is missing and nothing else.
    lines = kept.read_text(encoding="utf-8").splitlines(keepends=True)
    kept.write_text("".join(lines[:-1]) + lines[-1][:20], encoding="utf-8")
    assert [run.right for run in race([*asked, "--markdown", "--apart", "plate"])] == [True, True, True]
    again = kept.read_text(encoding="utf-8").splitlines(keepends=True)
    assert again[:2] == lines[:2]
    assert len(again) == 4
    text = capsys.readouterr().out
    assert text.count("seed 0") == 1
    assert "| two | all | dqreg | 3 of 3 (100.0 %) | 0 |" in text
    assert "| two | plate | dqreg | 1 of 1 (100.0 %) | 0 |" in text


@pytest.mark.skipif(importlib.util.find_spec("nbclient") is None, reason="needs nbclient and ipykernel: dqreg[test]")
def test_the_notebook_runs(recwarn):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(EXAMPLES / "tour.ipynb", as_version=4)
    # No cell may come with the output of somebody's last run: what is shown is what this version does.
    assert not any(cell.get("outputs") for cell in notebook.cells)
    NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(EXAMPLES)}}
    ).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    text = "".join(output.get("text", "") for output in outputs)
    assert "accepted" in text
    assert text.count("unconstrained: ") == 3
    assert any("ACCEPTED" in output.get("data", {}).get("text/html", "") for output in outputs)


def test_size_measures_time_memory_and_truth(tmp_path):
    names = runpy.run_path(str(EXAMPLES / "size") + ".py")
    names["make_case"](tmp_path, 3_000, 2_000)
    row = {"points": 3_000, **names["measure"](tmp_path, "fast", False)}
    assert (row["verdict"], row["deviations"]) == ("accepted", 3_000)
    # Noise of 1e-4 S on 3,000 points; the relief makes every face another plane.
    assert row["worst_vertex_1e6_s"] < 100.0
    assert row["deviation_rms_1e6_s"] == pytest.approx(100.0, rel=0.1)
    assert row["all_bytes"] >= row["register_bytes"] >= row["idle_bytes"] > 2**20
    assert names["row_words"](row).count("|") == names["HEAD"].splitlines()[0].count("|")
    names["draw"]([row], tmp_path / "size.png")
    assert (tmp_path / "size.png").read_bytes().startswith(b"\x89PNG")


def test_a_scanner_on_a_robot_is_calibrated(tmp_path, capsys):
    fit, T_hand_eye = main_of("hand_eye")(tmp_path)
    # Three true standard deviations of each of three components are left in 0.8 % of all draws; this is one draw.
    sigma = np.sqrt(fit.covariance.diagonal()[9:])
    assert (np.abs(fit.Y[:3, 3] - T_hand_eye[:3, 3]) < 4.0 * sigma).all()
    assert sigma.max() < 0.01
    assert (tmp_path / "stations.json").is_file()
    assert "stations; scanner on the hand" in capsys.readouterr().out


def test_turntables_are_held_against_the_truth(capsys):
    # Poses that are 2e-3 off; 40 pixels are a sixth of what is usual.
    (run,) = main_of("turntables")(["--views", "6", "--pixels", "40", "--start", "joint", "--seed", "203"])
    assert (run.placed, run.views, run.squared.shape) == (6, 6, (6,))
    assert run.median <= run.worst < 0.02
    assert "6 of 6 placed, 6 right" in capsys.readouterr().out


def test_views_that_begin_near_come_together(tmp_path, capsys):
    vertices, faces = bracket()
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "part.stl")
    found = main_of("cloud_basins")([str(tmp_path / "part.stl"), "--pairs", "3", "--degrees", "0.5", "1.5"])
    # Both views are made in one frame: the truth is the identity, exactly. A fifth of what the table calls right.
    assert {errors.shape for errors in found.values()} == {(3,)}
    assert (found["dqreg, normal"] < 2e-3).all()
    assert "right of 3" in capsys.readouterr().out
