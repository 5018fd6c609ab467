"""Results in another unit of the target, and back: numbers change by the factor, rotations and shares do not."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError, UnitsError
from dqreg.files import read_cloud, write_cloud
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.opening import as_geometry
from dqreg.registration.register import register
from dqreg.registration.result.display_unit import in_unit, shown_target
from dqreg.registration.result.result import Registration
from dqreg.synth import demo_case, load_case


@pytest.fixture(scope="module")
def found() -> Registration:
    # The pose is the truth that the virtual scan came with.
    case = load_case(demo_case())
    return register(case.scan, case.part, case.T_target_source, effort="fast", source_units="mm", target_units="mm")


def test_a_result_in_metres_maps_the_same_points(found: Registration) -> None:
    other = in_unit(found, "m")
    points = np.random.default_rng(0).normal(scale=100.0, size=(50, 3))
    np.testing.assert_allclose(other.apply(points), found.apply(points) / 1000.0, rtol=1e-12, atol=1e-15)
    # The covariance of a translation is an area, that of a rotation has no unit.
    np.testing.assert_allclose(np.diag(other.covariance)[:3], np.diag(found.covariance)[:3], rtol=1e-12)
    np.testing.assert_allclose(np.diag(other.covariance)[3:], np.diag(found.covariance)[3:] / 1e6, rtol=1e-12)
    assert other.rms == pytest.approx(found.rms / 1000.0)
    assert other.settings["diagonal"] == pytest.approx(found.settings["diagonal"] / 1000.0)
    assert other.settings["target_units"] == "m"
    assert found.settings["target_units"] == "mm"


def test_every_setting_is_what_it_is_where_the_data_come_in_that_unit(found: Registration) -> None:
    case, k = load_case(demo_case()), 1e-3
    scan, part = as_geometry(case.scan, "scan"), as_geometry(case.part, "part")
    T = case.T_target_source.copy()
    T[:3, 3] *= k
    in_m = register(
        k * scan.points, Mesh(k * part.vertices, part.faces), T, effort="fast", source_units="m", target_units="m"
    )
    shown, names = in_unit(found, "m").settings, [n for n, v in in_m.settings.items() if isinstance(v, (float, list))]
    assert {"diagonal", "width", "centre", "cell_size", "max_angle_deg", "T_start"} <= set(names)
    # A scan in mm is scaled to its target in m.
    assert shown["source_scale"] == pytest.approx(k * in_m.settings["source_scale"])
    for name in set(names) - {"source_scale"}:
        # Rounding in the other unit ends the loop elsewhere within its convergence.
        np.testing.assert_allclose(shown[name], in_m.settings[name], rtol=1e-4, atol=1e-9, err_msg=name)


def test_a_length_that_few_results_have_is_one_too(found: Registration) -> None:
    of_step = dataclasses.replace(found, settings=found.settings | {"chord": 0.254})
    assert in_unit(of_step, "inch").settings["chord"] == pytest.approx(0.01)


def test_there_and_back_is_the_same(found: Registration, tmp_path: Path) -> None:
    back = in_unit(in_unit(found, "inch"), "mm")
    back.save(tmp_path / "r.json")
    loaded = Registration.load(tmp_path / "r.json")
    np.testing.assert_allclose(loaded.T_target_source, found.T_target_source, rtol=1e-13, atol=1e-13)
    assert [d.sigma for d in loaded.observability] == pytest.approx([d.sigma for d in found.observability])
    assert [i.energy for i in loaded.history] == pytest.approx([i.energy for i in found.history])


def test_a_part_is_shown_in_a_unit_only_where_its_own_is_known(found: Registration) -> None:
    part = load_case(demo_case()).part
    with pytest.raises(InputError, match="names no length unit; name it with --target-units"):
        shown_target(part, None, "mm")
    assert shown_target(part, "mm", "mm").geometry == part
    shown = shown_target(part, "mm", "inch")
    assert (shown.units, shown.own, shown.scale) == ("inch", "mm", pytest.approx(1.0 / 25.4))
    T = np.eye(4)
    T[:3, 3] = 25.4
    np.testing.assert_allclose(shown.start(T)[:3, 3], 1.0)
    assert shown.start("identity") == "identity"
    native = shown.native(in_unit(found, "inch"))
    np.testing.assert_allclose(native.T_target_source, found.T_target_source, rtol=1e-13, atol=1e-13)


def test_a_cloud_in_another_unit_was_seen_from_the_same_place(tmp_path: Path) -> None:
    head = "VERSION .7\nFIELDS x y z time\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\n"
    rows = "VIEWPOINT 50.8 0 25.4 1 0 0 0\nPOINTS 3\nDATA ascii\n25.4 0 0 1\n0 25.4 0 2\n0 0 25.4 3\n"
    (tmp_path / "target.pcd").write_text(head + rows)
    shown = shown_target(tmp_path / "target.pcd", "mm", "inch").geometry
    assert isinstance(shown, PointCloud)
    np.testing.assert_allclose(shown.points, np.eye(3), atol=1e-6)
    assert shown.viewpoint is not None
    assert shown.times is not None
    np.testing.assert_allclose(shown.viewpoint, [2.0, 0.0, 1.0])
    assert (shown.units, shown.times.tolist()) == ("inch", [1.0, 2.0, 3.0])


@pytest.mark.parametrize("stated", [None, "m"])
def test_a_scan_without_a_unit_is_in_that_of_the_file_of_the_part(tmp_path: Path, stated: str | None) -> None:
    case = load_case(demo_case())
    points = read_cloud(case.scan).points
    shown = shown_target(case.part, "mm", "m")
    for scale, unit in ((1.0, "mm"), (1.0 / 1000.0, stated)):
        write_cloud(tmp_path / "scan.ply", points * scale, comments=[] if stated is None else [f"units {unit}"])
        with shown.source_units(tmp_path / "scan.ply", None) as units:
            assert units == (unit or "mm")
    # A scan in metres that says so is converted; one that does not is asked for its unit.
    start = shown.start(case.T_target_source)
    with contextlib.ExitStack() as stack:
        if stated is None:
            stack.enter_context(pytest.raises(UnitsError, match=r"scan.ply names no length unit, and in mm .*--source"))
        with shown.source_units(tmp_path / "scan.ply", None) as units:
            register(tmp_path / "scan.ply", shown.geometry, start, source_units=units, effort="fast")
    with shown.source_units(tmp_path / "scan.ply", "cm") as units:
        assert units == "cm"
