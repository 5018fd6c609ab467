from __future__ import annotations

import html.parser
import json
import math

import pytest
from rich.console import Console

from dqreg.errors import InputError
from dqreg.papers import PAPERS, Report, Section, Table, prepare_folder, print_section, reproduce, write_report
from dqreg.papers.document import Curve, Figure, Panel
from dqreg.papers.output import draw_png, to_html, to_json
from dqreg.report.table import Column, Estimate

NASTY = "<script>alert('x & y')</script>"


class Links(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []
        self.tags = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.found += [value for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]


@pytest.fixture
def report():
    table = Table(
        "t",
        NASTY,
        (Column("name"), Column("value", "mm")),
        ((NASTY, math.nan), ("estimate", Estimate(1.25, 0.031)), ("none", None), ("count", 3), ("inf", math.inf)),
        NASTY,
    )
    curve = Curve("a", (1.0, 2.0), (1.0, math.nan))
    figure = Figure("f", NASTY, (Panel("x [mm]", "y [mm]", (curve,)),), NASTY)
    section = Section("s", NASTY, NASTY, (NASTY,), (table,), (figure,))
    return Report("p", NASTY, NASTY, 7, True, (section,), {"part": NASTY})


def test_json_is_strict_and_complete(report):
    text = to_json(report)

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    read = json.loads(text, parse_constant=refuse)
    assert read["seed"] == 7
    rows = read["sections"][0]["tables"][0]["rows"]
    assert rows == [
        [NASTY, None],
        ["estimate", {"value": 1.25, "error": 0.031}],
        ["none", None],
        ["count", 3],
        ["inf", None],
    ]
    assert read["sections"][0]["figures"][0]["panels"][0]["curves"][0]["y"] == [1.0, None]


def test_page_escapes_and_stands_alone(report):
    page = to_html(report, {"f": draw_png(report.figures[0])})
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 9
    links = Links()
    links.feed(page)
    assert links.found
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in links.found)
    assert not {"script", "link", "iframe", "object"} & set(links.tags)
    assert "url(" not in page
    assert "@import" not in page
    assert 'name="viewport"' in page
    assert "@media print" in page


def test_screen_page_and_json_show_the_same_numbers(report, capsys):
    print_section(Console(width=200), report.sections[0])
    shown = capsys.readouterr().out
    page = to_html(report, {"f": b""})
    for text in ("1.250(31)", "[mm]"):
        assert text in shown
        assert text in page


def test_unknown_papers_and_seeds_are_named():
    with pytest.raises(InputError, match="walker1991"):
        reproduce("walker1992")
    with pytest.raises(InputError, match="-1"):
        reproduce("jia2020", -1)


def test_files_are_checked_before_and_written_whole(report, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="file"):
        prepare_folder(tmp_path / "file", [])
    (tmp_path / "out" / "figure-f.png").mkdir(parents=True)
    with pytest.raises(InputError, match=r"figure-f\.png"):
        prepare_folder(tmp_path / "out", ["f"])
    (tmp_path / "out" / "figure-f.png").rmdir()
    prepare_folder(tmp_path / "out", ["f"])
    paths = write_report(report, tmp_path / "out")
    assert sorted(path.name for path in paths) == ["figure-f.png", "report.html", "results.json"]
    assert sorted((tmp_path / "out").iterdir()) == sorted(paths)


@pytest.fixture(scope="module")
def walker():
    seen = []
    return reproduce("walker1991", 3, quick=True, observe=lambda section: seen.append(section.key)), seen


def test_whole_report_has_unique_keys_and_the_announced_figures(walker):
    report, seen = walker
    assert [section.key for section in report.sections] == seen
    assert tuple(figure.key for figure in report.figures) == PAPERS["walker1991"].figures
    assert len(set(seen)) == len(seen)
    assert all(panel.x_label and panel.y_label for figure in report.figures for panel in figure.panels)
    json.loads(to_json(report))


def test_the_seed_fixes_every_drawn_number(walker):
    again = reproduce("walker1991", 3, quick=True)
    for first, second in zip(walker[0].sections, again.sections, strict=True):
        if first.key != "time":  # the clock is not drawn
            assert first == second
    # Another seed draws other numbers.
    rows = reproduce("jia2020", 1, quick=True).sections[1].tables[0].rows
    assert rows != reproduce("jia2020", 2, quick=True).sections[1].tables[0].rows
