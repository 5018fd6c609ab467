"""What the worker process does for a step, asked directly: cuts, drawings, picks, alignments, the sheet."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_geometry, write_cloud
from dqreg.geometry import Mesh, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.geometry.opening import as_geometry
from dqreg.inspection import inspect, read_plan
from dqreg.registration.register import register
from dqreg.registration.result.part_inspection import inspect_registration
from dqreg.rigid import pose, twist
from dqreg.studio import alignments, cleaning, drawing, judging, payloads, picking, reading
from dqreg.studio.aligning import align, align_pairs, mirror_question, pose_of_drawn, result_of
from dqreg.studio.visit import Cut, FaceTolerance, Pair, PlaneCut, Reference, Side, Visit
from dqreg.studio.worker_cache import Place
from dqreg.synth.parts import box

PART = Mesh(*box((30.0, 20.0, 10.0)))
# Known pose of the virtual scan: it was moved by the inverse of it.
T = twist.exp(np.array([0.02, -0.03, 0.05, 0.4, -0.3, 0.2]))
STAND = list(np.eye(4)[:3].ravel())
AXES = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Place:
    folder = tmp_path_factory.mktemp("visit")
    on_part = sample_mesh(PART, 3000, np.random.default_rng(0)).points
    table = np.random.default_rng(1).uniform(-60.0, 60.0, (3000, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, -7.0]
    write_cloud(folder / "scan.ply", pose.apply(pose.inverse(T), np.concatenate([on_part, table])))
    _write_stl(folder / "part.stl", PART)
    scan, part = Side("scan.ply", "scan.ply", "mm"), Side("part.stl", "part.stl", "mm")
    return Place(folder, Visit(scan, part, start="identity"))


def _write_stl(path, mesh: Mesh) -> None:
    import trimesh

    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def changed(place: Place, **values) -> Place:
    return Place(place.folder, dataclasses.replace(place.visit, **values))


@pytest.fixture(scope="module")
def cleaned(place) -> Place:
    return changed(place, cuts=(Cut(**reading.plane_question(place)["plane"]),))


def test_the_table_is_found_and_the_part_is_not(place, cleaned):
    stays = cleaning.kept_rows(place.scan().points, cleaned.visit.cuts)
    assert stays[:3000].mean() > 0.99
    assert not stays[3000:].any()
    # What is left of the scan has planes too; none of them extends beyond the part.
    assert reading.plane_question(cleaned) == {"plane": None}
    drawn = reading.draw_scan(cleaned)
    assert drawn["on"] + drawn["off"] == 6000
    assert drawn["left"] == drawn["on"] == stays.sum()


def test_cuts_follow_their_rules():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 3))
    cube = Cut("box", low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0))
    inside = (points >= 0.0).all(axis=1)
    np.testing.assert_array_equal(cleaning.kept_rows(points, (cube,)), ~inside)
    np.testing.assert_array_equal(cleaning.kept_rows(points, (dataclasses.replace(cube, keep=True),)), inside)
    square = Cut("lasso", polygon=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    np.testing.assert_array_equal(cleaning.kept_rows(points, (square,)), ~(points[:, :2] > 0.0).all(axis=1))
    assert not cleaning.kept_rows(points, (cube, dataclasses.replace(cube, keep=True))).any()


def test_nothing_left_is_refused(place):
    everything = Cut("box", low=(-1e3, -1e3, -1e3), high=(1e3, 1e3, 1e3))
    with pytest.raises(InputError, match="leave nothing"):
        cleaning.cleaned_file(changed(place, cuts=(everything,)))


@pytest.mark.parametrize("scale", [1.0, 25.4])
def test_a_drawn_pose_is_the_pose(scale):
    rng = np.random.default_rng(3)
    scan, part = (drawing.DrawnFrame(rng.normal(size=3), size) for size in (2.0, 7.0))
    points = rng.normal(size=(50, 3))
    motion = np.array(drawing.drawn_pose(T, scale, scan, part)).reshape(3, 4)
    drawn = scan.to_drawn(points) @ motion[:, :3].T + motion[:, 3]
    np.testing.assert_allclose(part.to_side(drawn), pose.apply(T, scale * points), atol=1e-12)
    np.testing.assert_allclose(drawing.true_pose(motion, scale, scan, part), T, atol=1e-12)


def test_drawings_hold_the_places_to_their_steps():
    words, data = payloads.part_payload(PART, frame := drawing.frame_of(PART), faces_of(PART)[1])
    steps = np.frombuffer(data, "<u2", 3 * words["count"]).reshape(-1, 3)
    places = frame.to_side(np.array(words["low"]) + steps / 65535 * words["extent"])
    at = (6 * words["count"] + 3) // 4 * 4
    faces = np.frombuffer(data, "<u4", 3 * words["drawn"], offset=at).reshape(-1, 3)
    assert Mesh(places, faces.astype(np.int64)).volume == pytest.approx(6000.0, rel=1e-4)
    # Every face of the part is one run of triangles.
    assert sorted(face for face, _, _ in words["faces"]) == list(range(6))
    assert sum(count for _, _, count in words["faces"]) == len(PART.faces)


def test_a_click_meets_part_and_scan(place):
    frame = drawing.frame_of(place.part())
    look = {"at": frame.to_drawn(np.array([4.0, 3.0, 0.0])).tolist(), "axes": AXES, "radius": 0.05, "motion": STAND}
    hit = picking.pick_part(place, look)
    np.testing.assert_allclose(hit["point"], [4.0, 3.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(hit["normal"], [0.0, 0.0, 1.0], atol=1e-9)
    assert picking.pick_part(place, look | {"at": [9.0, 9.0, 0.0]}) == {"point": None}
    motion = drawing.drawn_pose(T, 1.0, drawing.frame_of(place.scan()), frame)
    point = picking.pick_scan(place, look | {"motion": motion})["point"]
    # The point in front is one of the top face, not of the table below.
    np.testing.assert_allclose(pose.apply(T, np.array([point]))[0], [4.0, 3.0, 5.0], atol=1.7)
    assert point in place.scan().points.tolist()


def test_a_stray_in_front_is_not_what_was_meant(place):
    part = place.part()
    on_part = sample_mesh(part, 20_000, np.random.default_rng(0)).points
    strays = np.array([[4.0, 3.0, 9.0], [4.2, 3.1, 14.0]])
    points = np.concatenate([on_part, strays])
    look = picking.Look.of({"at": [4.0, 3.0, 0.0], "axes": AXES, "radius": 0.8})
    found = picking._nearest(points, np.eye(3), np.zeros(3), look)
    np.testing.assert_allclose(found, [4.0, 3.0, 5.0], atol=0.8)
    # Where there is nothing else, a stray can be pointed at.
    assert picking._nearest(strays, np.eye(3), np.zeros(3), look) == [4.2, 3.1, 14.0]


def test_a_lasso_is_about_the_points_that_are_seen_in_it(place):
    frame = drawing.frame_of(place.part())
    motion = drawing.drawn_pose(T, 1.0, drawing.frame_of(place.scan()), frame)
    corners = frame.to_drawn(np.array([[0.0, 0.0, 0.0], [15.5, 0, 0], [15.5, 10.5, 0], [0, 10.5, 0]]))[:, :2].tolist()
    cut = picking.lasso_cut(place, {"axes": AXES, "motion": motion, "polygon": corners})
    on_part = pose.apply(T, place.scan().points)
    expected = ((on_part[:, :2] > 0.0) & (on_part[:, :2] < [15.5, 10.5])).all(axis=1)
    np.testing.assert_array_equal(~cleaning.kept_rows(place.scan().points, (cut,)), expected)


@pytest.mark.parametrize(
    "look",
    [{}, {"axes": [[1, 0, 0]]}, {"axes": AXES, "motion": [1.0] * 11}, {"axes": "x"}, {"axes": AXES, "radius": "x"}],
)
def test_a_look_that_is_none_is_refused(place, look):
    with pytest.raises(InputError):
        picking.pick_part(place, look)


@pytest.mark.parametrize("drawn", [None, "x", ["a"] * 12, [1.0] * 11, [float("nan")] * 12])
def test_a_motion_that_is_none_is_refused(place, drawn):
    with pytest.raises(InputError):
        pose_of_drawn(place, {"drawn": drawn})


def test_the_reach_is_what_deviations_are_measured_with(place):
    align(place)
    found = judging.show_reach(place)
    assert sum(found["counts"][key] for key in ("on_part", "beyond_reach", "other_surfaces", "outliers")) == 6000
    codes = np.frombuffer((place.folder / "reach.bin").read_bytes()[-6000:], "<u1")
    assert np.count_nonzero(codes == 1) == found["counts"]["on_part"] >= 2900
    given = judging.show_reach(changed(place, reach=0.5))
    assert (given["reach"], given["from"]) == (0.5, "given")


def test_a_mirrored_scan_is_the_mirror_image(place):
    mirrored = changed(place, mirrored=True)
    np.testing.assert_array_equal(mirrored.scan().points, place.scan().points * [-1.0, 1.0, 1.0])
    again = cleaning.cleaned_file(mirrored)
    assert again.name == "scan_cleaned.ply"
    np.testing.assert_allclose(read_geometry(again).points, mirrored.scan().points, atol=1e-5)
    # One process may do a visit twice, in one folder or in two.
    again.unlink()
    assert cleaning.cleaned_file(mirrored).is_file()


CORNER = Cut("box", low=(-60.0, -60.0, -60.0), high=(0.0, 0.0, 60.0))


def known_scan(tmp_path, *comments: str) -> Place:
    """A scan in inches of which the file tells times and normals, and what the comments say."""
    cloud = sample_mesh(PART, 3000, np.random.default_rng(2))
    points = pose.apply(pose.inverse(T), cloud.points) / 25.4
    write_cloud(
        tmp_path / "scan.ply",
        points,
        pose.rotate(pose.inverse(T), cloud.normals),
        fields={"time": points[:, 0]},
        comments=["units inch", *comments],
    )
    _write_stl(tmp_path / "part.stl", PART)
    return Place(tmp_path, Visit(Side("scan.ply", "scan.ply"), Side("part.stl", "part.stl", "mm"), start="identity"))


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_what_is_left_of_a_scan_is_known_as_before(tmp_path, is_mirrored):
    place = changed(known_scan(tmp_path, "viewpoint 0.1 -2 1e1"), cuts=(CORNER,), mirrored=is_mirrored)
    scan, left = place.scan(), as_geometry(cleaning.cleaned_file(place), "scan")
    stays = cleaning.kept_rows(scan.points, place.visit.cuts)
    assert 100 < len(left) == np.count_nonzero(stays) < len(scan)
    np.testing.assert_array_equal(left.points, scan.points[stays])
    np.testing.assert_allclose(left.normals, scan.normals[stays], atol=1e-12)
    np.testing.assert_array_equal(left.times, scan.times[stays])
    np.testing.assert_array_equal(left.viewpoint, [-0.1 if is_mirrored else 0.1, -2.0, 10.0])
    assert left.units == scan.units == "inch"


def test_a_cut_scan_is_registered_in_the_unit_of_its_file(tmp_path):
    # Nobody named it: an inch is no millimetre.
    place = changed(known_scan(tmp_path), cuts=(CORNER,))
    told = align(place)
    assert told["level"] == "accepted"
    np.testing.assert_allclose(told["T"], T, atol=1e-6)
    # Nor is it for the few points that tell a mirror image.
    assert mirror_question(place) == {"mirrored": False}


def test_what_is_left_of_a_mesh_has_the_normals_of_its_faces(tmp_path):
    place = changed(known_scan(tmp_path), scan=Side("part.stl", "part.stl", "mm"), cuts=(CORNER,))
    left, drawn = as_geometry(cleaning.cleaned_file(place), "scan"), cleaning.scan_cloud(place.scan())
    np.testing.assert_allclose(left.normals, drawn.normals[cleaning.kept_rows(drawn.points, (CORNER,))], atol=1e-6)


def test_pairs_are_the_closed_form(place):
    corners = np.array([[15.0, 10, 5], [-15, 10, 5], [15, -10, 5], [-15, -10, -5]])
    seen = pose.apply(pose.inverse(T), corners)
    pairs = tuple(Pair(tuple(a), tuple(b)) for a, b in zip(seen.tolist(), corners.tolist(), strict=True))
    found = align_pairs(changed(place, pairs=pairs))
    assert max(found["pairs"]) < 1e-12
    moved = pose_of_drawn(changed(place, pairs=pairs), {"drawn": found["drawn"]})
    np.testing.assert_allclose(moved["T"], T, atol=1e-12)


def test_the_studio_says_what_the_library_says(cleaned, tmp_path):
    told = align(cleaned)
    alone = register(
        cleaning.cleaned_file(cleaned), cleaned.part_path, "identity", source_units="mm", target_units="mm"
    )
    np.testing.assert_array_equal(told["T"], alone.T_target_source)
    assert told["level"] == alone.verdict.level
    # The points are on the part exactly: the scan was drawn from its surface.
    np.testing.assert_allclose(told["T"], T, atol=1e-6)
    judged = judging.judge(changed(cleaned, tolerance=0.1, faces=(FaceTolerance(2, 0.05),), labels=((4.0, 3.0, 5.0),)))
    assert judged["decision"]["outcome"] == "pass"
    assert judged["labels"][0]["value"] == pytest.approx(0.0, abs=1e-6)
    again = inspect(alone.deviations(), read_plan(cleaned.folder / "plan.toml")).decision
    assert again is not None
    assert again.share_within == judged["decision"]["share_within"]
    same = [(row["number"], row["median"], row["low"], row["high"]) for row in judged["faces"]]
    assert [(row.number, row.median, row.low, row.high) for row in again.regions] == same
    assert {number: high for number, _, _, high in same} == {**dict.fromkeys(range(6), 0.1), 2: 0.05}


@pytest.mark.usefixtures("small_pictures")
def test_a_side_of_its_own_a_section_and_a_label_are_in_the_sheet(cleaned):
    align(cleaned)
    # Everything lies on the surface: above it nothing is allowed on one face, and nothing below it on the other.
    chosen = {
        "faces": (FaceTolerance(0, 0.1, 0.0), FaceTolerance(5, 0.0, 0.1)),
        "sections": (PlaneCut((1.0, 2.0, 0.0), (0.0, 0.0, 1.0)),),
        "labels": ((4.0, 3.0, 5.0),),
    }
    visit = changed(cleaned, **chosen)
    whole = judging.judge(changed(visit, tolerance=0.1, minus=0.02))["decision"]
    assert (whole["low"], whole["high"], whole["own"]) == (-0.02, 0.1, 2)
    judged = judging.judge(visit)
    (section,) = judged["sections"]
    assert section["coverage"] > 0.5
    assert section["picture"].startswith("<svg")
    limits = {row["number"]: (row["low"], row["high"]) for row in judged["faces"] if row["outcome"] is not None}
    assert limits == {0: (0.0, 0.1), 5: (-0.1, 0.0)}
    assert "plan.toml" in judging.write_sheet(visit)["files"]
    page = (cleaned.folder / "report.html").read_text(encoding="utf-8")
    assert "section 1" in page
    assert '"kind": "tag"' in page or '"kind":"tag"' in page


@pytest.mark.parametrize(
    "chosen",
    [
        {"alignment": "datums"},
        {"alignment": "faces", "chosen": (0, 2, 4), "goal": "minimax"},
        {"alignment": "points"},
    ],
)
def test_every_alignment_lays_an_exact_scan_where_it_belongs(cleaned, chosen):
    align(cleaned)
    visit = changed(cleaned, tolerance=0.1, **chosen)
    if chosen["alignment"] == "datums":
        visit = changed(visit, datums=tuple(alignments.suggest_datums(cleaned)["datums"]))
        assert len(visit.visit.datums) == 3
    if chosen["alignment"] == "points":
        places = [(9.0, 5, 5), (-9, 5, 5), (0, -6, 5), (10, 10, 0), (-10, 10, 0), (15, 0, 0)]
        normals = [(0.0, 0, 1)] * 3 + [(0.0, 1, 0)] * 2 + [(1.0, 0, 0)]
        visit = changed(visit, references=tuple(map(Reference, places, normals)))
    found = alignments.judged(visit)
    np.testing.assert_allclose(found.registration.T_target_source, T, atol=1e-6)
    # The same from the plan alone, as `dqreg inspect` reads it.
    again = inspect_registration(result_of(visit), read_plan(cleaned.folder / "plan.toml"))
    np.testing.assert_array_equal(again.registration.T_target_source, found.registration.T_target_source)
    assert again.record() == found.record()
    # Without a tolerance too: there is nothing to decide, and no plan.
    looked = alignments.judged(changed(visit, tolerance=None))
    np.testing.assert_allclose(looked.registration.T_target_source, T, atol=1e-6)
    assert looked.decision is None
    assert not (cleaned.folder / "plan.toml").exists()


def test_an_alignment_that_lacks_something_says_what(cleaned):
    for chosen, words in (
        ({"alignment": "faces"}, "choose the faces"),
        ({"alignment": "points"}, "six reference points"),
        ({"alignment": "datums"}, "faces of datums"),
        ({"alignment": "faces", "chosen": (0,), "goal": "tolerance"}, "give it in the step Judge"),
    ):
        with pytest.raises(InputError, match=words):
            alignments.judged(changed(cleaned, **chosen))
