"""The table of a batch: rows as they are written, and no file but those of the batch."""

from __future__ import annotations

import json
import os

import pytest

from dqreg.errors import InputError
from dqreg.files.file_digests import digest_of
from dqreg.registration.batch.resume import Folder
from dqreg.studio.many_parts import Many
from dqreg.studio.visit import FaceTolerance


@pytest.fixture
def batch(tmp_path):
    (tmp_path / "out" / "results").mkdir(parents=True)
    for name in ("scan.xyz", "part.stl", "secret.ply"):
        (tmp_path / name).write_text(name)
    return tmp_path


def write(batch, name: str, **inputs) -> None:
    marks = {"scan": digest_of(batch / "scan.xyz"), "target": digest_of(batch / "part.stl")} | inputs
    record = {
        "verdict": {"level": "accepted", "reasons": ["all is well"]},
        "rms": 0.01,
        "inlier_fraction": 0.9,
        "T_target_source": [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]],
        "settings": {"target_units": "mm", "source_units": None},
        "batch": {"name": name, "inputs": marks, "seconds": 1.0, "inspection": {"outcome": "fail", "values": []}},
        "history": [],
    }
    (batch / "out" / "results" / f"{name}.json").write_text(json.dumps(record))


def test_the_table_fills_while_the_batch_runs(batch):
    many = Many(batch / "out")
    assert many.rows() == {"over": False, "rows": [], "total": None}
    write(batch, "one")
    (row,) = many.rows()["rows"]
    assert (row["name"], row["level"], row["outcome"], row["scan"]) == ("one", "accepted", "fail", "scan.xyz")
    (batch / "out" / "results" / "bad.json").write_text("{")
    (batch / "out" / "summary.csv").write_text(
        "name,verdict,reasons,scan,result\n'=lost,timeout,no answer,x.ply,\none,accepted,,x,results/one.json\n"
        "bad,accepted,,x,results/bad.json\n"
    )
    found = many.rows()
    assert found["over"]
    assert {row["name"]: row["level"] for row in found["rows"]} == {
        "one": "accepted",
        "bad": "error",
        "=lost": "timeout",
    }


def test_a_batch_that_is_resumed_is_not_over_and_rows_that_are_gone_do_not_stay(batch):
    many, folder = Many(batch / "out"), Folder(batch / "out")
    write(batch, "one")
    write(batch, "gone")
    summary = batch / "out" / "summary.csv"
    summary.write_text("name,verdict,result\none,accepted,results/one.json\ngone,accepted,results/gone.json\n")
    assert many.rows()["over"]
    os.utime(summary, (1.0, 1.0))
    folder.begin(["one", "two"])
    found = many.rows()
    assert (found["over"], found["total"], [row["name"] for row in found["rows"]]) == (False, 2, ["one"])
    summary.write_text("name,verdict,result\none,accepted,results/one.json\ntwo,error,\n")
    found = many.rows()
    assert found["over"]
    assert [(row["name"], row["level"]) for row in found["rows"]] == [("one", "accepted"), ("two", "error")]


def test_a_result_that_vanishes_or_is_none_is_no_mistake(batch):
    many = Many(batch / "out")
    results = batch / "out" / "results"
    write(batch, "one")
    (results / "gone.json").symlink_to(results / "nowhere")
    (results / "list.json").write_text("[]")
    (results / "deep.json").write_text("[" * 100_000)
    levels = {row["name"]: row["level"] for row in many.rows()["rows"]}
    assert levels == {"one": "accepted", "list": "error", "deep": "error"}
    for name in ("gone", "list", "deep"):
        with pytest.raises(InputError, match=name):
            many.visit(name)


def test_a_row_opens_its_own_files_and_no_others(batch):
    many = Many(batch / "out")
    write(batch, "one")
    visit = many.visit("one")
    assert (visit.scan.name, visit.part.units, visit.start) == ("scan.xyz", "mm", "rival")
    # A result that names a file that the batch has not read, or that has changed since, opens nothing.
    write(batch, "two", scan=[str(batch / "secret.ply"), 10, "0" * 64])
    (batch / "scan.xyz").write_text("changed")
    for name in ("one", "two"):
        with pytest.raises(InputError, match="has changed"):
            many.visit(name)
    for name in ("none", "../../part", ""):
        with pytest.raises(InputError, match="no row"):
            many.visit(name)


def test_a_row_opens_with_the_plan_of_the_batch(batch):
    many, plan = Many(batch / "out"), batch / "plan.toml"
    plan.write_text('tolerance = 0.2\nrequired = 99\n[head]\npart = "p"\n[[face]]\nface = 2\ntolerance = 0.1\n')
    asked = {
        "plan": digest_of(plan),
        "tolerance": None,
        "required_share": 0.9,
        "report": False,
        "head": {"serial": "7", "order": "A-12"},
    }
    write(batch, "one", inspection=asked)
    visit = many.visit("one")
    assert (visit.tolerance, visit.required, visit.faces) == (0.2, 90.0, (FaceTolerance(2, 0.1),))
    assert visit.head == (("part", "p"), ("serial", "7"), ("order", "A-12"))
    # The tolerance of the command wins over the plan's.
    write(batch, "one", inspection=asked | {"tolerance": 0.5})
    assert many.visit("one").tolerance == 0.5
    write(batch, "one", inspection=asked | {"tolerance": [-0.05, 0.2]})
    assert (many.visit("one").tolerance, many.visit("one").minus) == (0.2, 0.05)
    write(batch, "one", inspection=asked | {"plan": None})
    assert many.visit("one").tolerance is None
    write(batch, "one", inspection={"plan": 5})
    with pytest.raises(InputError, match="cannot be read"):
        many.visit("one")
    plan.write_text("tolerance = 9")
    write(batch, "one", inspection=asked)
    with pytest.raises(InputError, match=r"plan\.toml has changed"):
        many.visit("one")


def test_a_folder_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="dqreg batch"):
        Many(tmp_path / "none")
