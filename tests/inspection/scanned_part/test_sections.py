"""Sections and wall thickness of a block with known errors."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.sampling import sample_mesh
from dqreg.inspection import inspect, measure_deviations, part_faces, section_of, thickness_of
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.scanned_part.sections import outlines
from dqreg.report.section_picture import section_picture
from dqreg.synth.parts import box, bracket

PART = Mesh(*box((30.0, 20.0, 10.0)))
TOP, BOTTOM = (int(np.argmax(PART.face_normals @ n)) for n in ((0, 0, 1.0), (0, 0, -1.0)))


def block(top: float, bottom: float, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Points on top and bottom of the block, which lie that much outside; none elsewhere."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (6_000, 3)) * [14.5, 9.5, 0.0]
    up = np.arange(len(points)) % 2 == 0
    points[:, 2] = np.where(up, 5.0 + top, -5.0 - bottom) + noise * rng.normal(size=len(points))
    return points


def test_a_section_has_the_outline_and_the_deviations_along_it() -> None:
    found = measure_deviations(block(0.05, 0.02, 0.005), PART, MeshSurface(PART), reach=2.0)
    cut = section_of(found, [0.0, 1.0, 0.0], [0.0, 3.0, 0.0])
    (curve,) = cut.curves
    assert np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() == pytest.approx(80.0)
    np.testing.assert_allclose(curve[0], curve[-1])
    np.testing.assert_allclose(cut.positions[:, 1], 1.0)
    high, low = cut.outward[:, 2] > 0.5, cut.outward[:, 2] < -0.5
    for side, value in ((high, 0.05), (low, 0.02)):
        known = side & np.isfinite(cut.values)
        assert known.mean() > 0.25
        # Five standard deviations of each median.
        assert (np.abs(cut.values[known] - value) < 5.0 * cut.sigma[known]).all()
    # The ends were not scanned: no value is made up there.
    assert np.isnan(cut.values[np.abs(cut.outward[:, 0]) > 0.5]).all()
    assert cut.coverage == pytest.approx(0.75, abs=0.05)


def test_holes_are_outlines_of_their_own_and_open_meshes_end() -> None:
    part = Mesh(*bracket())
    curves, normals = outlines(part, np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, 1.0]))
    assert len(curves) == 5
    assert all(len(curve) == len(each) + 1 for curve, each in zip(curves, normals, strict=True))
    lengths = sorted(float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()) for curve in curves)
    # The holes of 9, 9, 9 and 16: polygons, shorter than their circles by less than 1 %.
    np.testing.assert_allclose(lengths[:4], np.pi * np.array([9.0, 9.0, 9.0, 16.0]), rtol=0.01)
    sheet = Mesh([[0, 0, 0], [4, 0, 0], [4, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    (line,), _ = outlines(sheet, np.array([1.0, 0, 0]), np.array([1.0, 0, 0]))
    assert sorted(line[[0, -1], 1].tolist()) == [0.0, 2.0]


def test_a_plane_that_misses_or_is_none_is_named() -> None:
    found = measure_deviations(block(0.0, 0.0), PART, MeshSurface(PART), reach=2.0)
    with pytest.raises(DegenerateGeometryError, match=r"the plane through \(0, 50, 0\) misses the part"):
        section_of(found, [0, 50, 0], [0, 1, 0])
    with pytest.raises(InputError, match="must not be of length zero"):
        section_of(found, [0, 0, 0], [0, 0, 0])
    with pytest.raises(InputError, match="step must be a length"):
        section_of(found, [0, 0, 0], [0, 1, 0], step=-1.0)


def test_the_picture_says_how_much_it_enlarges() -> None:
    found = measure_deviations(block(0.05, 0.02), PART, MeshSurface(PART), reach=2.0)
    picture = section_picture(section_of(found, [0, 0, 0], [0, 1, 0]), "mm", 0.1)
    assert picture.startswith("<svg")
    # The largest deviation, 0.05, stands 1.8 off the outline of 30 at most: 20 times, not 50.
    assert "deviations 20 times enlarged" in picture
    assert "+0.05 mm" in picture


def test_the_picture_says_where_its_axes_point_and_how_wide_it_is() -> None:
    found = measure_deviations(block(0.05, 0.02), PART, MeshSurface(PART), reach=2.0)
    for normal, words in (([0, 1, 0], "−x to the right, +z upward"), ([0, 0, -1], "−x to the right, +y upward")):
        cut = section_of(found, [0, 0, 0], normal)
        picture = section_picture(cut, "mm", 0.1)
        assert f"{words}; the outline is 30 mm wide" in picture
        # What is drawn goes that way: the first outline, in pixels across and down.
        (path,) = re.findall(r'class="outline".*? points="(.*?)"', picture)[:1]
        drawn = np.array([[float(x) for x in point.split(",")] for point in path.split()])
        places, up = cut.curves[0], np.eye(3)[2 if normal[1] else 1]
        assert np.corrcoef(drawn[:, 0], -places[:, 0])[0, 1] > 0.999
        assert np.corrcoef(-drawn[:, 1], places @ up)[0, 1] > 0.999


def test_wall_thickness_is_both_sides_together() -> None:
    from dqreg.geometry.mesh_faces import faces_of

    plan = {
        "characteristic": [{"name": "wall", "kind": "thickness", "face": int(faces_of(PART)[1][TOP]), "tolerance": 0.1}]
    }
    for top, bottom in ((0.05, 0.03), (-0.04, -0.05)):
        scan = measure_deviations(block(top, bottom, 0.005), PART, MeshSurface(PART), reach=2.0)
        (row,) = inspect(scan, plan_of(plan)).characteristics
        assert row.nominal == pytest.approx(10.0)
        assert abs(row.value - (10.0 + top + bottom)) <= row.uncertainty < 0.02
        wall = thickness_of(scan, int(faces_of(PART)[1][TOP]))
        assert (wall.value, wall.uncertainty, wall.nominal) == (row.value, row.uncertainty, row.nominal)
        assert np.median(wall.values) == pytest.approx(10.0 + top + bottom, abs=4.0 * wall.sigma)
        np.testing.assert_allclose(wall.positions[:, 2], 5.0)
    one = block(0.0, 0.0)
    (row,) = inspect(
        measure_deviations(one[one[:, 2] > 0], PART, MeshSurface(PART), reach=2.0), plan_of(plan)
    ).characteristics
    assert "far side" in row.remark
    # Ten points at the bottom are no far side.
    few = np.concatenate([one[one[:, 2] > 0], one[one[:, 2] < 0][:10]])
    (row,) = inspect(measure_deviations(few, PART, MeshSurface(PART), reach=2.0), plan_of(plan)).characteristics
    assert "far side" in row.remark


def test_a_far_side_that_faces_elsewhere_is_no_wall() -> None:
    # A wedge of 26.6 degrees: behind its base the slope is a wall, behind its back, 63.4 degrees off, it is none.
    corners = [[0, 0, 0], [10, 0, 0], [10, 0, 5], [0, 8, 0], [10, 8, 0], [10, 8, 5]]
    sides = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]
    wedge = Mesh(np.array(corners, dtype=float), np.array(sides))
    points = sample_mesh(wedge, 20_000, np.random.default_rng(0)).points
    scan = measure_deviations(points, wedge, MeshSurface(wedge), reach=1.0)
    faces = {tuple(np.round(face.feature.axis).astype(int)): face.number for face in part_faces(wedge) if face.feature}
    wall = thickness_of(scan, faces[0, 0, -1])
    # As thick as the wedge is high there.
    np.testing.assert_allclose(wall.nominals, wall.positions[:, 0] / 2.0, atol=0.2)
    with pytest.raises(DegenerateGeometryError, match="no wall lies behind"):
        thickness_of(scan, faces[1, 0, 0])


def test_deviations_along_sections_are_a_table(tmp_path: Path) -> None:
    found = measure_deviations(block(0.05, 0.02, 0.005), PART, MeshSurface(PART), reach=2.0)
    cut = section_of(found, [0.0, 1.0, 0.0], [0.0, 3.0, 0.0])
    cut.save(tmp_path / "cut.csv", "middle", units="mm")
    rows = list(csv.DictReader((tmp_path / "cut.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(cut.values)
    assert {row["section"] for row in rows} == {"middle"}
    for name, values in (("deviation [mm]", cut.values), ("arc [mm]", cut.arc), ("z [mm]", cut.positions[:, 2])):
        # What was not scanned has no value.
        read = np.array([float(row[name] or "nan") for row in rows])
        np.testing.assert_allclose(read, values, atol=1e-4)
