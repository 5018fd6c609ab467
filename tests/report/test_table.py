from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from dqreg.papers.document import Report, Section
from dqreg.report.html import render
from dqreg.report.table import Column, Estimate, Table, cell_text, print_tables, to_markdown

NASTY = "<script>|\\\n"
COLUMNS = (Column("name"), Column("value", "mm"), Column("words", align="left"))
TABLE = Table("t", "T", COLUMNS, ((NASTY, 1e-5, "3"), ("b", None, "4"), ("b", math.nan, "5")), "a note")


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (Estimate(0.123456, 0.00123), "0.1235(12)"),
        (Estimate(4.2e-5, 3.1e-7), "4.200(31)e-5"),
        (Estimate(7.847e-3, 2.4e-5), "0.007847(24)"),
        (Estimate(386.2, 1.6), "386.2(1.6)"),
        (Estimate(386.2, 16.4), "386(16)"),
        (Estimate(2.0, 0.0), "2"),
        (Estimate(5.785556363e-16, 6.1e-34), "5.79e-16"),
        (Estimate(math.nan, 1.0), "-"),
        (math.nan, "-"),
        (None, "-"),
        (12345, "12345"),
        (1e-5, "1e-5"),
        (0.0, "0"),
        ("refused", "refused"),
    ],
)
def test_cells(cell, text):
    assert cell_text(cell, Column("c")) == text


def test_a_row_of_the_wrong_length_is_a_mistake():
    with pytest.raises(ValueError, match="2 cells"):
        Table("t", "T", (Column("a"),), ((1, 2),))


def test_a_column_goes_by_its_first_cell_unless_it_says_so():
    assert [TABLE.is_right(index) for index in range(3)] == [False, True, False]


def test_groups_begin_where_the_first_column_changes_and_only_if_it_repeats():
    def groups(table: Table) -> list[str]:
        shown = render("papers.html", report=of(table), pictures={})
        return [line for line in shown.splitlines() if line.startswith('<tr class="group"')]

    def of(table: Table) -> Report:
        return Report("p", "P", "C", 0, False, (Section("s", "S", "F", tables=(table,)),))

    assert len(groups(TABLE)) == 1
    assert len(groups(Table("t", "T", (Column("a"),), (("x",), ("y",))))) == 0


def test_screen_markdown_and_page_show_the_same_texts():
    screen = Console(width=100, file=io.StringIO())
    print_tables(screen, [TABLE])
    page = render("compare.html", title="", tables=[TABLE], plots=[], note="", command="")
    for shown in (screen.file.getvalue(), to_markdown([TABLE]), page):
        assert all(text in shown for text in ("T", "a note", "value", "mm", "1e-5", "-", "5"))
    assert "<script" not in page
    assert "<script" not in to_markdown([TABLE])


def test_markdown_has_the_same_columns_in_every_line():
    lines = [
        line.replace("\\\\", "").replace("\\|", "")
        for line in to_markdown([TABLE]).splitlines()
        if line.startswith("|")
    ]
    assert {line.count("|") for line in lines} == {4}
    assert lines[1] == "|---|--:|---|"


@pytest.mark.parametrize("width", [30, 40, 80])
def test_a_narrow_screen_gets_pieces_and_loses_no_digit(width):
    columns = tuple(Column(f"c{i}", spec=".12g") for i in range(6))
    table = Table("t", "T", columns, (tuple(i + 0.123456789012 for i in range(6)),))
    screen = Console(width=width, file=io.StringIO())
    print_tables(screen, [table])
    shown = screen.file.getvalue()
    assert max(map(len, shown.splitlines())) <= width
    assert all(text in shown for text in table.text[0])


def test_heads_of_two_lines_stand_on_two_lines() -> None:
    # Control characters of names are escaped; the line breaks of our own heads are not.
    from rich.console import Console

    table = Table("speed", "", (Column("engine"), Column("frames\na second")), (("a\x1b[31m", "3"),))
    with (console := Console(width=80)).capture() as told:
        print_tables(console, [table])
    assert "\\n" not in told.get()
    assert "\x1b" not in told.get()
    assert "a second" in told.get()
