from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import os
from pathlib import Path

import matplotlib.image
import pytest
from rich.console import Console

from dqreg.compare.output import Goals, summary_csv, to_html, to_json
from dqreg.compare.plots import Plot, plots
from dqreg.compare.records import RunRecord
from dqreg.compare.run import Comparison
from dqreg.compare.store import Store
from dqreg.compare.summary import largest_reliable, summarise, time_exponent
from dqreg.compare.tables import footer, tables
from dqreg.errors import InputError
from dqreg.files.strict_json import plain, record_from
from dqreg.report.figure import new_figure
from dqreg.report.table import print_tables, to_markdown

NAN = float("nan")
EVIL = "<script>alert('|')</script>"


def run(engine: str = "a", *, found: bool | None = True, **more) -> RunRecord:
    base = RunRecord(
        key="k", engine=engine, repeat=0, case="part", axis="case", value=None, trial=0, setting="manual",
        without_initial_pose=False, points=1000, size=100.0, units="mm", status="ran", message="", T_target_source=None,
        seconds=2.0, prepare_seconds=NAN, wall_seconds=2.1, peak_memory=5e6, iterations=3, self_report="", settings={},
        kind="rigid", success=found, angle_rad=1e-3, offset=0.1, worst=0.2 if found else 30.0, rms=0.1,
        surface_rms=0.05, overlap=0.9, curve=[(1, 0.1, 5.0), (2, NAN, 0.2)],
    )  # fmt: skip
    return dataclasses.replace(base, **more)


def of(*runs: RunRecord) -> Comparison:
    engines = tuple(dict.fromkeys(each.engine for each in runs))
    session = {"machine": "a machine", "versions": {"numpy": "2"}, "threads": 2}
    return Comparison(runs, engines, {"absent": ("some-package",)}, (session,), "things")


def sweep_of(axis: str, values: dict, **more) -> list[RunRecord]:
    return [
        run(key=f"{axis} {value} {trial}", axis=axis, value=value, found=found, **more)
        for value, list_ in values.items()
        for trial, found in enumerate(list_)
    ]


def test_records_survive_json():
    made = run(worst=math.inf)
    again = record_from(RunRecord, json.loads(json.dumps(plain(made), allow_nan=False)))
    assert plain(again) == plain(made)
    assert again.curve[0] == (1, 0.1, 5.0)
    assert math.isnan(again.curve[1][1])
    with pytest.raises(InputError, match="no RunRecord"):
        record_from(RunRecord, {"key": "k"})


def test_a_line_counts_failures_and_takes_medians_of_what_was_found():
    (line,) = summarise([run(), run(worst=0.4, seconds=4.0), run(found=False, kind="nothing", worst=NAN)])
    assert (line.found, line.runs) == (2, 3)
    assert line.worst == pytest.approx(0.003)
    # A run without a pose is infinitely far off: two of three are not, so the median is the farther of these.
    assert line.worst_all == pytest.approx(0.004)
    assert (line.seconds, line.least_seconds, line.most_seconds) == (2.0, 2.0, 4.0)
    assert "no pose" in line.remark


def test_reach_ends_at_the_first_failure():
    lines = summarise(sweep_of("start_angle_deg", {5: [True], 10: [True, True], 20: [True, False], 30: [True]}))
    assert largest_reliable(lines, "a", "start_angle_deg", "manual") == 10.0
    assert math.isnan(largest_reliable(lines, "b", "start_angle_deg", "manual"))


def test_reach_goes_by_value_and_not_by_the_order_of_the_runs():
    sweep = {5: [True], 20: [True], 45: [False], 10: [True]}
    assert largest_reliable(summarise(sweep_of("start_angle_deg", sweep)), "a", "start_angle_deg", "manual") == 20.0
    gap = {5: [True], 20: [True], 10: [True, False]}
    assert largest_reliable(summarise(sweep_of("start_angle_deg", gap)), "a", "start_angle_deg", "manual") == 5.0
    later = {5: [True], 20: [True], 10: [True]}
    assert largest_reliable(summarise(sweep_of("start_angle_deg", later)), "a", "start_angle_deg", "manual") == 20.0
    # Less overlap is harder.
    overlap = {0.4: [False], 1.0: [True], 0.6: [True]}
    assert largest_reliable(summarise(sweep_of("overlap", overlap)), "a", "overlap", "manual") == 0.6


def test_growth_is_the_exponent():
    runs = [run(axis="points", value=n, points=n, seconds=1e-6 * n**1.2) for n in (1000, 10_000, 100_000)]
    assert time_exponent(summarise(runs), "a") == pytest.approx(1.2)


def test_tables_say_what_was_not_found():
    late = {"status": "timeout", "message": "no answer within 9 s", "kind": "nothing", "worst": NAN, "seconds": NAN}
    made = tables(of(run(), run("b", found=False), run("c", found=False, **late)))
    rows = {row[0]: row for row in made[0].rows}
    assert [rows[name][1] for name in "abc"] == ["1/1", "0/1", "0/1"]
    assert rows["c"][2] == "none"
    assert rows["b"][-1] == "wrong pose"
    assert rows["c"][-1] == "no answer within 9 s"
    assert "absent (pip install some-package)" in footer(of(run()), 0.01)


def test_accuracy_in_the_summary_says_of_how_many():
    runs = sweep_of("start_angle_deg", {5: [True, False], 10: [False, False]}) + sweep_of(
        "start_angle_deg", {5: [False]}, engine="b"
    )
    table = next(table for table in tables(of(*runs)) if table.key == "answers")
    cells = {row[0]: row[table.head.index("worst vertex [S]")] for row in table.rows}
    assert cells == {"a": "2.0e-3, 1/4 (1 to 81 %)", "b": "-, 0/1"}
    assert "of those that were found" in table.note


def test_remarks_end_with_a_word_and_say_what_time_an_engine_does_not_tell():
    words = " ".join(["something"] * 12)
    honest, short = run(), run(seconds=1e-6, wall_seconds=0.5)
    failed = run(found=False, status="error", message=words, kind="nothing", seconds=NAN)
    remarks = [summarise([each])[0].remark for each in (honest, short, failed)]
    assert remarks[:2] == ["", "tells 1e-06 s, 0.5 s passed"]
    assert remarks[2].endswith("something ...")
    assert len(remarks[2]) <= 90


def test_counts_of_a_grid_have_their_intervals_below_and_repeats_of_a_task_have_none():
    runs = sweep_of("start_angle_deg", {5: [True] * 5, 10: [True] * 4 + [False], 20: [False]})
    table = next(table for table in tables(of(*runs)) if table.key.startswith("start_angle_deg"))
    assert "95 % intervals (Clopper and Pearson): 5/5 (48 to 100 %), 4/5 (28 to 99 %). Worst" in table.note
    (one,) = tables(of(run(), run(repeat=1)))
    assert one.rows[0][1] == "2/2"
    first, second = summarise(sweep_of("noise", {0.0: [True] * 4 + [False], 1e-3: [True]}))
    assert (first.found_low, first.found_high) == pytest.approx((0.2836, 0.9949), abs=1e-4)
    assert math.isnan(second.found_low)


def test_many_cases_have_a_table_over_all_of_them():
    runs = [run(name, key=case, case=case, found=(name, case) != ("b", "y")) for name in "ab" for case in "xyz"]
    table = tables(of(*runs))[-1]
    assert [row[:2] for row in table.rows] == [("a", "3/3 (29 to 100 %)"), ("b", "2/3 (9 to 99 %)")]
    assert not any(table.key.startswith("cases-") for table in tables(of(run(), run("b"))))


def test_successes_without_an_initial_pose_have_their_interval():
    runs = sweep_of("nothing", {"bracket": [True] * 3, "blade": [True, False]}, without_initial_pose=True)
    table = tables(of(*runs))[0]
    # Clopper and Pearson's for 4 of 5, as tables have it.
    assert table.rows[0][table.head.index("no initial pose")] == "4/5 (28 to 99 %)"


def test_the_initial_pose_is_a_row_and_told_where_it_counts_as_found():
    good, bad = (run("initial pose", found=found, seconds=NAN, peak_memory=NAN) for found in (True, False))
    table, other = (tables(dataclasses.replace(of(run()), starts=(start,)))[0] for start in (good, bad))
    assert [row[0] for row in table.rows] == ["initial pose", "a"]
    assert table.rows[0][1:3] == ("1/1", "2.0e-3")
    assert "already counts as found" in table.note
    assert "--success" in table.note
    assert other.rows[0][1:3] == ("0/1", "0.3")
    assert "already counts" not in other.note


def test_those_that_took_no_part_are_named():
    found = dataclasses.replace(of(run()), unfit={"b": "needs an initial pose"})
    assert "Took no part: b (needs an initial pose)." in footer(found, 0.01)


def test_legend_of_every_engine_is_on_the_picture():
    names = [f"an engine with a name {number}" for number in range(34)]
    for plot in plots(of(*(run(name) for name in names))):
        page = matplotlib.image.imread(io.BytesIO(plot.as_file()))[..., :3]
        # Nothing is drawn on the rims: what reaches them is cut off.
        assert (page[:2] == 1.0).all()
        assert (page[-2:] == 1.0).all()


def test_plot_of_noise_rings_what_was_not_always_found():
    def picture(found: list[bool]) -> bytes:
        (plot,) = [
            plot for plot in plots(of(*sweep_of("noise", {0.0: [True, True], 1e-3: found}))) if "noise" in plot.key
        ]
        return plot.as_file()

    assert picture([True, True]) != picture([True, False])


def test_all_tables_and_plots_of_a_sweep():
    runs = []
    for engine in ("dqreg", "b"):
        runs += sweep_of("start_angle_deg", {5: [True], 30: [False]}, engine=engine)
        for axis, values in (("start_offset", (0.1,)), ("noise", (0.0, 1e-3)), ("outliers", (0.0, 0.5)),
                             ("overlap", (1.0, 0.4)), ("points", (1e4, 1e6)), ("frame", ("mm", "m, UTM"))):  # fmt: skip
            runs += sweep_of(axis, {value: [True] for value in values}, engine=engine)
    runs += sweep_of("nothing", {"bracket": [True]}, without_initial_pose=True)
    found = of(*runs)
    made = tables(found)
    assert made[0].title == "Summary"
    assert all(len(row) == len(table.head) for table in made for row in table.rows)
    pictures = plots(found)
    assert {plot.key for plot in pictures} >= {
        "success-start_angle_deg",
        "error-noise",
        "success-outliers",
        "success-overlap",
        "scaling",
        "convergence-manual",
    }
    assert all(plot.as_file().startswith(b"\x89PNG") for plot in pictures)


@pytest.mark.parametrize(("kind", "head"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_plots_for_a_paper_are_the_same_bytes_whenever_they_are_drawn(kind, head):
    (first,), (second,) = (plots(of(run(curve=[]))) for _ in range(2))
    assert first.as_file(kind).startswith(head)
    assert first.as_file(kind) == second.as_file(kind)
    assert b"2026-" not in first.as_file(kind)


def test_without_a_truth_nothing_is_said_about_success():
    (table,) = tables(of(run(found=None, worst=NAN, rms=NAN, angle_rad=NAN)))
    assert table.rows[0][1:5] == ("-", "-", "-", "-")
    assert table.rows[0][6] == "90.0 %"
    assert plots(of(run(found=None, worst=NAN))) == []


def test_the_page_and_the_markdown_escape_what_comes_from_outside():
    found = of(run(EVIL, case=EVIL, found=False, status="error", message=EVIL, kind="nothing", units=EVIL))
    found = dataclasses.replace(found, title=EVIL, missing={EVIL: (EVIL,)})
    made = tables(found)
    page = to_html(found.title, made, [Plot("k", EVIL, new_figure(1.0, 1.0, 50))], footer(found, 0.01), EVIL)
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 6
    assert "://" not in page
    text = to_markdown(made)
    assert "<script" not in text
    widths = {line.replace("\\|", "").count("|") for line in text.splitlines() if line.startswith("|")}
    assert len(widths) == 1


@pytest.mark.parametrize("width", [40, 80, 200])
def test_no_digit_is_cut_off_on_a_narrow_screen(width):
    made = tables(of(run("an engine of a name", seconds=12345.0), run("b", found=False, worst=1.2345e-6)))
    screen = Console(width=width, file=io.StringIO())
    print_tables(screen, made)
    text = screen.file.getvalue()
    assert max(map(len, text.splitlines()[2:])) <= width
    for row in made[0].rows:
        for cell in row[:-1]:
            assert cell in text


def test_a_rate_says_of_how_many_runs_it_is():
    def label(values):
        (plot,) = (each for each in plots(of(*sweep_of("outliers", values))) if each.key == "success-outliers")
        return plot.figure.axes[0].get_ylabel()

    assert label({0.0: [True], 0.2: [False]}) == "success rate, of 1 run each"
    assert label({0.0: [True] * 3, 0.2: [False] * 5}) == "success rate, of 3 to 5 runs each"


def test_what_the_time_limit_cut_off_is_told_apart_from_what_was_not_found():
    late = run("slow", found=False, status="timeout", message="no answer within 30 s", wall_seconds=30.0)
    words = "Cut off by the time limit, and so not found: slow 2 of 3 runs; a longer --timeout makes these again."
    assert words in footer(of(run("slow"), late, late, run("wrong", found=False)), 0.01)
    assert "time limit" not in footer(of(run("wrong", found=False)), 0.01)


def test_what_was_cut_off_is_made_again_where_there_is_more_time(tmp_path):
    store = Store(tmp_path / "runs.jsonl")
    store.begin({})
    store.add([run(), run("slow", found=False, status="timeout", wall_seconds=30.0)])
    assert [len(Store(store.path, timeout).runs) for timeout in (10.0, 30.0, 60.0)] == [2, 2, 1]


def test_beside_a_device_no_runs_are_kept():
    goals = Goals(out=Path(os.devnull), report=Path(os.devnull))
    goals.check()
    assert goals.lines is None


def test_csv_holds_full_precision():
    (row,) = csv.DictReader(io.StringIO(summary_csv(summarise([run(seconds=1 / 3)]))))
    assert float(row["seconds"]) == 1 / 3
    assert (row["engine"], row["case"], row["found"]) == ("a", "part", "1")


def test_json_is_strict():
    data = json.loads(to_json(of(run(), run("b", worst=NAN))), parse_constant=pytest.fail)
    assert [each["engine"] for each in data["runs"]] == ["a", "b"]
    assert data["summary"][0]["place"]["case"] == "part"
