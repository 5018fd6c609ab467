from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from dqreg.report.progress import COLUMNS, Lines, LiveTable, Silent, cells, make_progress
from dqreg.result import Iteration


def iteration(number: int, motion: float = 1e-3) -> Iteration:
    return Iteration(number, "fine", 100, 90, 0.5, 0.1, 0.2, 0.01, np.deg2rad(2.0), motion, 0.01, np.eye(4))


def test_cells_match_the_columns():
    row = cells(iteration(7))
    assert len(row) == len(COLUMNS)
    assert row[0] == "7"
    assert row[6] == "2.00e+00"  # degrees, as the column says
    assert cells(iteration(1, np.inf))[-1] == "taken back"


@pytest.mark.parametrize(("terminal", "quiet", "kind"), [(True, False, LiveTable), (False, False, Lines),
                                                        (True, True, Silent)])  # fmt: skip
def test_kind_suits_the_console(terminal, quiet, kind):
    assert type(make_progress(Console(force_terminal=terminal, file=io.StringIO()), quiet=quiet)) is kind


def test_lines_are_one_each_under_one_header():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=False), quiet=False) as progress:
        for number in (1, 2, 3):
            progress(iteration(number))
    lines = text.getvalue().splitlines()
    assert len(lines) == 4
    assert [line.split()[0] for line in lines] == ["iteration", "1", "2", "3"]


def test_nothing_is_printed_without_iterations():
    for terminal in (True, False):
        text = io.StringIO()
        with make_progress(Console(file=text, force_terminal=terminal), quiet=False):
            pass
        assert text.getvalue() == ""


def test_live_table_shows_the_latest():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=True, width=200), quiet=False) as progress:
        for number in range(1, 40):
            progress(iteration(number))
    last_screen = text.getvalue().rsplit("iteration", 1)[-1]
    assert "39" in last_screen
    assert " 12 " not in last_screen
