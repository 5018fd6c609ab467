from __future__ import annotations

import csv
import dataclasses
import io
import math
from pathlib import Path

import numpy as np
import pytest

from dqreg.registration.batch.line import Line, line_of
from dqreg.registration.batch.row import Row, RowResult
from dqreg.registration.batch.row_inspection import RowInspection
from dqreg.registration.batch.summary import to_html
from dqreg.registration.batch.trends import Trend, trend_records, trends_csv, trends_of, trends_on_page, values_csv
from dqreg.registration.result.part_inspection import require_record
from dqreg.report.control_chart import Sample
from dqreg.trust.records import Reason

VALUES = (10.01, 10.02, 10.00, 10.03)


def line(number: int, value: float | None, level: str = "accepted", **changes):
    record = {
        "verdict": {"level": level, "reasons": []},
        "rms": 0.1,
        "inlier_fraction": 0.5,
        "T_target_source": np.eye(4).tolist(),
        "dual_quaternion": {"real": [1.0, 0.0, 0.0, 0.0], "dual": [0.0, 0.0, 0.0, 0.0]},
        "batch": {"seconds": 2.5},
    }
    row = {"name": "width <b>", "kind": "distance", "nominal": 10.0, "low": 9.9, "high": 10.1, "value": value,
           "uncertainty": 0.01, "outcome": "pass", "remark": "" if value else "not scanned", **changes}  # fmt: skip
    record["batch"]["inspection"] = {"outcome": "pass", "units": "mm", "values": [row]}
    asked = RowInspection(plan=Path("p.toml"), report=True)
    return line_of(Row(f"part {number}", Path("s.ply"), Path("p.stl"), asked=asked), RowResult("ran", "", record))


LINES = [line(k, value) for k, value in enumerate((*VALUES, None))]


def test_figures_are_those_of_the_textbook() -> None:
    (trend,) = trends_of(LINES)
    mean, spread = np.mean(VALUES), np.std(VALUES, ddof=1)
    assert (trend.mean, trend.spread) == pytest.approx((mean, spread))
    assert trend.cp == pytest.approx(0.2 / (6 * spread))
    assert trend.cpk == pytest.approx((10.1 - mean) / (3 * spread))
    # Individuals chart: mean +- 2.66 mean moving ranges of 0.01, 0.02, 0.03.
    assert trend.control == pytest.approx((mean - 2.66 * 0.02, mean + 2.66 * 0.02), rel=1e-4)
    assert trend.unmeasured == 1


def test_a_zone_has_one_limit_and_equal_values_no_spread() -> None:
    (zone,) = trends_of([line(k, 0.02, kind="position", nominal=0.0, low=0.0, high=0.1) for k in range(3)])
    assert math.isnan(zone.cp)
    assert zone.cpk == math.inf
    alone = dataclasses.replace(zone, samples=zone.samples[:1])
    assert math.isnan(alone.spread)
    assert math.isnan(alone.cpk)


def test_a_value_whose_lower_limit_is_its_nominal_of_nothing_has_two_limits() -> None:
    edge = {"kind": "edge-point", "nominal": 0.0, "low": 0.0, "high": 0.2, "outcome": "fail"}
    (trend,) = trends_of([line(k, value, **edge) for k, value in enumerate((-0.11, -0.10, -0.09))])
    assert (trend.cp, trend.cpk) == pytest.approx((0.2 / 0.06, -0.1 / 0.03))


def test_values_with_other_limits_are_another_trend() -> None:
    assert len(trends_of([*LINES, line(7, 1.0, high=11.0), line(8, 1.0, high=11.0), line(9, 1.0, high=12.0)])) == 2


def moved(found: Line, target: str, plan: str = "p.toml") -> Line:
    asked = dataclasses.replace(found.row.asked, plan=Path(plan))
    return dataclasses.replace(found, row=dataclasses.replace(found.row, target=Path(target), asked=asked))


def test_values_of_other_units_parts_and_plans_are_other_trends() -> None:
    inch = [dataclasses.replace(each, inspection={**each.inspection, "units": "inch"}) for each in LINES]
    assert [(each.unit, each.parts) for each in trends_of([*LINES, *inch])] == [("mm", 5), ("inch", 5)]
    others = [moved(each, "other.stl") for each in LINES] + [moved(each, "other.stl", "q.toml") for each in LINES]
    found = trends_of([*LINES, *others])
    assert [each.target for each in found] == ["p.stl", "other.stl by p.toml", "other.stl by q.toml"]
    assert {each.parts for each in found} == {5}
    assert [row["target"] for row in csv.DictReader(io.StringIO(trends_csv(found)))] == [each.target for each in found]
    assert to_html("t", [*LINES, *others]).count("other.stl by q.toml") == 2
    (low, high) = trends_of([moved(each, f"{folder}/p.stl") for folder in "ab" for each in LINES])
    assert (low.target, high.target) == ("a/p.stl", "b/p.stl")


def test_values_of_equal_names_in_a_plan_are_told_by_their_numbers() -> None:
    def twice(found: Line) -> Line:
        return dataclasses.replace(found, inspection={**found.inspection, "values": found.inspection["values"] * 2})

    found = trends_of([twice(each) for each in LINES])
    assert [(each.number, each.parts) for each in found] == [(1, 5), (2, 5)]


def test_thickness_of_a_tapered_wall_is_followed_from_its_nominal_value_at_the_worst_place() -> None:
    def wall(k: int, nominal: float, value: float, outcome: str = "pass", level: str = "accepted"):
        limits = {"nominal": nominal, "low": nominal - 0.1, "high": nominal + 0.3}
        return line(k, value, level, kind="thickness", name="wall", outcome=outcome, **limits)

    unseen = line(4, None, kind="thickness", name="wall", nominal=None, low=None, high=None, outcome="undecided")
    tapered = [unseen, wall(0, 8.0, 8.1), wall(1, 11.7, 11.9), wall(2, 9.3, 9.6)]
    (trend,) = trends_of(tapered)
    assert (trend.name, trend.unmeasured) == ("wall, from its nominal value", 1)
    assert (trend.low, trend.high) == (-0.1, 0.3)
    assert trend.values == pytest.approx([0.1, 0.2, 0.3])
    (held,) = trends_of([*tapered, wall(5, 8.0, 9.0, "fail", "suspect")])
    assert held.left_out[0].value == pytest.approx(1.0)
    (even,) = trends_of([unseen, wall(0, 8.0, 8.1), wall(1, 8.0, 8.2)])
    assert (even.name, even.low, even.parts) == ("wall", 7.9, 3)


def test_medians_of_a_face_are_one_trend_whatever_other_faces_a_part_shows() -> None:
    def after(found: Line) -> Line:
        unlike = {**found.inspection["values"][0], "name": "face 1"}
        return dataclasses.replace(
            found, inspection={**found.inspection, "values": [unlike, *found.inspection["values"]]}
        )

    faces = [line(k, 10.0, kind="deviation") for k in range(2)]
    (trend,) = trends_of([faces[0], after(faces[1])])
    assert trend.parts == 2


def test_parts_whose_alignment_is_not_trusted_change_no_trend() -> None:
    lines = [*LINES, line(7, 12.0, "suspect"), line(8, 14.0, "failed")]
    ((trend,), (known,)) = trends_of(lines), trends_of(LINES)
    assert (trend.samples, trend.mean, trend.spread) == (known.samples, known.mean, known.spread)
    assert "12.0" in values_csv(lines)


def test_files_and_page_hold_every_value_and_lead_to_its_part() -> None:
    rows = list(csv.DictReader(io.StringIO(values_csv(LINES))))
    assert [row["value"] for row in rows] == [*map(str, VALUES), ""]
    assert {(row["verdict"], row["unit"]) for row in rows} == {("accepted", "mm")}
    (trend,) = csv.DictReader(io.StringIO(trends_csv(trends_of(LINES))))
    assert (float(trend["mean"]), trend["parts"], trend["pass"]) == (pytest.approx(np.mean(VALUES)), "4", "4")
    page = to_html("t", LINES)
    assert page.count('<a href="reports/part%201.html">') == 2
    assert "width <b>" not in page


@pytest.mark.parametrize(("kind", "unit"), [("share", "%"), ("angle", "degree"), ("deviation", "mm")])
def test_what_is_no_length_has_its_own_unit(kind: str, unit: str) -> None:
    lines = [line(k, value, kind=kind) for k, value in enumerate(VALUES)]
    assert {row["unit"] for row in csv.DictReader(io.StringIO(values_csv(lines)))} == {unit}
    assert [trend.unit for trend in trends_of(lines)] == [unit]


def test_a_changed_file_is_no_record() -> None:
    good = LINES[0].inspection
    require_record(good)
    for name, value in (("value", "x"), ("name", 3), ("outcome", None)):
        bad = {**good, "values": [{**good["values"][0], name: value}]}
        with pytest.raises((TypeError, ValueError, KeyError)):
            require_record(bad)
    with pytest.raises(ValueError, match="no outcome"):
        require_record({**good, "outcome": "fine"})
    for figures in ([], {"p95": "wide"}):
        with pytest.raises(TypeError):
            require_record({**good, "figures": figures})


def test_a_trend_of_nothing_is_nan() -> None:
    assert math.isnan(Trend(1, "a", "", math.nan, math.nan, False, (), 2).mean)
    assert math.isnan(Trend(1, "a", "", math.nan, math.nan, False, (Sample("a", "", 1.0, 1.0, "pass"),) * 2, 0).cpk)


def test_figures_on_the_page_have_the_digits_that_spread_and_uncertainty_leave() -> None:
    (shown,) = trends_on_page(trends_of(LINES))
    low, high, mean, spread, cp, cpk = shown["figures"]
    decimals = len(mean.partition(".")[2])
    assert float(mean) == pytest.approx(np.mean(VALUES), abs=0.5 * 10.0**-decimals)
    assert len(spread.partition(".")[2]) == decimals <= 4
    assert not any("e" in each for each in (low, high, mean, spread, cp, cpk))
    (wide,) = trends_on_page(trends_of([line(k, 10.0 + 1e-7 * k) for k in range(3)]))
    assert wide["figures"][4:] == ["> 100", "> 100"]


def left_out(number: int, value: float | None, codes: list[str], level: str = "suspect", **changes):
    found = line(number, value, level, **changes)
    return dataclasses.replace(found, reasons=tuple(Reason(f"because of {code}", code) for code in codes))


def test_where_the_shape_of_a_part_may_be_why_it_is_left_out_no_capability_is_told() -> None:
    lines = [
        *LINES,
        left_out(7, 12.0, ["stretched"], outcome="fail"),
        left_out(8, 10.05, ["alternative_poses", "bent"]),
    ]
    (trend,) = trends_of(lines)
    assert (len(trend.samples), trend.unmeasured, len(trend.left_out), trend.parts) == (4, 1, 2, 7)
    assert all(math.isnan(x) for x in (trend.cp, trend.cpk, *trend.control))
    assert trend.mean == pytest.approx(np.mean(VALUES))
    assert "2 of 7 parts" in trend.withheld
    (row,) = csv.DictReader(io.StringIO(trends_csv((trend,))))
    assert (row["cp"], row["cpk"], row["parts"], row["unmeasured"], row["left_out"]) == ("", "", "4", "1", "2")
    assert "part 7: suspect, stretched, 12 (fail)" in row["left_out_parts"]
    assert row["remark"] == trend.withheld
    page = to_html("t", lines)
    assert "2 left out" in page
    assert "part 8: suspect, alternative_poses, bent, 10.05 (pass)" in page
    assert page.count('class="gap"') == 2
    (record,) = trend_records((trend,))
    assert [each["may_be_its_shape"] for each in record["left_out"]] == [True, True]


def test_parts_without_a_pose_or_badly_scanned_are_counted_and_leave_the_capability() -> None:
    scanned = left_out(7, 10.05, ["alternative_poses"])
    none = dataclasses.replace(left_out(8, None, ["no_correspondences"], "failed"), inspection={"values": []})
    (trend,), (known,) = trends_of([scanned, *LINES, none]), trends_of(LINES)
    assert (trend.cpk, trend.control, trend.withheld) == (known.cpk, known.control, "")
    assert [each.before for each in trend.left_out] == [0, 4]
    # A value out of its limits may be a reject under the right pose too.
    (failing,) = trends_of([left_out(7, 12.0, ["alternative_poses"], outcome="fail"), *LINES])
    assert math.isnan(failing.cpk)


def test_a_lot_of_which_no_part_is_trusted_is_shown() -> None:
    (trend,) = trends_of([left_out(k, 10.0 + k, ["stretched"]) for k in range(3)])
    assert (len(trend.samples), len(trend.left_out)) == (0, 3)
    assert "3 left out" in to_html("t", [left_out(k, 10.0 + k, ["stretched"]) for k in range(3)])


def test_copies_of_one_drawing_are_one_drawing(tmp_path: Path) -> None:
    lines = []
    for k, value in enumerate(VALUES):
        # Each part has a folder of its own with the part's file and the plan in it; the last has another part.
        folder = tmp_path / str(k)
        folder.mkdir()
        (folder / "p.stl").write_bytes(b"other" if k == 3 else b"part")
        (folder / "p.toml").write_bytes(b"plan")
        of = line(k, value)
        asked = dataclasses.replace(of.row.asked, plan=folder / "p.toml")
        lines.append(dataclasses.replace(of, row=dataclasses.replace(of.row, target=folder / "p.stl", asked=asked)))
    (trend,) = trends_of(lines)
    assert [sample.value for sample in trend.samples] == list(VALUES[:3])
    # What was read counts, not what is there by now.
    (tmp_path / "3" / "p.stl").write_bytes(b"part")
    read = dataclasses.replace(lines[3], inputs={"target": ["p.stl", 5, "digest"]})
    assert len(trends_of([*lines[:3], read])[0].samples) == 3
    assert len(trends_of([*lines[:3], dataclasses.replace(lines[3])])[0].samples) == 4


def test_values_of_a_scan_that_was_scaled_to_fit_are_in_no_trend() -> None:
    scaled = dataclasses.replace(line(2, 10.05), scale=0.99)
    (trend,) = trends_of([line(0, 10.0), line(1, 10.01), scaled])
    assert len(trend.samples) == 2
    assert math.isnan(trend.cpk)
    assert "scaled by 0.99 to fit, so that its size was not measured" in trend.left_out[0].words
