from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from dqreg.cli import attempts, registration_options
from dqreg.cli import register as room
from dqreg.files import READERS, read_cloud, read_geometry, write_cloud
from dqreg.files.poses import read_start
from dqreg.geometry import Mesh, sample_mesh
from dqreg.icp import ESTIMATORS
from dqreg.inspection import measure_deviations
from dqreg.registration.options.options import EFFORTS, WORDS, Method
from dqreg.registration.result import scan_deviations as deviations_room
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from tests.cli.command import run


def test_words_are_those_of_the_library():
    assert ("auto", *ESTIMATORS) == registration_options.METHODS
    assert get_args(Method) == registration_options.METHODS
    assert tuple(EFFORTS) == WORDS["effort"] == registration_options.EFFORTS
    assert WORDS["search"] == registration_options.SEARCHES


def test_json_is_all_that_standard_output_holds(tmp_path, case, start, capsys):
    out = tmp_path / "result.json"
    code = run("register", case.scan, case.part, "--start", start, "--effort", "fast", "--json", "--out", out)
    captured = capsys.readouterr()
    assert code == 0
    assert captured.err == ""
    values = json.loads(captured.out)
    assert values["verdict"]["level"] == "accepted"
    # The same numbers as in the file, to the last bit.
    assert values == json.loads(out.read_text())
    assert np.array_equal(values["T_target_source"], Registration.load(out).T_target_source)


def test_a_scale_that_was_solved_for_stands_beside_the_outcome(tmp_path, case, start, capsys):
    # A part that is 1 % too large.
    write_cloud(tmp_path / "large.ply", 1.01 * read_cloud(case.scan).points)
    files, page = (tmp_path / "large.ply", case.part), tmp_path / "page.html"
    common = ("--start", start, "--effort", "fast", "--tolerance", "0.15", "--units", "ignore")
    assert run("register", *files, *common, "--scale", "solve", "--report", page) == 3
    said = "part against ±0.15, in shape alone (the scan was scaled by 0.99"
    words = "so the size of the part was not measured (solved_scale)"
    out = capsys.readouterr().out
    assert f"UNDECIDED: {said}" in out
    assert words in out.replace("\n", " ")
    assert "P" + said[1:] in page.read_text(encoding="utf-8")
    assert words in page.read_text(encoding="utf-8")
    # A given scale is no doubt of its size.
    assert run("register", *files, *common, "--scale", str(1.0 / 1.01)) == 0


def test_a_file_that_is_overwritten_after_it_was_read_is_told_as_it_was(tmp_path, case, start, monkeypatch):
    scan, out, page = tmp_path / "copy.ply", tmp_path / "result.json", tmp_path / "page.html"
    scan.write_bytes(case.scan.read_bytes())
    read, others = (hashlib.sha256(content).hexdigest() for content in (scan.read_bytes(), b"the next part"))

    def registered(*args, **options):
        result = attempts.register_files(*args, **options)
        scan.write_bytes(b"the next part")
        return result

    monkeypatch.setattr("dqreg.cli.register.register_files", registered)
    run("register", scan, case.part, "--start", start, "--effort", "fast", "--out", out, "--report", page)
    assert json.loads(out.read_text())["settings"]["sha256"]["source"] == read
    assert read in page.read_text(encoding="utf-8")
    assert others not in page.read_text(encoding="utf-8")


def test_locked_motions_stay_as_in_the_start(tmp_path, case, start, capsys):
    files = case.scan, case.part
    assert run("register", *files, "--start", start, "--effort", "fast", "--json", "--dof", "rz tx ty") in (0, 1)
    T = np.array(json.loads(capsys.readouterr().out)["T_target_source"])
    moved = T @ np.linalg.inv(case.T_start)
    # A turn about z and a shift in the plane: the third row and column are those of the identity.
    np.testing.assert_allclose(moved[2], [0.0, 0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(moved[:3, 2], [0.0, 0.0, 1.0], atol=1e-9)
    assert run("register", case.scan, case.part, "--dof", "rz") == 2
    assert "dof" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--viewpoint", "none"], ["--viewpoint=none"]])
def test_no_viewpoint_is_used_where_none_is_asked_for(tmp_path, words, capsys):
    points = np.random.default_rng(0).normal(size=(300, 3))
    scan, target = tmp_path / "scan.pcd", tmp_path / "target.ply"
    head = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 300\nHEIGHT 1\nVIEWPOINT 0 0 9 1 0 0 0\nPOINTS 300"
    scan.write_text(f"VERSION .7\n{head}\nDATA ascii\n" + "\n".join(" ".join(map(str, row)) for row in points))
    write_cloud(target, points)
    given = "register", scan, target, "--start", "identity", "--search", "never", "--json"
    found = []
    for more in ([], words):
        run(*given, *more)
        found.append(json.loads(capsys.readouterr().out)["settings"])
    assert found[0]["source_viewpoint"] == [0.0, 0.0, 9.0]
    assert "source_viewpoint" not in found[1]
    assert run(*given, *words, "--viewpoint", "0", "0", "9") == 2
    assert "stands alone" in capsys.readouterr().err
    assert run(*given, "--viewpoint", "0", "here", "9") == 2
    assert "'0 here 9' is neither three numbers X Y Z" in capsys.readouterr().err


def test_a_pose_that_is_locked_is_judged_where_it_is(tmp_path, case, capsys):
    start, out = tmp_path / "right.txt", tmp_path / "result.json"
    np.savetxt(start, case.T_target_source)
    words = ("register", case.scan, case.part, "--start", start, "--effort", "fast", "--dof", "none", "--out", out)
    assert run(*words) == 0
    assert "weakest  none: all degrees of freedom are locked" in capsys.readouterr().out
    found = Registration.load(out)
    np.testing.assert_allclose(found.T_target_source, case.T_target_source, atol=1e-9)
    assert (found.verdict.level, found.observability) == ("accepted", ())


def test_an_error_of_ours_has_its_trace_and_its_exit_code_and_the_result_stays(
    tmp_path, case, start, capsys, monkeypatch
):
    def broken(*_: object) -> None:
        raise IndexError("tuple index out of range")

    out = tmp_path / "result.json"
    monkeypatch.setattr("dqreg.report.print_summary", broken)
    assert run("register", case.scan, case.part, "--start", start, "--effort", "fast", "--out", out) == 4
    told = capsys.readouterr().err
    assert "Traceback" in told
    assert told.splitlines()[-1].startswith("dqreg: error: unexpected IndexError, ")
    assert Registration.load(out).verdict.level == "accepted"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_result_that_cannot_be_written_is_shown(case, start, capsys):
    assert run("register", case.scan, case.part, "--start", start, "--effort", "fast", "--out", "/dev/full") == 2
    assert "ACCEPTED" in capsys.readouterr().out


def test_a_time_limit_is_said(case, start, capsys):
    code = run("register", case.scan, case.part, "--start", start, "--time-limit", "1e-6")
    assert code == 1
    assert "time limit" in capsys.readouterr().out


def test_units_are_checked_unless_told_not_to(tmp_path, case, capsys):
    points = np.random.default_rng(0).normal(size=(3_000, 3))
    np.save(tmp_path / "inch.npy", points / 25.4)
    np.save(tmp_path / "mm.npy", points)
    files = tmp_path / "inch.npy", tmp_path / "mm.npy"
    assert run("register", *files, "--start", "identity") == 2
    assert "--units ignore" in capsys.readouterr().err
    assert run("register", *files, "--start", "identity", "--units", "ignore", "--quiet") in (0, 1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--method", "plan"], "did you mean plane?"),
        (["--effort", "norml"], "did you mean normal?"),
        (["--tolerence", "1"], "--tolerance"),
        (["--units", "chek"], "did you mean check?"),
        (["--source-units", "inches"], "did you mean inch?"),
    ],
)
def test_what_was_probably_meant(arguments, said, capsys):
    assert run("register", "a.ply", "b.ply", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert said in captured.err
    assert captured.err.count("\n") == 1


def test_every_option_stands_under_a_heading():
    options = {option.name for option in room.register_command.params if option.param_type_name == "option"}
    headed = {name for names in room.SECTIONS.values() for name in names}
    assert options - headed == {"quiet"}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT to send to one process")
@pytest.mark.parametrize("after", [0.3, pytest.param(1.2, marks=pytest.mark.soak)])
def test_ctrl_c_leaves_one_line_and_no_file(after, tmp_path, case):
    out = tmp_path / "result.json"
    words = [str(w) for w in ("register", case.scan, case.part, "--effort", "best", "--quiet", "--out", out)]
    # Pictures need Open3D, which is loaded first.
    words += ["--report", str(tmp_path / "report.html")]
    # A shell that runs its jobs in the background has SIGINT ignored, which is handed on, and respected.
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{listen}; from dqreg.cli.main import main; print('begun', flush=True); main({words!r})"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env=environment)  # fmt: skip
    assert process.stdout is not None
    process.stdout.readline()
    # While Open3D and other compiled parts load: there the interrupt used to be lost.
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert error.strip() == "dqreg: error: stopped by the user; no file is left half-written"
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def counted(monkeypatch):
    """How often files of each name were read, and deviations measured."""
    counts = Counter()

    def watched(name, function):
        def call(*arguments, **options):
            counts[name or Path(arguments[0]).name] += 1
            return function(*arguments, **options)

        return call

    for extension, reader in list(READERS.items()):
        monkeypatch.setitem(READERS, extension, watched(None, reader))
    monkeypatch.setattr(deviations_room, "measure_deviations", watched("deviations", measure_deviations))
    return counts


def test_everything_that_is_written_is_read_and_measured_once(tmp_path, case, start, capsys, counted):
    files = {name: tmp_path / name for name in ("aligned.ply", "deviations.csv", "report.html", "result.json")}
    options = ("--start", start, "--effort", "fast", "--tolerance", "0.5", "--out", files["result.json"])
    written = ("--aligned", files["aligned.ply"], "--deviations", files["deviations.csv"], "--report",
               files["report.html"])  # fmt: skip
    assert run("register", case.scan, case.part, *options, *written) == 0
    assert counted == {case.scan.name: 1, case.part.name: 1, "deviations": 1}
    assert all(path.is_file() for path in files.values())
    counted.clear()
    assert run("show", files["result.json"], "--report", files["report.html"], "--json") == 0
    assert counted == {case.scan.name: 1, case.part.name: 1, "deviations": 1}


def test_a_part_with_a_bump_ends_with_exit_code_three(tmp_path, case, start, capsys):
    # A patch of the plate's upper face is raised by 0.6 mm, three times the tolerance; the pose, known because the scan
    # is a virtual one, stays trusted.
    points, place = pose.apply(case.T_target_source, read_cloud(case.scan).points), np.array([100.0, 20.0, 10.0])
    points[np.linalg.norm(points - place, axis=1) < 5.0, 2] += 0.6
    write_cloud(tmp_path / "bump.ply", pose.apply(pose.inverse(case.T_target_source), points))
    options = ("--start", start, "--source-units", "mm", "--target-units", "mm", "--tolerance", "0.2")
    assert run("register", tmp_path / "bump.ply", case.part, *options) == 3
    text = capsys.readouterr().out
    assert "ACCEPTED: alignment trusted" in text
    assert "FAIL: part against ±0.2 mm" in text
    assert "out of tolerance; at the worst the median of 25 neighbouring points deviates by" in text
    # A box about the bump takes it out of the decision.
    box = [*(place - 6.0), *(place + 6.0)]
    assert run("register", tmp_path / "bump.ply", case.part, *options, "--exclude", *box) == 0


def test_a_pass_on_an_alignment_that_is_not_trusted_does_not_look_like_one(tmp_path, case, start, capsys):
    # Points amid one flat face leave three motions open: the alignment is not trusted, and all lie on the part.
    points = pose.apply(case.T_target_source, read_cloud(case.scan).points)
    top = points[(np.abs(points - (60.0, 40.0, 10.0)) < (15.0, 15.0, 0.2)).all(axis=1)]
    write_cloud(tmp_path / "top.ply", pose.apply(pose.inverse(case.T_target_source), top))
    known = tmp_path / "known.txt"
    np.savetxt(known, case.T_target_source)
    options = ("--start", known, "--search", "never", "--source-units", "mm", "--target-units", "mm")
    options += ("--tolerance", "0.5", "--report", tmp_path / "page.html")
    assert run("register", tmp_path / "top.ply", case.part, *options) == 1
    assert "PASS, IF THE ALIGNMENT HOLDS: part against ±0.5 mm" in capsys.readouterr().out
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert ": pass, if the alignment holds</strong>" in page
    assert '<section class="verdict pass"' not in page
    assert run("register", tmp_path / "top.ply", case.part, *options[:-2], "--json") == 1
    decision = json.loads(capsys.readouterr().out)["deviations"]["decision"]
    assert (decision["outcome"], decision["alignment_trusted"]) == ("pass", False)
    assert run("inspect", tmp_path / "top.ply", case.part, *options[:-2], "--json") == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["outcome"], found["alignment_trusted"]) == ("pass", False)


@pytest.mark.parametrize("kind", ["cloud", "cloud in inches", "mesh"])
def test_the_aligned_scan_is_the_file_under_the_pose(tmp_path, case, start, kind):
    scan, options = case.scan, ["--source-units", "mm", "--target-units", "mm"]
    if kind == "mesh":
        scan, start = case.part, "identity"
    if kind == "cloud in inches":
        given = read_cloud(case.scan)
        normals = np.tile([0.6, 0.0, 0.8], (len(given.points), 1))
        scan, options = tmp_path / "inches.ply", ["--source-units", "inch", "--target-units", "mm"]
        write_cloud(scan, given.points / 25.4, normals)
    out, aligned = tmp_path / "result.json", tmp_path / "aligned.ply"
    run("register", scan, case.part, "--start", start, "--effort", "fast", *options, "--out", out, "--aligned", aligned)
    result, data, found = Registration.load(out), read_geometry(scan), read_cloud(aligned)
    expected = result.apply(data.vertices if kind == "mesh" else data.points)
    # The file holds float32 or float64; either way the sum of a few roundings of the largest coordinate.
    np.testing.assert_allclose(found.points, expected, rtol=0.0, atol=4.0 * np.spacing(np.float32(abs(expected).max())))
    assert (found.normals is None) == (kind != "cloud in inches")
    if found.normals is not None:
        np.testing.assert_allclose(found.normals, normals @ result.T_target_source[:3, :3].T, atol=1e-6)


def test_a_text_file_gets_the_matrix_alone_with_all_digits(case, start, tmp_path, capsys):
    out, record = tmp_path / "pose.txt", tmp_path / "result.json"
    options = ("--start", start, "--effort", "fast", "--quiet")
    assert run("register", case.scan, case.part, *options, "--out", out) == 0
    assert run("register", case.scan, case.part, *options, "--out", record) == 0
    np.testing.assert_array_equal(np.loadtxt(out), Registration.load(record).T_target_source)
    np.testing.assert_array_equal(read_start(out), np.loadtxt(out))
    # What needs more than a pose says so.
    assert run("show", out, "--json") == 2
    assert "register --out result.json" in capsys.readouterr().err


def test_an_ending_that_promises_another_kind_of_result_is_refused(case, tmp_path, capsys):
    assert run("register", case.scan, case.part, "--out", tmp_path / "pose.csv") == 2
    assert "T_target_source alone; give a name that ends in .json or .txt" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_two_las_scans_with_times_are_registered(tmp_path, capsys):
    laspy = pytest.importorskip("laspy", reason="pip install 'dqreg[scans]'")
    part = Mesh(*bracket())
    for number in range(2):
        header = laspy.LasHeader(point_format=1, version="1.2")
        header.scales = [1e-4 * part.diagonal] * 3
        made = laspy.LasData(header)
        # More than three times the cells of this effort.
        made.xyz = sample_mesh(part, 20_000, np.random.default_rng(number)).points
        made.gps_time = np.linspace(0.0, 1.0, len(made.points))
        made.write(tmp_path / f"{number}.las")
    scans = [tmp_path / "0.las", tmp_path / "1.las"]
    code = run("register", *scans, "--start", "identity", "--effort", "fast", "--quiet")
    assert (code, capsys.readouterr().err) == (0, "")
