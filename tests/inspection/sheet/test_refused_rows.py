"""What a plan asks for and cannot have: its own row says why, no other row is lost, and nothing passes by it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import Deviations, inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.plan.file import plan_of
from dqreg.report.alignment_table import alignment_of
from dqreg.report.inspection_table import characteristics_table, frame_words, sheet_csv
from dqreg.report.sheet import sheet_of
from dqreg.synth.parts import box

PART = Mesh(*box((30.0, 20.0, 10.0)))
FACES = part_faces(PART)
TOP, BOTTOM, RIGHT, BACK = (
    nearest_face(PART, FACES, p).number for p in ((0, 0, 5.0), (0, 0, -5.0), (15.0, 0, 0), (0, 10.0, 0))
)
HEIGHT = {"name": "height", "kind": "distance", "faces": [BOTTOM, TOP], "tolerance": 0.1}
FLAT = {"name": "flat", "kind": "form", "face": TOP, "tolerance": 0.1}
OVER = {"name": "over", "kind": "profile", "face": TOP, "tolerance": 0.1}
BEYOND = {"name": "beyond", "point": [0, 0, 99], "normal": [0, 0, 1]}
MIDDLE = {"name": "middle", "point": [0, 0, 0], "normal": [0, 1, 0]}
DATUMS = [{"name": n, "face": f} for n, f in zip("ABC", (TOP, BACK, RIGHT), strict=True)]


def scanned(without: int | None = None) -> Deviations:
    """A good part, noise 0.003, perhaps with a face that the scanner did not see."""
    rng = np.random.default_rng(0)
    points = sample_mesh(PART, 6_000, rng).points
    on = np.array([face.number for face in FACES])[part_labels(points)]
    points = points[on != without] + 0.003 * rng.normal(size=(np.count_nonzero(on != without), 3))
    return measure_deviations(points, PART, MeshSurface(PART), reach=2.0)


def part_labels(points: np.ndarray) -> np.ndarray:
    from dqreg.geometry.mesh_faces import faces_of

    return np.asarray(faces_of(PART)[1][MeshSurface(PART).closest(points).elements])


@pytest.mark.parametrize(
    ("entry", "kind", "words"),
    [
        ({"section": [MIDDLE, BEYOND]}, "section", "misses the part"),
        ({"face": [{"face": 99, "tolerance": 0.1}]}, "face", "the part has no face 99"),
        ({"face": [{"face": TOP, "tolerance": 9.0}]}, "face", "is not below the reach"),
    ],
)
def test_an_entry_that_is_refused_costs_no_other_row(entry: dict[str, Any], kind: str, words: str) -> None:
    found = scanned()
    asked = {"tolerance": 0.05, "characteristic": [HEIGHT, FLAT], "section": [MIDDLE]}
    whole, part = (inspect(found, plan_of(each)) for each in (asked, asked | entry))
    assert whole.outcome == "pass"
    assert part.outcome == "undecided"
    *rest, row = part.characteristics
    assert tuple(rest) == whole.characteristics
    assert (row.kind, row.outcome, row.measured) == (kind, "undecided", False)
    assert words in row.remark
    assert [name for name, _ in part.sections] == ["middle"]
    assert part.decision is not None
    assert part.decision.outcome == "pass"
    # On the screen, in the table and on the page it is not measured, with the reason.
    table = characteristics_table(part, "mm")
    assert table.rows[-1][8] == "not measured"
    assert words in str(table.note)
    line = sheet_csv(part, part.decision, "mm").splitlines()[3]
    assert "not measured" in line
    assert words in line
    page = sheet_of(part, "mm", trusted=True)
    assert page is not None
    assert page["said"] == "undecided"
    assert words in page["remarks"][0][2]
    # Of a plan that asks for nothing else it is an error.
    if kind == "face":
        with pytest.raises(InputError, match=f"face entry 1: .*{words}"):
            inspect(found, plan_of(entry))


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ({"datum": DATUMS}, f"datum C: face {RIGHT} was not scanned"),
        ({"alignment": [{"kind": "points", "points": [[15, 0, 0]], "dof": "tx"}]}, "was not scanned"),
        ({"alignment": [{"kind": "minimax", "faces": [RIGHT], "dof": "tx"}]}, "points lie on the chosen faces"),
    ],
)
def test_an_alignment_that_was_not_scanned_costs_what_is_under_it(plan: dict[str, Any], words: str) -> None:
    found = scanned(without=RIGHT)
    asked = {"tolerance": 0.05, "characteristic": [HEIGHT, OVER, FLAT], "section": [MIDDLE], **plan}
    sheet = inspect(found, plan_of(asked))
    height, over, flat, alignment, section = sheet.characteristics
    assert (height.outcome, flat.outcome) == ("pass", "pass")
    assert (alignment.kind, alignment.outcome) == ("alignment", "undecided")
    assert words in alignment.remark
    for row in (over, section):
        assert (row.outcome, row.measured) == ("undecided", False)
        assert "under the alignment of the plan, which was not measured" in row.remark
    # The deviations are those of the registered scan, and held against nothing.
    assert (sheet.outcome, sheet.decision, sheet.alignment, sheet.sections) == ("undecided", None, None, ())
    assert frame_words(sheet) == "best fit of the scan: the alignment of the plan was not measured"
    assert alignment_of(sheet, "mm")["rows"] == []


def test_no_length_of_a_scan_that_was_scaled_to_fit_passes() -> None:
    found = scanned()
    corner = {"name": "corner", "kind": "angle", "faces": [TOP, RIGHT], "tolerance": 0.5}
    wrong = {"name": "wrong", "kind": "distance", "faces": [BOTTOM, TOP], "nominal": 9, "tolerance": 0.1}
    plan = plan_of({"tolerance": 0.05, "characteristic": [HEIGHT, FLAT, OVER, corner, wrong]})
    plain, scaled = inspect(found, plan), inspect(dataclasses.replace(found, scale_solved=True), plan)
    assert [row.outcome for row in plain.characteristics] == ["pass"] * 4 + ["fail"]
    assert [row.outcome for row in scaled.characteristics] == ["undecided"] * 3 + ["pass", "fail"]
    assert [row.value for row in scaled.characteristics] == [row.value for row in plain.characteristics]
    assert plain.decision is not None
    assert scaled.decision is not None
    assert (plain.decision.outcome, scaled.decision.outcome) == ("pass", "undecided")
    assert scaled.decision.codes == ("solved_scale",)
    assert "size of the part was not measured (solved_scale)" in str(characteristics_table(scaled, "mm").note)
    # Angles alone do not prove a part either: nothing of its size was measured.
    angles = plan_of({"characteristic": [corner]})
    assert inspect(dataclasses.replace(found, scale_solved=True), angles).outcome == "undecided"
