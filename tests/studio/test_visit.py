"""The value that a visit is: written, read back, refused where it is wrong."""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from pathlib import Path

import pytest

import dqreg.studio
from dqreg.errors import InputError
from dqreg.inspection import read_plan
from dqreg.inspection.plan.alignment import PlannedStep
from dqreg.inspection.plan.file import HEAD, plan_of
from dqreg.inspection.tolerances import Tolerance
from dqreg.studio.equivalent_commands import commands_of
from dqreg.studio.plans import plan_text, with_plan
from dqreg.studio.visit import Cut, FaceTolerance, Pair, PlaneCut, Reference, Side, Visit

FULL = Visit(
    scan=Side("a scan.ply", "scan/a scan.ply", "mm"),
    part=Side("part.stl", "part/part.stl"),
    cuts=(
        Cut("box", True, low=(0.0, 0.0, 0.0), high=(1.0, 2.0, 3.0)),
        Cut("lasso", polygon=((0.0, 0.0), (1.0, 0.0), (0.5, 1.0))),
        Cut("plane", normal=(0.0, 0.0, 1.0), offset=0.5, half=0.01),
    ),
    start="pairs",
    pairs=(Pair((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 2.0),),
    dof="rz tx",
    datums=(3, 1, 2),
    tolerance=0.1,
    required=99.5,
    faces=(FaceTolerance(4, 0.05), FaceTolerance(2, 0.1, 0.02)),
    sections=(PlaneCut((1.0, 2.0, 3.0), (0.0, 1.0, 0.0)),),
    head=(("serial", 'A "7" \\ <b>'),),
)


def test_what_is_written_is_what_is_read(tmp_path):
    FULL.save(tmp_path / "visit.json")
    assert Visit.load(tmp_path / "visit.json") == dataclasses.replace(
        FULL,
        scan=dataclasses.replace(FULL.scan, path=str(tmp_path / "a scan.ply")),
        part=dataclasses.replace(FULL.part, path=str(tmp_path / "part.stl")),
    )
    assert len(FULL.as_text()) < 4000


@pytest.mark.parametrize(
    "values",
    [
        {"tolerance": -1.0},
        {"tolerance": float("nan")},
        {"required": 0.0},
        {"start": "anywhere"},
        {"cuts": [{"kind": "sphere"}]},
        {"cuts": [{"kind": "lasso", "polygon": [[0.0, 0.0]] * 3000}]},
        {"pairs": [{"scan": [0, 0], "part": [0, 0, 0]}]},
        {"pairs": [{"scan": [0, 0, 0], "part": [0, 0, 0], "weight": 0}]},
        {"datums": [1, 1]},
        {"faces": [{"face": -1, "tolerance": 0.1}]},
        {"faces": [{"face": 1, "tolerance": 0.0, "minus": 0.0}]},
        {"faces": [{"face": 1, "tolerance": 0.1, "minus": -0.1}]},
        {"tolerance": None, "minus": 0.1},
        {"chosen": [1], "weights": [1.0, 2.0]},
        {"chosen": [1], "weights": [0.0]},
        {"sections": [{"point": [0, 0, 0], "normal": [0, 0, 0]}]},
        {"T_start": [[1, 0], [0, 1]]},
        {"head": [["logo", "x"]]},
        {"head": [["note", "x" * 500]]},
        {"scan": {"name": "x", "path": "/etc/passwd"}},
        {"unknown": 1},
    ],
)
def test_wrong_values_are_refused_by_name(values):
    with pytest.raises(InputError):
        Visit().changed(values)


def test_a_file_that_is_no_visit_is_refused(tmp_path):
    for text in ("{}", "[1]", "[" * 200_000):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(InputError, match=r"no (readable )?saved visit"):
            Visit.load(tmp_path / "x.json")
    # Windows' editors put a mark first.
    (tmp_path / "x.json").write_text("\ufeff" + FULL.as_text(), encoding="utf-8")
    assert Visit.load(tmp_path / "x.json").tolerance == FULL.tolerance
    with pytest.raises(InputError, match="cannot read"):
        Visit.load(tmp_path / "none.json")


def test_the_plan_is_one_that_inspect_reads(tmp_path):
    visit = dataclasses.replace(FULL, alignment="datums")
    (tmp_path / "plan.toml").write_text(plan_text(visit), encoding="utf-8")
    plan = read_plan(tmp_path / "plan.toml")
    assert plan.head == {"serial": 'A "7" \\ <b>'}
    assert [datum.face for datum in plan.datums] == [3, 1, 2]
    assert plan.tolerance == Tolerance(-0.1, 0.1, 0.995)
    limits = {row.faces: (row.tolerance.low, row.tolerance.high) for row in plan.face_tolerances}
    assert limits == {(4,): (-0.05, 0.05), (2,): (-0.02, 0.1)}
    assert [(cut.point, cut.normal) for cut in plan.sections] == [((1.0, 2.0, 3.0), (0.0, 1.0, 0.0))]


@pytest.mark.parametrize(
    ("chosen", "step"),
    [
        (
            {"alignment": "faces", "chosen": (7, 3), "weights": (2.0,), "goal": "tolerance", "minus": 0.0},
            PlannedStep("chosen faces", "tolerance", (7, 3), (2.0, 1.0), (-0.0, 0.1)),
        ),
        (
            {"alignment": "points", "references": (Reference((1.0, 2.0, 3.0), (0.0, 0.0, 1.0)),) * 6},
            PlannedStep("reference points", "points", points=((1.0, 2.0, 3.0, 0.0, 0.0, 1.0),) * 6),
        ),
    ],
)
def test_the_plan_says_what_the_judgement_rests_on(tmp_path, chosen, step):
    (tmp_path / "plan.toml").write_text(plan_text(dataclasses.replace(FULL, **chosen)), encoding="utf-8")
    plan = read_plan(tmp_path / "plan.toml")
    assert plan.alignment == "steps"
    assert plan.steps == (step,)


PLAN = """units = "mm"
plus = 0.2
minus = 0.1
required = 99.0

[head]
serial = "7"
order = "an order"
lot = "a lot"

[[datum]]
name = "A"
face = 3
[[datum]]
name = "B"
near = [1, 2, 3]

[[face]]
face = 2
tolerance = 0.05

[[section]]
name = "through the hole"
point = [1, 2, 3.5]
normal = [0, 1, 0]

[[characteristic]]
name = "flat \\"A\\" ü"
kind = "form"
face = 3
tolerance = 0.1
"""


WHOLE = "tolerance = 1\nrequired = 95\n[[alignment]]\n"


@pytest.mark.parametrize(
    "text",
    [
        PLAN,
        PLAN.replace("near = [1, 2, 3]", "face = 7"),
        PLAN.replace("units", 'alignment = "best-fit"\nunits'),
        PLAN.replace("through the hole", "section 1").replace("face = 2", "near = [0, 0, 0]"),
        "[[face]]\nfaces = [3, 4]\ntolerance = 1\n",
        WHOLE + 'name = "chosen faces"\nkind = "minimax"\nfaces = [1, 2]\nweights = [1, 2.5]\n',
        WHOLE + 'kind = "points"\npoints = [[0, 0, 0], [1, 0, 0, 0, 0, 1]]\n',
        WHOLE + 'name = "x"\nkind = "outside"\ndof = "tz"\n[[alignment]]\nkind = "inside"\n',
    ],
)
def test_a_plan_comes_back_as_it_was(text):
    visit = with_plan(FULL, text)
    again = plan_of(tomllib.loads(plan_text(visit)))
    given = plan_of(tomllib.loads(text))
    assert dataclasses.replace(again, units=None) == dataclasses.replace(given, units=None)
    assert with_plan(visit, plan_text(visit)) == visit
    assert visit.cuts == FULL.cuts


def test_a_plan_is_shown_where_the_page_can():
    visit = with_plan(FULL, PLAN)
    assert (visit.tolerance, visit.minus, visit.required) == (0.2, 0.1, 99.0)
    assert (visit.faces, visit.alignment) == ((FaceTolerance(2, 0.05),), "plan")
    assert visit.head == (("serial", "7"), ("order", "an order"))
    # A field that the page does not know stays in the plan.
    assert tomllib.loads(visit.plan)["head"] == {"lot": "a lot"}
    # What is chosen on the page wins over the plan.
    chosen = dataclasses.replace(visit, alignment="datums", datums=(5, 6), tolerance=0.3)
    plan = plan_of(tomllib.loads(plan_text(chosen)))
    assert [datum.face for datum in plan.datums] == [5, 6]
    assert plan.tolerance == Tolerance(-0.1, 0.3, 0.99)
    assert [row.name for row in plan.characteristics] == ['flat "A" ü']


@pytest.mark.parametrize("text", ["x =", "tolerance = -1", "[[characteristic]]", "x" * (1 << 19), "a = " + "[" * 5000])
def test_a_plan_that_is_none_is_refused(text):
    with pytest.raises(InputError):
        with_plan(FULL, text)


def test_a_mirrored_scan_forgets_what_was_pointed_at():
    visit = FULL.changed({"mirrored": True})
    assert (visit.cuts, visit.pairs, visit.start) == ((), (), "none")
    assert (visit.tolerance, visit.faces) == (FULL.tolerance, FULL.faces)
    assert "a scan_cleaned.ply" in commands_of(visit)["align"]["command"]


def test_every_step_has_words_that_parse():
    import ast

    words = commands_of(FULL)
    assert list(words) == ["load", "clean", "align", "judge", "report"]
    for step in words.values():
        ast.parse(step["python"])
    assert "--dof" in words["align"]["command"]
    assert "'a scan.ply'" in words["load"]["command"]
    assert json.dumps(words)


def test_the_page_asks_for_the_fields_of_a_head():
    script = (Path(dqreg.studio.__file__).parent / "page" / "report.js").read_text(encoding="utf-8")
    (fields,) = re.findall(r"const HEAD = \{(.*)\};", script)
    assert tuple(re.findall(r"(\w+):", fields)) == HEAD
