from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError, MissingDependencyError
from dqreg.geometry import Mesh, sample_mesh
from dqreg.registration.register import register
from dqreg.registration.result.part_inspection import inspect_registration
from dqreg.registration.result.result import Registration
from dqreg.report.report_data import collect
from dqreg.rigid import pose
from dqreg.synth.parts import bracket

FAR = np.array([4.4e6, 5.1e5, -1e3])


@pytest.fixture(scope="module")
def far_result() -> tuple[Registration, np.ndarray]:
    """A scan 0.05 proud of a part of 156, both far from the origin, and what its deviations should be."""
    part = Mesh(*bracket())
    cloud = sample_mesh(part, 20_000, np.random.default_rng(0))
    assert cloud.normals is not None
    inside = np.random.default_rng(1).uniform(size=len(cloud)) < 0.5
    points = cloud.points + np.where(inside, -0.05, 0.05)[:, None] * cloud.normals
    T = pose.random(np.random.default_rng(2), reach=10.0)
    moved = pose.apply(T, points) + FAR
    start = pose.inverse(T)
    start[:3, 3] += FAR - start[:3, :3] @ FAR
    target = Mesh(part.vertices + FAR, part.faces)
    return register(moved, target, start, effort="fast"), np.where(inside, -0.05, 0.05)


def test_signed_deviations_in_the_order_of_the_scan_at_a_far_origin(far_result) -> None:
    result, expected = far_result
    found = result.deviations(tolerance=0.1)
    assert found.signed
    # Beside an edge a point that is 0.05 inside is nearer to the next face; the pose is good to a tenth of that.
    assert np.mean(np.abs(found.values - expected) < 5e-3) > 0.97
    assert np.abs(found.values).max() < 0.06
    assert found.summary().share_within == 1.0
    assert result.inputs is not None
    source = result.inputs.source
    np.testing.assert_allclose(found.points, result.apply(source.cloud.points + source.origin), atol=3e-8)
    np.testing.assert_allclose(np.linalg.norm(found.points - found.closest, axis=1), np.abs(found.values), atol=3e-9)


def test_a_loaded_result_says_how_to_bring_its_sides_back(far_result, tmp_path: Path) -> None:
    result, _ = far_result
    result.save(tmp_path / "result.json")
    loaded = Registration.load(tmp_path / "result.json")
    with pytest.raises(InputError, match=r"attached\(source, target\)"):
        loaded.deviations()
    with pytest.raises(InputError, match="keep must be True or False; got 'no'"):
        result.deviations(keep="no")


def test_points_beyond_reach_are_measured_but_not_counted() -> None:
    part = Mesh(*bracket())
    points = sample_mesh(part, 5000, np.random.default_rng(3)).points
    table = np.column_stack([np.random.default_rng(4).uniform(-300, 300, (800, 2)), np.full(800, -60.0)])
    result = register(np.vstack([points, table]), part, "identity", effort="fast")
    found = result.deviations()
    assert found.limit == pytest.approx(0.25 * result.settings["max_distance"])
    # Without noise and deviations the part goes as far as the scan can tell.
    assert (found.reach, found.reach_from) == (pytest.approx(result.settings["source_spacing"]), "spacing")
    assert (len(found), found.summary().beyond) == (5800, 800)
    assert found.summary().max < 1e-6
    # A largest distance of the correspondences says nothing of what is the part's.
    short = register(np.vstack([points, table]), part, "identity", effort="fast", max_distance=0.02 * part.diagonal)
    assert short.deviations().reach == found.reach
    everything = result.deviations(reach=np.inf).summary()
    assert (everything.count, everything.beyond) == (5800, 0)
    assert everything.max > 50.0


def test_a_target_without_an_inside_warns() -> None:
    part = Mesh(*bracket())
    scan = sample_mesh(part, 3000, np.random.default_rng(5))
    result = register(scan, Mesh(part.vertices, part.faces[1:]), "identity", effort="fast")
    with pytest.warns(UserWarning, match="not watertight"):
        found = result.deviations()
    assert not found.signed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register(scan, part, "identity", effort="fast").deviations()
        # What is inspected or reported says so itself.
        assert inspect_registration(result, tolerance=1.0).deviations.reason == found.reason
        assert collect(result, result.inputs).deviations.reason == found.reason


def test_deviations_go_out_to_pyvista(far_result) -> None:
    pyvista = pytest.importorskip("pyvista", reason="pip install pyvista")
    found = far_result[0].deviations()
    cloud = found.to_pyvista()
    assert isinstance(cloud, pyvista.PolyData)
    np.testing.assert_array_equal(cloud.points, found.points)
    np.testing.assert_array_equal(cloud.point_data["deviation"], found.values)
    np.testing.assert_array_equal(cloud.point_data["flags"], found.flags)


def test_deviations_without_pyvista_say_what_to_install(far_result, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(MissingDependencyError, match="pip install pyvista"):
        far_result[0].deviations().to_pyvista()


def test_torn_pieces_of_a_table_are_not_what_stands_on_the_part(real_data: Path) -> None:
    # A tee on a table that a line scanner saw in pieces; the initial pose is the one that the collection fitted.
    folder = real_data / "weld_tee_scan_cad"
    T = np.linalg.inv(np.loadtxt(folder / "T_scan_part_fit_table_8in10in_tee_x4y24_45.txt"))
    scan, part = folder / "table_8in10in_tee_x4y24_45.pcd", folder / "tee_nominal.stl"
    result = register(scan, part, T, search="never", source_units="m", target_units="m")
    found = result.deviations()
    # The tee deviates by 8 mm at most; pieces that touch it were counted up to 46 mm off.
    assert np.count_nonzero(found.counted) > 5_000
    assert np.abs(found.values[found.counted]).max() < result.settings["reach"]
