"""Plans, and what they measure on a virtual part whose faults are known because they were made."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Deviations, faces_in_box, inspect, measure_deviations, nearest_face, part_faces, read_plan
from dqreg.inspection.drawing.characteristics import Measured
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.plan.suggested_plan import suggested_plan
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
FACES = part_faces(PART)
NOISE = 0.01
BOTTOM, FRONT, SIDE, TOP = (
    nearest_face(PART, FACES, p).number for p in ((60, 40, 0), (60, 0, 5), (120, 40, 5), (100, 40, 10))
)
HOLE = next(f.number for f in FACES if f.feature and f.is_hole and f.feature.diameter == pytest.approx(16.0, abs=1e-5))
# What is wrong with the virtual part, mm: its base is thicker, its large hole wider and moved.
THICKER, WIDER, MOVED = 0.05, 0.06, 0.04

PLAN: dict[str, Any] = {
    "head": {"part": "4711"},
    "datum": [{"name": "A", "face": BOTTOM}, {"name": "B", "face": FRONT}, {"name": "C", "face": SIDE}],
    "characteristic": [
        {"name": "thickness", "kind": "distance", "faces": [BOTTOM, TOP], "tolerance": 0.1},
        {"name": "hole", "kind": "diameter", "face": HOLE, "plus": 0.05, "minus": 0.02},
        {"name": "hole place", "kind": "position", "face": HOLE, "tolerance": 0.12},
        {"name": "flat", "kind": "form", "face": BOTTOM, "tolerance": 0.05},
        {"name": "square", "kind": "perpendicularity", "near": [60, 0, 5], "datum": "A", "tolerance": 0.05},
        {"name": "top", "kind": "profile", "face": TOP, "tolerance": 0.05},
        {"name": "corner", "kind": "angle", "faces": [BOTTOM, SIDE], "tolerance": 0.1},
    ],
}
TRUTH = {"thickness": 10.0 + THICKER, "hole": 16.0 + WIDER, "hole place": 2 * MOVED, "flat": 0.0, "square": 0.0,
         "top": 2 * THICKER, "corner": 90.0}  # fmt: skip


def scanned(seed: int, T: np.ndarray | None = None, count: int = 8_000) -> Deviations:
    """A scan of the faulty part under a pose, with noise along the normals."""
    rng = np.random.default_rng(seed)
    cloud = sample_mesh(PART, count, rng)
    surface = MeshSurface(PART)
    points, normals = cloud.points.copy(), PART.face_normals[surface.closest(cloud.points).elements]
    on = np.array([f.number for f in FACES])[_labels(surface, points)]
    points[on == TOP, 2] += THICKER
    hole = FACES[HOLE].feature
    assert hole is not None
    rows = on == HOLE
    radial = (points[rows] - hole.point) * [1, 1, 0]
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    points[rows] = hole.point * [1, 1, 0] + points[rows] * [0, 0, 1] + radial * (8.0 + WIDER / 2) + [MOVED, 0.0, 0.0]
    normals[rows] = radial
    points += rng.normal(0.0, NOISE, (len(points), 1)) * normals
    points = points if T is None else pose.apply(T, points)
    return measure_deviations(points, PART, surface, reach=2.0, noise=NOISE)


def _labels(surface: MeshSurface, points: np.ndarray) -> np.ndarray:
    from dqreg.geometry.mesh_faces import faces_of

    return faces_of(PART)[1][surface.closest(points).elements]


@pytest.mark.parametrize(("kind", "words"), [("position", "under the alignment of the plan"), ("diameter", "has none")])
def test_a_datum_that_would_not_be_heeded_is_refused(kind: str, words: str) -> None:
    row = {"name": "hole", "kind": kind, "face": HOLE, "datum": "A", "tolerance": 0.1}
    with pytest.raises(InputError, match=f"datum goes with parallelism, .*; a {kind} .*{words}.*got 'A': leave it out"):
        plan_of({**PLAN, "characteristic": [row]})


def test_the_plan_finds_the_faults_and_no_others() -> None:
    found = inspect(scanned(1), plan_of(PLAN))
    rows = {row.name: row for row in found.characteristics}
    outcomes = {name: row.outcome for name, row in rows.items()}
    assert outcomes == {"thickness": "pass", "hole": "fail", "hole place": "pass", "flat": "pass", "square": "pass",
                        "top": "fail", "corner": "pass"}  # fmt: skip
    assert found.outcome == "fail"
    assert rows["hole"].nominal == pytest.approx(16.0, abs=1e-6)
    assert (rows["hole"].low, rows["hole"].high) == pytest.approx((15.98, 16.05))
    assert all(row.coverage > 0.8 for row in rows.values())


def within(seed: int) -> list[bool]:
    found = inspect(scanned(seed), plan_of(PLAN)).characteristics
    return [abs(row.value - TRUTH[row.name]) <= row.uncertainty for row in found]


@pytest.mark.parametrize("runs", [3, pytest.param(400, marks=pytest.mark.soak)])
def test_values_lie_within_their_stated_uncertainty(runs: int) -> None:
    # k = 2 promises 95 %; a profile and a form are zones, widened by noise, whose uncertainty covers that.
    inside = np.array([within(s) for s in range(10, 10 + runs)])
    # The chance that of 21 independent values at 95 % more than six lie outside is below 1e-4.
    assert np.count_nonzero(~inside) <= (6 if runs == 3 else 0.08 * inside.size)


def test_a_datum_alignment_takes_the_pose_of_the_scan_out() -> None:
    # 0.03 degrees and 0.2 mm off: the best fit's pose does not matter to what is measured from the datums.
    T = twist.exp(np.array([4e-4, -3e-4, 5e-4, 0.1, -0.2, 0.1]))
    straight, moved = (inspect(scanned(2, turn), plan_of(PLAN)) for turn in (None, T))
    assert moved.alignment is not None
    for one, other in zip(straight.characteristics, moved.characteristics, strict=True):
        # The points that closest faces give to each feature may differ by a few at edges.
        assert other.value == pytest.approx(one.value, abs=max(one.uncertainty, 2e-3))


def test_faces_are_named_by_number_by_the_nearest_place_and_by_a_box() -> None:
    by_box = copy.deepcopy(PLAN)
    whole = [-1, -1, -0.5, 121, 81, 0.5]
    by_box["datum"][0] = {"name": "A", "box": whole}
    by_box["datum"][1] = {"name": "B", "near": [60, 0, 5]}
    by_box["characteristic"][0]["faces"] = [whole, [100, 40, 10]]
    scan = scanned(2)
    for plan in (by_box, one_line := {**PLAN, "characteristic": PLAN["characteristic"][:1]}):
        plan["characteristic"] = plan["characteristic"][:1]
    numbers, names = (inspect(scan, plan_of(plan)).characteristics for plan in (one_line, by_box))
    assert [(row.faces, row.value) for row in numbers] == [(row.faces, row.value) for row in names]
    # A box stands for all faces in it where several may be meant.
    steps = [{"kind": "best-fit", "faces": [BOTTOM, [-1, -1, -0.5, 121, 81, 10.5]], "weights": [2, 1]}]
    boxed = faces_in_box(PART, FACES, [-1, -1, -0.5, 121, 81, 10.5])
    each = [face.number for face in boxed]
    assert BOTTOM in each
    assert SIDE in each
    listed = [{"kind": "best-fit", "faces": each}]
    one, other = (inspect(scan, plan_of({**one_line, "alignment": kind})).alignment for kind in (steps, listed))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.T_target_source, other.T_target_source, atol=1e-12)
    with pytest.raises(InputError, match=r"characteristic 'flat': the box \[.*\] holds faces \d+, .*: make it smaller"):
        inspect(scan, plan_of({"characteristic": [{"name": "flat", "kind": "form", "box": [-1, -1, -1, 200, 200, 200],
                                                   "tolerance": 1}]}))  # fmt: skip
    with pytest.raises(InputError, match=r"no face of the part lies as a whole in the box \[0, 0, 0, 1, 1, 1\]"):
        inspect(scan, plan_of({"characteristic": [{"kind": "form", "box": [0, 0, 0, 1, 1, 1], "tolerance": 1}]}))


def test_an_edge_point_of_a_plan_is_where_the_faults_put_the_edge() -> None:
    rows = [
        {"name": "rim", "kind": "edge-point", "point": [120, 40, 10], "near": [120, 40, 5], "tolerance": 0.1},
        {"name": "end", "kind": "edge-point", "point": [120, 40, 10], "plus": 0.05},
        {"name": "off", "kind": "edge-point", "point": [120, 40, 0], "face": TOP, "tolerance": 1},
    ]
    scan = scanned(4)
    rim, end = inspect(scan, plan_of({**PLAN, "alignment": "best-fit", "characteristic": rows[:2]})).characteristics
    # In the side face the edge is as much higher as the top is; in the top it is where the side is.
    assert rim.faces == (SIDE, TOP)
    assert end.faces == (TOP, SIDE)
    assert abs(rim.value - THICKER) <= rim.uncertainty < 0.03
    assert abs(end.value) <= end.uncertainty < 0.03
    assert (rim.low, rim.high, end.low, end.high) == (-0.1, 0.1, 0.0, 0.05)
    with pytest.raises(InputError, match=f"characteristic 'off': face {TOP} does not end at the edge there"):
        inspect(scan, plan_of({"characteristic": rows[2:]}))
    with pytest.raises(InputError, match="point must be three numbers"):
        plan_of({"characteristic": [{"kind": "edge-point", "face": 1, "tolerance": 1}]})
    with pytest.raises(InputError, match="point is of an edge-point"):
        plan_of({"characteristic": [{"kind": "form", "face": 1, "point": [1, 2, 3], "tolerance": 1}]})


def test_one_face_is_not_two_and_an_edge_is_no_face() -> None:
    scan = scanned(5, count=2_000)

    def refused(**plan: Any) -> str:
        with pytest.raises(InputError) as told:
            inspect(scan, plan_of({"characteristic": PLAN["characteristic"][:1], **plan}))
        return str(told.value)

    same = {"name": "wall", "kind": "distance", "faces": [TOP, [100, 40, 10]], "tolerance": 1}
    assert refused(characteristic=[same]) == f"characteristic 'wall': both faces are face {TOP}: a distance is of two"
    twice = [{"name": "A", "face": BOTTOM}, {"name": "B", "near": [60, 40, 0]}]
    assert refused(datum=twice) == f"datum B: it is face {BOTTOM}, as datum A is: a datum is of a face of its own"
    # Beside the part, the edge of two faces is the nearest place: which one is meant is not known.
    edge = {"name": "rim", "kind": "form", "near": [125, 40, 12], "tolerance": 1}
    told = refused(characteristic=[edge])
    assert told.startswith("characteristic 'rim': [125, 40, 12] is nearest to the edge of faces")
    assert told.endswith(f"{min(TOP, SIDE)} and {max(TOP, SIDE)}: give a place on one of them")


def test_decisions_follow_the_standard() -> None:
    decide = [Measured(1.0, 0.1).decide(*limits) for limits in ((0.8, 1.2), (0.95, 1.2), (1.2, 1.5), (-np.inf, 1.05))]
    assert decide == ["pass", "undecided", "fail", "undecided"]


def test_the_suggested_plan_is_read_and_carried_out(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(suggested_plan(PART), encoding="utf-8")
    plan = read_plan(tmp_path / "plan.toml")
    assert [datum.name for datum in plan.datums] == ["A", "B", "C"]
    kinds = {row.kind for row in inspect(scanned(3), plan).characteristics}
    assert {"form", "perpendicularity", "diameter", "position", "profile"} <= kinds


def changed(path: list[Any], value: Any) -> dict[str, Any]:
    """The plan with one entry changed, or taken out where the value is None."""
    plan = copy.deepcopy(PLAN)
    *way, last = path
    place: Any = plan
    for key in way:
        place = place[key]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return plan


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["characteristic"], [], "nothing to inspect"),
        (["characteristic", 0, "faces"], [3], "of two faces"),
        (["characteristic", 1, "kind"], "diamter", "did you mean diameter"),
        (["characteristic", 1, "kind"], "flatness", 'kind = "form"; got .flatness'),
        (["characteristic", 1, "kind"], "Cylindricity", 'kind = "form"'),
        (["characteristic", 1, "kind"], "circularity", 'kind = "roundness"'),
        (["characteristic", 1, "kind"], "concentricity", 'kind = "coaxiality"'),
        (["characteristic", 1, "kind"], "squareness", 'kind = "perpendicularity"'),
        (["characteristic", 1, "kind"], "profile_of_a_surface", 'kind = "profile"'),
        (["characteristic", 1, "kind"], "radius", "as a diameter, with limits twice as wide"),
        (["characteristic", 1, "kind"], "depth", 'kind = "distance"'),
        (["characteristic", 1, "kind"], "runout", "it is circular-runout, of sections, or total-runout"),
        (["characteristic", 1, "kind"], "Total runout", 'kind = "total-runout"'),
        (["characteristic", 1, "kind"], "symmetry", "symmetry is not measured"),
        # No typing error of length, which shares two letters of three with it.
        (["characteristic", 1, "kind"], "heigth", "got 'heigth'$"),
        (["characteristic", 1, "face"], -1, "face is a number"),
        (["characteristic", 1, "plus"], "wide", "plus must be a number"),
        (["characteristic", 2, "tolerance"], None, "no tolerance is given"),
        (["characteristic", 2, "tolerance"], 0.0, "above 0"),
        (["characteristic", 4, "datum"], "D", "datum must be one of A, B, C"),
        (["characteristic", 4, "near"], [1, 2], "near"),
        (["characteristic", 3, "tolerence"], 1.0, "did you mean tolerance"),
        (["datum", 1, "name"], "A", "datum A is given twice"),
        (["datum", 0, "face"], None, "give face = NUMBER"),
        (["alignment"], "bestfit", "did you mean best-fit"),
        (["datum"], {"name": "A"}, r"\[\[datum\]\]"),
    ],
)
def test_a_wrong_entry_is_named(path: list[Any], value: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan_of(changed(path, value))


def test_a_face_that_was_not_scanned_costs_its_own_lines_only() -> None:
    found = scanned(4, count=2_000)
    rows = found.points[:, 2] < 9.0
    cut = measure_deviations(found.points[rows], PART, MeshSurface(PART), reach=2.0)
    sheet = inspect(cut, plan_of(PLAN))
    missing = {row.name: row for row in sheet.characteristics if not row.measured}
    assert set(missing) == {"thickness", "top"}
    assert missing["thickness"].remark.startswith(f"face {TOP} was not scanned: 0 points")
    assert missing["thickness"].outcome == "undecided"
    assert missing["thickness"].nominal == pytest.approx(10.0, abs=1e-6)
    shares = {face.face: face for face in sheet.faces}
    assert shares[TOP].share == 0.0
    assert shares[TOP].used
    assert shares[BOTTOM].share > 0.95


def test_coverage_is_the_share_of_the_area() -> None:
    found = scanned(5, count=20_000)
    half = measure_deviations(found.points[found.points[:, 0] < 60.0], PART, MeshSurface(PART), reach=2.0)
    shares = {face.face: face.share for face in inspect(half, plan_of(PLAN | {"alignment": "best-fit"})).faces}
    # Of the lower face, 120 x 80 mm with holes symmetric about the middle, half was scanned; the margin of two
    # spacings of 1.6 mm adds 3 %, the sampling 1 %.
    assert 0.48 < shares[BOTTOM] < 0.56


def test_what_the_part_cannot_answer_is_named(tmp_path: Path) -> None:
    found = scanned(4, count=2_000)
    for wrong, words in ((99, "the part has no face 99; its faces are 0 to"), (TOP, "a plane has no diameter")):
        plan = changed(["characteristic", 1, "face"], wrong)
        hole = plan["characteristic"][1]
        with pytest.raises(InputError, match=f"characteristic 'hole': {words}"):
            inspect(found, plan_of({"characteristic": [hole]}))
        # Beside others it costs no line of theirs, and nothing passes.
        whole, part = (inspect(found, plan_of(each)) for each in (PLAN, plan))
        assert part.characteristics[1].remark.startswith(words)
        assert part.characteristics[1].outcome == "undecided"
        left = [0, *range(2, len(part.characteristics))]
        assert [part.characteristics[k] for k in left] == [whole.characteristics[k] for k in left]
        held = inspect(found, plan_of({"tolerance": 1.0, "characteristic": [hole]}))
        assert held.decision is not None
        assert (held.decision.outcome, held.outcome) == ("pass", "undecided")
    assert (
        "datums constrain 5 of six"
        in inspect(found, plan_of(changed(["datum", 2, "face"], TOP))).characteristics[-1].remark
    )
    rows = found.points[:, 2] < 9.0
    cut = measure_deviations(found.points[rows], PART, MeshSurface(PART), reach=2.0)
    told = inspect(cut, plan_of(changed(["datum", 0, "face"], TOP))).characteristics[-1].remark
    assert told.startswith(f"datum A: face {TOP} was not scanned: 0 points")
    with pytest.raises(InputError, match="cannot read the plan"):
        read_plan(tmp_path / "none.toml")
    for text in ("a = [", "a = " + "[" * 5000, "a = " + "9" * 5000, "a = \0"):
        (tmp_path / "bad.toml").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"is no TOML.*dqreg inspect --suggest PART"):
            read_plan(tmp_path / "bad.toml")
    (tmp_path / "bad.toml").write_bytes(b"%PDF-1.4 \xff\xfe")
    with pytest.raises(InputError, match="is no TOML: it holds bytes that are no UTF-8 text"):
        read_plan(tmp_path / "bad.toml")
    with pytest.raises(InputError, match="'foo' is not known; known are units, head, "):
        plan_of({"foo": 1})
    # As editors of Windows save it.
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbftolerance = 0.1")
    assert read_plan(tmp_path / "marked.toml").tolerance == plan_of({"tolerance": 0.1}).tolerance


def test_facets_of_a_hole_are_no_deviation() -> None:
    hole = FACES[HOLE].feature
    assert hole is not None
    turn, height = np.random.default_rng(0).uniform(0.0, 1.0, (2, 2_000)) * [[2.0 * np.pi], [10.0]]
    points = hole.point * [1, 1, 0] + np.column_stack([8.0 * np.cos(turn), 8.0 * np.sin(turn), height])
    scan = measure_deviations(points, PART, MeshSurface(PART), reach=2.0)
    plan = {"characteristic": [{"name": "hole", "kind": "profile", "face": HOLE, "tolerance": 0.01}]}
    (row,) = inspect(scan, plan_of(plan)).characteristics
    # The facets lie up to 8 (1 - cos(pi / 48)) = 0.017 inside: a profile of 0.034 from them.
    assert np.abs(scan.values).max() > 0.015
    assert row.value < 1e-5


def test_tolerances_of_deviations_stand_in_the_plan() -> None:
    found = scanned(1)
    # The upper face is 0.05 thicker, and the hole 0.03 wider on each side and moved by 0.04.
    plain = {"alignment": "best-fit", "tolerance": 0.04, "required": 60}
    alone = inspect(found, plan_of(plain))
    assert alone.decision is not None
    assert {region.number for region in alone.decision.regions if region.outcome == "fail"} >= {TOP, HOLE}
    box = [80, 0, 9.9, 121, 80, 10.1]
    own = [{"face": HOLE, "tolerance": 0.12}, {"near": [100, 40, 10], "plus": 0.1, "minus": 0.02, "required": 90}]
    eased = inspect(found, plan_of({**PLAN, **plain, "face": own, "alignment": "datums"}))
    assert eased.decision is not None
    assert eased.decision.outcome == "pass"
    # Under the datums: by far most of the upper face lies between 0.02 and 0.08.
    assert {r.number: round(r.median, 2) for r in eased.decision.regions}[TOP] == THICKER
    none = inspect(found, plan_of({**plain, "tolerance": 1.0, "face": [{"box": box, "tolerance": 1.0}]}))
    assert none.characteristics[0].name == "face entry 1"
    assert none.characteristics[0].remark.startswith("no face of the part lies as a whole in the box")
    assert none.outcome == "undecided"
