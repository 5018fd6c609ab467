from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dqreg._open3d import load_open3d
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import areas_of, faces_of
from dqreg.inspection.deviations.files import ABOVE_RGB, BELOW_RGB
from dqreg.inspection.tolerances import PointLimits, Tolerance, limits_at
from dqreg.report.charts import NARROW_CANVAS, WIDE_CANVAS, convergence, histogram, ticks
from dqreg.report.colours import Scale, nice_above
from dqreg.report.facts import facts_of
from dqreg.report.hints import hints_of
from dqreg.report.text import pose_forms
from dqreg.report.view3d import fewer_triangles, scene_of, sharp_edges
from dqreg.rigid import DualQuaternion, quaternion, twist
from dqreg.synth.parts import box, bracket
from tests.report.scenes import BUMP, NOISE, bumpy, data_of, failed

twists = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


def numbers(text: str) -> np.ndarray:
    return np.array([[float(word) for word in line.split() if not word.isalpha()] for line in text.splitlines()])


@given(twists)
@example(np.array([1e-8, 0.0, 0.0, 0.0, 0.0, 0.0]))  # nearly where two Euler axes fall together
@example(np.array([0.0, 0.5 * np.pi, 0.0, 0.0, 0.0, 0.0]))  # where two of the fixed axes do, on either side
@example(np.array([0.0, -0.5 * np.pi, 0.0, 0.0, 0.0, 0.0]))
@settings(deadline=None, max_examples=60)
def test_every_form_is_the_same_pose(v):
    T = twist.exp(v)
    forms = {form.name: form.text for form in pose_forms(T, "mm")}
    np.testing.assert_array_equal(numbers(forms["Matrix"]), T)
    np.testing.assert_allclose(numbers(forms["Inverse matrix"]) @ T, np.eye(4), atol=1e-13)
    q, t = forms["Quaternion and translation"].splitlines()
    np.testing.assert_allclose(quaternion.to_matrix(numbers(q)[0]), T[:3, :3], atol=1e-13)
    np.testing.assert_array_equal(numbers(t)[0], T[:3, 3])
    np.testing.assert_allclose(DualQuaternion(*numbers(forms["Dual quaternion"])).as_matrix(), T, atol=1e-12)
    words = {line.split()[0]: [float(x) for x in line.split()[1:]] for line in forms["Screw"].splitlines()}
    screw = DualQuaternion.from_screw(
        words["axis"], np.deg2rad(words["rotation"][0]), words["translation"][0], words["point"]
    )
    np.testing.assert_allclose(screw.as_matrix(), T, atol=1e-9)
    # Euler angles against the orders that the words promise, by elementary turns.
    (x, y, z), _ = np.deg2rad(numbers(forms["Euler angles, fixed axes"]))
    turns = {a: (lambda angle, a=a: Rotation.from_euler(a, angle).as_matrix()) for a in "xyz"}
    np.testing.assert_allclose(turns["z"](z) @ turns["y"](y) @ turns["x"](x), T[:3, :3], atol=1e-9)
    (a, b, c), _ = np.deg2rad(numbers(forms["Euler angles, moving axes"]))
    np.testing.assert_allclose(turns["z"](a) @ turns["y"](b) @ turns["z"](c), T[:3, :3], atol=1e-9)


def test_faces_of_a_box_are_its_six_sides():
    part = Mesh(*box((3.0, 2.0, 1.0)))
    count, labels = faces_of(part)
    assert count == 6
    np.testing.assert_allclose(sorted(areas_of(part, labels)), [2.0, 2.0, 3.0, 3.0, 6.0, 6.0])


def test_unwelded_triangles_make_the_same_faces():
    part = Mesh(*bracket())
    loose = Mesh(part.corners.reshape(-1, 3), np.arange(3 * len(part.faces)).reshape(-1, 3))
    assert faces_of(loose)[0] == faces_of(part)[0]


def test_the_region_with_the_bump_fails_and_the_others_pass():
    # The plate from above, 80 x 120 mm, carries the bump; 0.2 mm are four sigma.
    data = data_of(bumpy(), 4.0 * NOISE)
    rows = {region.name + str(np.sign(region.centre[2])): region for region in data.regions}
    plate = max((r for r in data.regions if r.name == "flat face towards +z"), key=lambda r: r.points)
    assert plate.share_within is not None
    # Three standard errors of the share of so many points that fall on the bump.
    share = np.pi * 81.0 / 9600.0
    error = np.sqrt(share * (1.0 - share) / plate.points)
    assert 1.0 - plate.share_within == pytest.approx(share, abs=3.0 * error)
    assert len(rows) > 3
    assert [region.name for region in data.regions if region.outcome != "pass"] == [plate.name]
    for region in data.regions:
        # Three standard errors of a deviation from the median, 1.17 over the root of the number of points each.
        assert region.spread == pytest.approx(NOISE, rel=3.0 * 1.17 / np.sqrt(region.points))
        assert abs(region.median) < 0.02


def test_the_worst_place_is_the_bump():
    data = data_of(bumpy())
    assert data.worst[0].value == pytest.approx(BUMP, abs=0.2)
    np.testing.assert_allclose(data.worst[0].position[:2], [90.0, 30.0], atol=10.0)


def test_scale_ends_at_the_tolerance():
    assert data_of(bumpy(), 0.37).scale == Scale(0.37, True)


def test_colour_codes_run_along_the_scale():
    scale = Scale(2.0, True)
    codes = scale.codes(np.linspace(-2.0, 2.0, 401))
    assert (np.diff(codes.astype(int)) >= 0).all()
    assert (codes[0], codes[200], codes[-1]) == (1, 128, 254)
    assert scale.codes(np.array([-2.1, 2.1])).tolist() == [0, 255]
    assert Scale(2.0, False).codes(np.array([0.0, 2.0, 2.1])).tolist() == [1, 254, 255]


def test_what_is_out_of_the_tolerance_of_its_face_is_dark_though_the_scale_goes_on():
    values = np.array([-1.5, -0.5, 0.5, 1.5, 1.5])
    allowed = PointLimits(np.full(5, -1.0), np.array([1.0, 1.0, 1.0, 1.0, np.inf]))
    scale = Scale(2.0, True)
    codes = scale.codes(values, allowed)
    assert codes[[0, 3]].tolist() == [0, 255]
    assert codes[[1, 2, 4]].tolist() == scale.codes(values[[1, 2, 4]]).tolist()


def test_a_bump_within_the_tolerance_of_another_face_is_dark_in_the_view(tmp_path):
    # The bump of 0.8 is within 4.0, where the scale ends, and out of the 0.2 that its face has.
    result = bumpy()
    found = result.deviations(4.0)
    allowed = limits_at(np.zeros(len(found), dtype=np.int64), Tolerance(-0.2, 0.2), {})
    data = dataclasses.replace(data_of(result, 4.0), deviations=dataclasses.replace(found, allowed=allowed))
    out = found.counted & (np.abs(found.values) > 0.2)
    assert out.sum() > 50
    assert ((data.colour_codes(slice(None)) % 255 == 0) == out)[found.counted].all()
    data.deviations.save(tmp_path / "dev.ply")
    shown = load_open3d().t.io.read_point_cloud(str(tmp_path / "dev.ply")).point.colors.numpy()
    dark = (shown == ABOVE_RGB).all(axis=1) | (shown == BELOW_RGB).all(axis=1)
    assert (dark == out)[found.counted].all()


@given(st.floats(1e-12, 1e12))
def test_nice_limits_are_just_above(value):
    assert value * (1 - 1e-6) <= nice_above(value) <= 1.35 * value


@given(st.floats(-50.0, 50.0), st.floats(-6.0, 6.0))
def test_ticks_lie_within_and_are_few(where, power):
    # Charts show ranges that are not tiny beside their place.
    width = 10.0**power
    low = where * width
    found = ticks(low, low + width)
    assert 2 <= len(found) <= 14
    assert found[0] >= low - 1e-6 * width
    assert found[-1] <= low + width * (1 + 1e-6)


@pytest.mark.parametrize("size", [WIDE_CANVAS, NARROW_CANVAS])
def test_histogram_bars_hold_all_points_in_range(size):
    values = np.random.default_rng(0).normal(0.0, 0.3, 5000)
    root = ET.fromstring(histogram(values, Scale(1.0, True), "mm", None, size).replace("&nbsp;", " "))
    bars = [element for element in root if element.get("class") == "bar"]
    heights = np.array([float(bar.get("height")) for bar in bars])
    counts, _ = np.histogram(values, np.linspace(-1.0, 1.0, 81))
    shown = counts[counts > 0]
    # Heights are written to a tenth of a pixel.
    np.testing.assert_allclose(heights / heights.max(), shown / shown.max(), atol=0.001)


def test_what_lies_beyond_the_histogram_stands_with_the_length_it_is_beyond():
    # Of the tolerance 0.1 the ends are at 1.6 times that: another share than the one out of tolerance.
    values = np.r_[np.zeros(70), np.full(20, 0.12), np.full(10, 0.2)]
    texts = [element.text for element in ET.fromstring(histogram(values, Scale(0.1, True), "mm", (-0.1, 0.1)))]
    assert "above 0.16 mm: 10.0 %" in texts
    assert "below −0.16 mm: 0 %" in texts
    unnamed = [element.text for element in ET.fromstring(histogram(values, Scale(0.1, True), "", (-0.1, 0.1)))]
    assert "above 0.16: 10.0 %" in unnamed
    assert "deviation" in unnamed
    # A few are never rounded to more than they are: in the table below, of a wider band, they are "< 0.1" too.
    few = np.r_[np.zeros(9993), np.full(7, 0.2)]
    assert "above 0.16 mm: < 0.1 %" in [
        element.text for element in ET.fromstring(histogram(few, Scale(0.1, True), "mm", (-0.1, 0.1)))
    ]


def test_convergence_is_well_formed_and_escaped():
    root = ET.fromstring(convergence(bumpy().history, "<mm> & more"))
    assert "length [<mm> & more]" in "".join(root.itertext())
    assert len(root.findall(".//polyline")) == 2


def test_hints_name_units_that_are_confused():
    import dqreg

    points = bumpy().inputs.source.cloud.points[:2000]
    part = bumpy().inputs.target.geometry
    # No search: with wrong units it would be a long one.
    result = dqreg.register(points / 1000.0, part, "identity", units="ignore", search="never")
    assert result.verdict.level != "accepted"
    assert any("m and mm" in hint for hint in hints_of(result))
    units = {"source_units": "mm", "target_units": "m", "units": "ignore"}
    named = dqreg.register(points, part, "identity", search="never", **units)
    assert any("although they are named mm and m" in hint for hint in hints_of(named))
    assert hints_of(bumpy()) == []
    assert hints_of(failed())


def test_fewer_triangles_keep_the_shape():
    sphere_points = np.random.default_rng(1).normal(size=(4000, 3))
    from scipy.spatial import ConvexHull

    sphere_points /= np.linalg.norm(sphere_points, axis=1, keepdims=True)
    faces = ConvexHull(sphere_points).simplices
    vertices, fewer = fewer_triangles(sphere_points, faces, 2000)
    assert 500 < len(fewer) <= 2000
    np.testing.assert_allclose(np.linalg.norm(vertices[np.unique(fewer)], axis=1), 1.0, atol=0.05)


def test_sharp_edges_of_a_box_are_its_twelve():
    part = Mesh(*box((3.0, 2.0, 1.0)))
    edges = sharp_edges(part.vertices, part.faces)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    # However finely its sides are cut.
    assert lengths.sum() == pytest.approx(4 * (3.0 + 2.0 + 1.0))


def test_placed_matches_the_pose_far_away():

    result = bumpy()
    direct = result.apply(result.inputs.source.cloud.points + result.inputs.source.origin)
    np.testing.assert_allclose(
        result.inputs.placed(result.T_target_source), direct - result.inputs.target.origin, atol=1e-11
    )


def test_the_sigmas_say_what_they_are_estimated_from_and_what_they_leave_out():
    words = facts_of(bumpy(), "mm")["sigmas"]["words"]
    # The covariance is learned from patches; taking all residuals as independent is what is done of few pairs only.
    assert "from how the residuals scatter from patch to patch" in words
    assert "common to the whole scan" in words
    assert "not included" in words
    assert "take the residuals of all pairs as independent" not in words


def test_motions_of_the_view_are_the_values_of_the_result():
    data = data_of(bumpy())
    drawn = scene_of(data)["motions"]
    assert len(drawn) == 6
    for motion, direction in zip(drawn, data.result.observability, strict=True):
        assert (motion["kind"], motion["axis"], motion["free"]) == (direction.kind, direction.axis, direction.is_free)
        np.testing.assert_allclose(motion["through"], (direction.point - data.origin) / data.size)


@pytest.mark.parametrize("size", [WIDE_CANVAS, NARROW_CANVAS])
@pytest.mark.parametrize("reach", [0.0002, 0.125, 1.0])
def test_no_number_of_an_axis_passes_the_rim(size, reach):
    root = ET.fromstring(histogram(np.zeros(3), Scale(reach, True), "", None, size))
    for element in (each for each in root if each.tag == "text" and each.text):
        # Half a digit for each letter on either side of what is centred.
        share = {"mid": 0.5, "end": 0.0, "start": 1.0}.get(element.get("class"))
        if share is not None:
            assert float(element.get("x", 0.0)) + share * 8.3 * len(element.text) <= size[0] + 0.1
