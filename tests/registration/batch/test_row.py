from __future__ import annotations

import dataclasses
import importlib
import os
from pathlib import Path

import numpy as np
import pytest

from dqreg.inspection import Tolerance
from dqreg.registration.batch import RowInspection, read_manifest
from dqreg.registration.batch.row import Targets, inputs_of, run_row
from dqreg.registration.register import register
from dqreg.registration.result.part_inspection import require_record
from tests.registration.batch.scenes import make_scene

# The package has a function of the same name.
ROOM = importlib.import_module("dqreg.registration.register")
PREPARED = importlib.import_module("dqreg.registration.target")


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "scene", 2)


@pytest.fixture
def rows(scene):
    return read_manifest(scene.manifest)


def test_a_row_is_a_registration(rows, tmp_path):
    row = rows[0]
    done = run_row(row, Targets())
    alone = register(row.scan, row.target, "identity", effort="fast")
    # The same code on the same files: the same bits.
    assert done.record["T_target_source"] == alone.T_target_source.tolist()
    assert done.record["batch"]["inputs"] == inputs_of(row)
    assert done.record["settings"]["source"] == os.fspath(row.scan)
    assert (done.status, done.message, done.thumbnail) == ("ran", "", None)


@pytest.mark.usefixtures("small_pictures")
def test_a_part_is_inspected_and_what_cannot_be_measured_costs_no_pose(rows, tmp_path):
    # Noise of 1e-4 of a part of 156 mm, drawn on its own surface: within 0.2 mm, and not within 0.001 mm.
    outcomes = {}
    for tolerance in (0.2, 0.001):
        done = run_row(dataclasses.replace(rows[0], asked=RowInspection(tolerance=tolerance)), Targets())
        require_record(done.record["batch"]["inspection"])
        assert all(0.0 < number <= 1.0 for number in done.record["batch"]["inspection"]["figures"].values())
        outcomes[tolerance] = done.record["batch"]["inspection"]["outcome"]
        assert done.page is None
    assert outcomes == {0.2: "pass", 0.001: "fail"}
    # Deviations are about +-0.03 mm: nothing below the surface is allowed.
    done = run_row(
        dataclasses.replace(rows[0], asked=RowInspection(tolerance=Tolerance(0.0, 0.2), report=True)), Targets()
    )
    assert done.record["batch"]["inspection"]["outcome"] == "fail"
    assert "Part against +0.2/0" in done.page
    datum, row = '[[datum]]\nname = "A"\nface = 0\n', '[[characteristic]]\nkind = "form"\nface = 0\ntolerance = 1\n'
    (tmp_path / "plan.toml").write_text(datum + row)
    done = run_row(dataclasses.replace(rows[0], asked=RowInspection(plan=tmp_path / "plan.toml")), Targets())
    found = done.record["batch"]["inspection"]
    assert (done.status, found["outcome"]) == ("ran", "undecided")
    # The form is the face's own; the alignment is named as what was not measured.
    assert [(value["kind"], value["outcome"]) for value in found["values"]] == [
        ("form", "pass"),
        ("alignment", "undecided"),
    ]
    assert "datums constrain" in found["values"][1]["remark"]


def test_a_plan_requires_in_a_batch_what_it_requires_alone(rows, tmp_path):
    (tmp_path / "plan.toml").write_text("tolerance = 0.05\nrequired = 80\n")
    required = []
    for share in (None, 0.99):
        asked = RowInspection(plan=tmp_path / "plan.toml", required_share=share)
        found = run_row(dataclasses.replace(rows[0], asked=asked), Targets()).record["batch"]["inspection"]
        required += [row["low"] for row in found["values"] if row["name"].startswith("points within")]
    assert required == [80.0, 99.0]


def test_a_row_is_shown_in_another_unit_and_its_result_stays_in_the_part_s(rows):
    row = dataclasses.replace(rows[0], options={**rows[0].options, "source_units": "mm", "target_units": "mm"})
    plain = run_row(row, Targets()).record
    asked = RowInspection(tolerance=0.2 / 25.4, display_units="inch")
    shown = run_row(dataclasses.replace(row, asked=asked), Targets()).record
    assert shown["settings"]["target_units"] == "mm"
    # Rounding in another unit: within 1e-9 of the part's 156 mm.
    np.testing.assert_allclose(shown["T_target_source"], plain["T_target_source"], atol=1.5e-7)
    assert shown["batch"]["shown"]["units"] == shown["batch"]["inspection"]["units"] == "inch"
    assert shown["batch"]["shown"]["rms"] == pytest.approx(plain["rms"] / 25.4, rel=1e-6)
    assert shown["batch"]["inspection"]["outcome"] == "pass"


def test_the_tolerance_of_a_plan_is_shown_in_the_unit_that_is_asked_for(rows, tmp_path):
    """The plan's unit is also that of a part whose file does not say."""
    (tmp_path / "plan.toml").write_text('units = "mm"\ntolerance = 0.2\n')
    asked = RowInspection(plan=tmp_path / "plan.toml", display_units="inch")
    found = run_row(dataclasses.replace(rows[0], asked=asked), Targets())
    assert (found.status, found.message) == ("ran", "")
    inspection = found.record["batch"]["inspection"]
    assert (inspection["units"], inspection["outcome"]) == ("inch", "pass")
    face = next(row for row in inspection["values"] if row["name"].endswith("median deviation"))
    assert face["high"] == pytest.approx(0.2 / 25.4)


def rewrite(path: Path) -> None:
    """Other content that means the same."""
    path.write_bytes(path.read_bytes() + b"\n")


def test_a_part_is_prepared_once_and_anew_when_it_changes(rows):
    targets = Targets(kept=1)
    first = targets.shown(rows[0].target)[0]
    assert targets.shown(rows[0].target)[0] is first
    os.utime(rows[0].target, ns=(1, 1))
    assert targets.shown(rows[0].target)[0] is first
    rewrite(rows[0].target)
    second = targets.shown(rows[0].target)[0]
    assert second is not first
    targets.shown(rows[1].target)
    assert targets.shown(rows[0].target)[0] is not second


@pytest.mark.parametrize("column", ["scan", "target"])
def test_a_file_that_changes_while_it_is_read_is_no_result(rows, monkeypatch, column):
    path = getattr(rows[0], column)

    def touching(*arguments, **options):
        result = register(*arguments, **options)
        rewrite(path)
        return result

    monkeypatch.setattr(ROOM, "register", touching)
    done = run_row(rows[0], Targets())
    assert done.status == "error"
    assert "changed while it was read" in done.message
    assert done.record is None


def test_a_part_that_changes_while_it_is_read_is_not_kept(rows, monkeypatch):
    real, seen = PREPARED.prepare_target, []

    def slow(path: Path):
        seen.append(path)
        prepared = real(path)
        if len(seen) == 1:
            rewrite(path)
        return prepared

    monkeypatch.setattr(PREPARED, "prepare_target", slow)
    targets = Targets()
    assert run_row(rows[0], targets).status == "error"
    assert run_row(rows[0], targets).status == "ran"
    assert len(seen) == 2


def test_what_goes_wrong_is_a_message(rows, scene):
    np.save(scene.folder / "line.npy", np.outer(np.arange(50.0), [1.0, 2.0, 3.0]))
    cases = {
        "damaged": (b"\x93NUMPY junk", "scan0.npy"),
        "line": (None, "line"),
        "gone": (None, "gone.npy"),
    }
    for name, (content, said) in cases.items():
        path = rows[0].scan if content else scene.folder / f"{name}.npy"
        if content:
            path.write_bytes(content)
        done = run_row(dataclasses.replace(rows[0], scan=path), Targets())
        assert done.status == "error"
        assert said in done.message
        assert "\n" not in done.message


def test_unexpected_errors_and_lost_memory_cost_the_row_alone(rows, monkeypatch):
    for error, said in ((ZeroDivisionError("x"), "ZeroDivisionError: x"), (MemoryError(), "out of memory")):

        def fail(*_, error=error, **__):
            raise error

        monkeypatch.setattr(ROOM, "register", fail)
        assert run_row(rows[0], Targets()).message == said


def test_inputs_name_everything_that_matters(rows, tmp_path):
    base = inputs_of(rows[0])
    np.savetxt(tmp_path / "start.txt", np.eye(4))
    others = [
        dataclasses.replace(rows[0], scan=rows[1].scan),
        dataclasses.replace(rows[0], target=rows[1].target),
        dataclasses.replace(rows[0], start="none"),
        dataclasses.replace(rows[0], start=str(tmp_path / "start.txt")),
        dataclasses.replace(rows[0], options={"effort": "best"}),
    ]
    assert all(inputs_of(other) != base for other in others)
    assert inputs_of(dataclasses.replace(rows[0], line=9)) == base
    with rows[0].scan.open("ab") as stream:
        stream.write(b"x")
    assert inputs_of(rows[0]) != base
