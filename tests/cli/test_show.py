from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dqreg.cli.main import main
from dqreg.files import read_cloud, write_cloud
from dqreg.registration.result.result import Registration
from tests.cli.command import run
from tests.registration.result.test_result import good


@pytest.fixture(autouse=True, scope="module")
def small_pictures():
    # The picture for print has its own tests.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dqreg.report.page.PANEL_WIDTH", 200)
        patch.setattr("dqreg.report.page.PANEL_HEIGHT", 150)
        yield


@pytest.fixture(scope="module")
def saved(tmp_path_factory, case, small_pictures) -> Path:
    """What `dqreg register --out` writes for the shipped scan, with few points."""
    folder = tmp_path_factory.mktemp("show")
    np.savetxt(folder / "start.txt", case.T_start)
    options = ("--start", folder / "start.txt", "--effort", "fast", "--target-units", "mm", "--quiet")
    made = ("--out", folder / "result.json", "--report", folder / "report.html", "--tolerance", "0.15")
    assert run("register", case.scan, case.part, *options, *made) == 0
    return folder / "result.json"


def test_register_writes_a_report(saved):
    text = (saved.parent / "report.html").read_text(encoding="utf-8")
    assert "✓ Alignment: trusted" in text
    assert "Before, at the initial pose" in text
    assert "✓ Part against ±0.15 mm: pass" in text


def test_picture_without_a_display(saved, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert run("show", saved, "--save", tmp_path / "view.png") == 0
    assert f"wrote {tmp_path / 'view.png'}" in capsys.readouterr().out.replace("\n", "")
    with Image.open(tmp_path / "view.png") as image:
        picture = np.asarray(image)[..., :3]
    # Each colour as one number: rows take seconds to sort.
    assert len(np.unique(picture @ [1, 256, 256**2])) > 100
    # Part and scan cover a good share of the paper.
    assert (picture < 250).any(axis=2).mean() > 0.15


def test_a_result_is_shown_in_another_unit(saved, tmp_path, capsys):
    found = {}
    for unit, tolerance in (("mm", "0.15"), ("m", "0.00015")):
        page = tmp_path / f"{unit}.html"
        assert run("show", saved, "--display-units", unit, "--tolerance", tolerance, "--report", page, "--json") == 0
        found[unit] = json.loads(capsys.readouterr().out)
    assert "lengths in m<" in page.read_text(encoding="utf-8")
    mm, m = (found[unit] for unit in ("mm", "m"))
    assert (mm["units"], m["units"], m["deviations"]["units"]) == ("mm", "m", "m")
    # The same points of the same scan, in metres, but for one of 60,000 that rounding makes an outlier.
    counts = [each["deviations"]["counts"] for each in (mm, m)]
    assert counts[0]["total"] == counts[1]["total"]
    assert abs(counts[0]["on_part"] - counts[1]["on_part"]) <= 2
    for name in ("p95", "max", "rms"):
        assert m["deviations"]["summary"][name] == pytest.approx(mm["deviations"]["summary"][name] / 1000.0, rel=1e-3)
    assert m["deviations"]["bands"]["within"] == pytest.approx(mm["deviations"]["bands"]["within"], abs=1e-4)
    places = [np.array(each["T_target_source"])[:3, 3] for each in (mm, m)]
    np.testing.assert_allclose(places[1], places[0] / 1000.0, rtol=1e-12)


def test_a_result_without_a_unit_is_shown_in_none(saved, tmp_path, capsys):
    record = json.loads(saved.read_text())
    record["settings"]["target_units"] = None
    (tmp_path / "r.json").write_text(json.dumps(record))
    assert run("show", tmp_path / "r.json", "--display-units", "m", "--json") == 2
    assert "the result names no length unit" in capsys.readouterr().err


def test_report_of_a_saved_result(saved, tmp_path):
    assert run("show", saved, "--report", tmp_path / "again.html", "--quiet") == 0
    assert Registration.load(saved).verdict.reasons[0] in (tmp_path / "again.html").read_text(encoding="utf-8")


def test_a_scan_that_has_changed_since_is_said(saved, case, tmp_path, capsys):
    assert run("show", saved, "--json") == 0
    told = capsys.readouterr()
    assert (told.err, json.loads(told.out)["changed"]) == ("", None)
    # The same bytes under another name are the same scan.
    (tmp_path / "copy.ply").write_bytes(case.scan.read_bytes())
    assert run("show", saved, "--source", tmp_path / "copy.ply", "--json") == 0
    assert capsys.readouterr().err == ""
    write_cloud(tmp_path / "copy.ply", read_cloud(case.scan).points + 0.5)
    options = ("--json", "--quiet", "--report", tmp_path / "r.html")
    assert run("show", saved, "--source", tmp_path / "copy.ply", *options) == 0
    told = capsys.readouterr()
    said = "copy.ply has changed since it was registered: verdict and pose are of what was there then"
    assert told.err.startswith(f"dqreg: {said}")
    assert told.err.count("\n") == 1
    assert json.loads(told.out)["changed"].startswith(said)
    assert said in (tmp_path / "r.html").read_text(encoding="utf-8")
    # A result of old holds no digests.
    record = json.loads(saved.read_text())
    assert sorted(record["settings"].pop("sha256")) == ["source", "target"]
    (tmp_path / "old.json").write_text(json.dumps(record))
    assert run("show", tmp_path / "old.json", "--source", tmp_path / "copy.ply", "--json") == 0
    assert capsys.readouterr().err == ""


def test_no_display_is_said_with_what_to_do(saved, monkeypatch, capsys):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert run("show", saved) == 2
    assert "--save view.png" in capsys.readouterr().err


def test_a_missing_file_is_said_before_a_missing_display(monkeypatch, capsys):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert run("show", "nope.json") == 2
    assert "nope.json" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--save", "nowhere/view.png"), "the folder nowhere does not exist"),
        (("--save", "view.gif"), "a picture is .png, .jpg or .jpeg"),
        (("--save", "view.png", "--views", "sideways"), "unknown view 'sideways'"),
        (("--report", "nowhere/r.html"), "the folder nowhere does not exist"),
        (("--save", "view.png", "--tolerance", "-1"), "tolerance must be a length"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_file(saved, tmp_path, monkeypatch, capsys, options, said):
    monkeypatch.chdir(tmp_path)
    assert run("show", saved, *options) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_register_refuses_an_unwritable_report_before_the_work(case, tmp_path, capsys):
    assert run("register", case.scan, case.part, "--report", tmp_path / "no" / "r.html") == 2
    told = capsys.readouterr()
    assert "does not exist" in told.err
    assert told.out == ""


def test_a_missing_side_names_its_option(saved, tmp_path, capsys):
    text = saved.read_text(encoding="utf-8").replace("scan.ply", "gone.ply")
    (tmp_path / "moved.json").write_text(text, encoding="utf-8")
    assert run("show", tmp_path / "moved.json", "--save", tmp_path / "view.png") == 2
    assert "--source FILE" in capsys.readouterr().err


def test_a_result_without_its_settings_is_one_line(tmp_path, capsys):
    good().save(tmp_path / "result.json")
    values = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**values, "settings": {}}))
    with pytest.raises(SystemExit) as ended:
        main(["show", str(tmp_path / "result.json"), "--report", str(tmp_path / "a.html")])
    assert ended.value.code == 2
    assert "does not say its max_distance" in capsys.readouterr().err


def test_serve_says_where_and_waits(saved, monkeypatch, capsys):
    pytest.importorskip("viser")
    from dqreg.report import live_server

    servers = []
    monkeypatch.setattr(live_server, "wait", servers.append)
    assert run("show", saved, "--serve", "--port", 18_260) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"http://127.0.0.1:{servers[0].get_port()}" in said
    assert servers[0].get_host() == "127.0.0.1"
    servers[0].stop()
