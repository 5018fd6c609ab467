from __future__ import annotations

import csv
import dataclasses
import io
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from dqreg.registration.batch.line import Line, line_of
from dqreg.registration.batch.row import Row, RowResult
from dqreg.registration.batch.row_inspection import RowInspection
from dqreg.registration.batch.summary import COLUMNS, VERDICTS, counts, part_counts, summary_csv, to_html, to_records

NASTY = '<script>alert("1")</script>&\'\n;,"'
ROW = Row("a", Path(f"/x/{NASTY}.ply"), Path("/y/<b>.stl"), line=2)
RECORD = {
    "verdict": {"level": "suspect", "reasons": [NASTY, "second"]},
    "rms": 0.1234567890123456,
    "inlier_fraction": 0.5,
    "T_target_source": [[1.0, 0.0, 0.0, 7.0], [0.0, 1.0, 0.0, 8.0], [0.0, 0.0, 1.0, 9.0], [0.0, 0.0, 0.0, 1.0]],
    "dual_quaternion": {"real": [1.0, 0.0, 0.0, 0.0], "dual": [0.0, 3.5, 4.0, 4.5]},
    "batch": {"seconds": 2.5},
}
HEADS = list(COLUMNS)
LINES = [
    line_of(ROW, RowResult("ran", "", RECORD)),
    line_of(dataclasses.replace(ROW, name="b"), RowResult("crashed", NASTY)),
]


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attributes if name in ("src", "href")]


def test_csv_holds_every_digit_and_every_character():
    head, first, second = list(csv.reader(io.StringIO(summary_csv(LINES), newline="")))
    assert head == HEADS
    assert [float(first[HEADS.index(name)]) for name in ("rms", "seconds", "tx", "qw")] == [
        RECORD["rms"], 2.5, 7.0, 1.0,
    ]  # fmt: skip
    assert first[HEADS.index("scan")] == str(ROW.scan)
    assert first[HEADS.index("reasons")] == f"{NASTY}; second"
    assert first[HEADS.index("result")] == "results/a.json"
    assert second[HEADS.index("verdict")] == "crashed"
    assert second[HEADS.index("rms")] == second[HEADS.index("result")] == ""


def test_a_pass_on_an_alignment_that_is_not_trusted_is_counted_apart():
    inspection = {"outcome": "pass", "units": "mm", "values": []}
    asked = dataclasses.replace(ROW, asked=RowInspection(tolerance=0.1))
    lines = [Line(asked, level, (), inspection=inspection) for level in ("accepted", "suspect", "accepted")]
    assert {part.words: count for part, count in part_counts(lines).items()} == {
        "pass": 2,
        "pass on an alignment that is not trusted": 1,
    }
    assert [(row["part"], row["alignment_trusted"]) for row in to_records(lines)] == [
        ("pass", True), ("pass", False), ("pass", True),
    ]  # fmt: skip
    page = to_html("b", lines)
    assert '<span class="verdict conditional">1 pass on an alignment that is not trusted</span>' in page
    assert page.count('<span class="verdict conditional">pass, if the alignment holds</span>') == 1


def test_csv_has_the_head_the_unit_and_the_deviations_of_each_part():
    figures = {"p95": 0.12, "share_within": 0.97, "scanned": None}
    inspection = {"outcome": "pass", "units": "mm", "values": [], "figures": figures}
    one = dataclasses.replace(ROW, asked=RowInspection(tolerance=0.1, head=(("part", "4711"), ("serial", "S 1"))))
    other = dataclasses.replace(
        ROW, name="b", asked=RowInspection(head=(("serial", "S 2"), ("order", "9"))), fault="gone"
    )
    lines = [Line(one, "accepted", (), unit="mm", inspection=inspection), Line(other, "error", ("gone",))]
    first, second = csv.DictReader(io.StringIO(summary_csv(lines), newline=""))
    assert (first["serial"], first["head_part"], first["order"], first["part"]) == ("S 1", "4711", "", "pass")
    assert (second["serial"], second["head_part"], second["order"]) == ("S 2", "", "9")
    assert (first["unit"], second["unit"]) == ("mm", "")
    assert [first[name] for name in ("deviation_p95", "share_within", "share_scanned")] == ["0.12", "0.97", ""]
    assert to_records(lines)[0]["head"] == {"part": "4711", "serial": "S 1"}
    # A file of an older version has no figures.
    old = {name: value for name, value in inspection.items() if name != "figures"}
    (kept,) = csv.DictReader(io.StringIO(summary_csv([Line(one, "accepted", (), inspection=old)]), newline=""))
    assert kept["deviation_p95"] == ""


def test_a_scale_that_was_solved_for_stands_beside_the_outcome():
    solved = {**RECORD, "scale": 0.990099, "settings": {"scale_solved": True, "target_units": "mm"}}
    solved["batch"] = {"seconds": 2.5, "inspection": {"outcome": "pass", "units": "mm", "values": []}}
    given = {**solved, "settings": {"target_units": "mm"}}
    asked = dataclasses.replace(ROW, asked=RowInspection(tolerance=0.1))
    lines = [line_of(asked, RowResult("ran", "", record)) for record in (solved, given)]
    rows = list(csv.DictReader(io.StringIO(summary_csv(lines), newline="")))
    assert [row["scale_solved"] for row in rows] == ["0.990099", ""]
    assert [record["scale_solved"] for record in to_records(lines)] == [0.990099, None]
    assert to_html("b", lines).count("in shape alone: scaled by 0.990099 to fit") == 1


def test_long_reasons_are_folded():
    long = "all is well; " + "the part looks the same after a half-turn; " * 9
    page = to_html("b", [Line(ROW, "accepted", (long,)), Line(ROW, "accepted", ("all is well",))])
    assert page.count("<details>") == 1
    assert long in page
    assert "<li>all is well</li>" in page


def test_page_escapes_what_comes_from_outside_and_loads_nothing(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"jpeg")
    page = to_html(NASTY, LINES, tmp_path)
    tags = Tags()
    tags.feed(page)
    # One script of our own; none of theirs.
    assert tags.tags.count("script") == 1
    assert "<script>alert" not in page
    assert tags.tags.count("img") == 1
    assert sorted(tags.sources) == ["data:image/jpeg;base64,anBlZw==", "results/a.json"]
    assert "://" not in re.sub(r"<script>.*", "", page, flags=re.DOTALL)


def test_page_without_pictures_or_rows():
    assert "<img" not in to_html("t", LINES)
    assert "0 rows" in to_html("t", [])


def test_nothing_found_is_nan():
    record = {**RECORD, "rms": None, "dual_quaternion": None, "verdict": {"level": "failed", "reasons": ["x"]}}
    line = line_of(ROW, RowResult("ran", "", record))
    assert math.isnan(line.rms)
    assert all(map(math.isnan, line.pose))
    assert line.verdict == "failed"


def test_counts_name_the_good_first():
    lines = [Line(ROW, verdict, ()) for verdict in ("failed", "accepted", "accepted", "not run")]
    assert list(counts(lines).items()) == [("accepted", 2), ("failed", 1), ("not run", 1)]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_a_place_in_the_page(verdict):
    assert f'<span class="verdict {verdict}">' in to_html("t", [Line(ROW, verdict, ("why",))])


def test_lengths_are_in_the_unit_that_was_asked_for_and_the_heads_name_it():
    row = dataclasses.replace(ROW, asked=RowInspection(display_units="mm"))
    batch = {"seconds": 2.5, "shown": {"units": "mm", "rms": 123.0}}
    lines = [line_of(row, RowResult("ran", "", {**RECORD, "settings": {"target_units": "m"}, "batch": batch}))]
    (values,) = csv.DictReader(io.StringIO(summary_csv(lines), newline=""))
    assert [values[name] for name in ("rms [mm]", "tx [mm]", "ty [mm]", "tz [mm]", "qw")] == [
        "123.0", "7000.0", "8000.0", "9000.0", "1.0",
    ]  # fmt: skip
    (record,) = to_records(lines)
    assert (record["units"], record["rms"], record["pose"]["tx"]) == ("mm", 123.0, 7000.0)


def test_a_row_without_a_result_shows_no_folder_either(tmp_path):
    gone = Row("gone", Path("gone.ply"), tmp_path / "part.stl", line=3)
    words = f"line 3: cannot read {tmp_path}/gone.ply: found no such file"
    page = to_html("t", [*LINES, line_of(gone, RowResult("error", words))])
    assert "cannot read gone.ply" in page
    assert str(tmp_path) not in page
