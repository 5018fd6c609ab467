from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from dqreg import register
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.report import print_summary, summary_rows
from dqreg.synth.parts import box


def shown(result) -> str:
    text = io.StringIO()
    print_summary(Console(file=text, width=60), result)
    return text.getvalue()


def test_same_numbers_as_the_result():
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    result = register(cloud, cloud + 0.01, "identity")
    text = shown(result)
    assert result.verdict.level.upper() in text
    assert f"{result.rms:.4g}" in text
    # The pose is printed with all the digits that a start file needs.
    printed = np.array([[float(x) for x in line.split()] for line in text.splitlines()[-4:]])
    np.testing.assert_allclose(printed, result.T_target_source, rtol=1e-11, atol=1e-12)


def test_a_failure_has_reasons_and_no_pose():
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    result = register(cloud, cloud + 1e3, "identity")
    text = shown(result)
    assert "FAILED" in text
    assert "T_target_source" not in text
    assert "inliers" not in dict(summary_rows(result))


def test_conversion_is_said():
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    rows = dict(summary_rows(register(cloud / 1e3, cloud, "identity", source_units="m", target_units="mm")))
    assert rows["units"] == "source converted from m: x 1000"


def test_a_viewpoint_that_the_scan_brings_along_is_said():
    points = np.random.default_rng(0).normal(size=(500, 3))
    scan = PointCloud(points, viewpoint=[0.0, -9.0, 0.25])
    told = register(scan, points + 0.01, "identity", scale=2.0, search="never")
    np.testing.assert_allclose(told.settings["source_viewpoint"], [0.0, -9.0, 0.25], atol=1e-12)
    assert dict(summary_rows(told))["viewpoint"] == "(0, -9, 0.25), as the scan itself says"
    given = register(scan, points + 0.01, "identity", viewpoint=[0.0, -9.0, 0.25], search="never")
    assert "source_viewpoint" not in given.settings
    assert "as the scan" not in dict(summary_rows(given)).get("viewpoint", "")


@pytest.mark.parametrize(("units", "unit"), [("mm", " mm"), (None, " in the unit of the target")])
def test_the_weakest_motion_says_what_it_displaces_in_which_unit(units, unit):
    part = Mesh(*box((1.0, 0.7, 0.4)))
    points = sample_mesh(part, 3_000, np.random.default_rng(0)).points
    for target, noun in ((part, "part"), (points, "scan")):
        result = register(points, target, np.eye(4), source_units=units, target_units=units, search="never")
        length = f"{result.observability[0].sigma:.2g}{unit}"
        assert f"(one sigma displaces the {noun} by up to {length})" in dict(summary_rows(result))["weakest"]


def test_the_share_of_inliers_is_of_the_points_used():
    # Half of the points lie far off the box.
    rng = np.random.default_rng(0)
    part = Mesh(*box((1.0, 0.7, 0.4)))
    points = np.vstack([sample_mesh(part, 3_000, rng).points, rng.uniform(2.0, 3.0, (3_000, 3))])
    result = register(points, part, np.eye(4), units="ignore")
    used, share = result.settings["used_points"], result.inlier_fraction
    assert dict(summary_rows(result))["inliers"].startswith(
        f"{100 * share:.1f} % of the points used, those far off the "
    )
    assert round(share * used) == pytest.approx(len(points) / 2, rel=0.1)
