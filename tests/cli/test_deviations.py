from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.files import read_cloud
from tests.cli.command import run


def test_the_coloured_cloud_and_its_figures(tmp_path: Path, case, capsys) -> None:
    np.savetxt(tmp_path / "start.txt", case.T_start)
    file = tmp_path / "dev.ply"
    common = ["register", case.scan, case.part, "--start", tmp_path / "start.txt", "--effort", "fast"]
    units = ["--source-units", "mm", "--target-units", "mm"]
    assert run(*common, *units, "--deviations", file, "--tolerance", "0.5") == 0
    text = capsys.readouterr().out
    for words in (" mm, p95 ", "±0.5 mm: ", "% within", "worst  ", "points around it", f"wrote {file}"):
        assert words in text
    cloud = load_open3d().t.io.read_point_cloud(str(file))
    values = cloud.point["deviation"].numpy().ravel()
    assert len(values) == len(read_cloud(case.scan).points)
    # The scan has noise of the recipe only: every point of the part lies within half a millimetre of it.
    share = float(text.split("±0.5 mm: ")[1].split(" %")[0]) / 100
    counted = np.abs(values[cloud.point["flag"].numpy().ravel() == 0])
    assert share == pytest.approx((counted <= 0.5).mean(), abs=1e-4)
    assert read_cloud(file).units == "mm"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--deviations", "no/folder/dev.ply"], "folder"),
        (["--deviations", "dev.stl"], ".ply, .csv, .npy"),
        (["--tolerance", "-1"], "--tolerance must be a length above 0"),
        (["--tolerance", "nan"], "--tolerance must be a length above 0"),
        (["--reach", "0"], "--reach must be a length above 0"),
    ],
)
def test_it_is_refused_before_the_work_starts(arguments, said, tmp_path: Path, case, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)

    def never(*_: object, **__: object) -> None:
        raise AssertionError("the work has started")

    monkeypatch.setattr(importlib.import_module("dqreg.registration.register"), "register", never)
    assert run("register", case.scan, case.part, *arguments) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
