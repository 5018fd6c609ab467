from __future__ import annotations

import dataclasses
import io
import re

import numpy as np
import pytest
from rich.console import Console

from dqreg.registration.result.result import Iteration
from dqreg.report.progress import COLUMNS, SEARCHED, Lines, LiveTable, Silent, Steps, cells, make_progress
from dqreg.search import Stage


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


def test_a_pipe_gets_a_line_for_each_run_of_the_loop_however_many_iterations_it_takes():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=False, width=200), quiet=False, unit="mm") as progress:
        number = 0
        # Two poses are tried on a growing number of points, the last on all, which are fewer; the second is refined.
        for stage, points in [("fine", 1000)] * 30 + [("fine", 9100)] * 40 + [("fine", 5611)] + [("fine", 1000)] * 20:
            number += 1
            progress(dataclasses.replace(iteration(number), stage=stage, points=points))
        progress(dataclasses.replace(iteration(number + 1), stage="common faces"))
    assert text.getvalue().splitlines() == [
        "loop 1  fine, 71 iterations, 5,611 points, 50.0 % inliers, rms 0.1 mm",
        "loop 2  fine, 20 iterations, 1,000 points, 50.0 % inliers, rms 0.1 mm",
        "loop 3  common faces, 1 iteration, 100 points, 50.0 % inliers, rms 0.1 mm",
    ]


def visible(text: str) -> str:
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)


def test_nothing_stays_on_the_screen_without_iterations():
    for terminal in (True, False):
        text = io.StringIO()
        with make_progress(Console(file=text, force_terminal=terminal), quiet=False):
            pass
        assert visible(text.getvalue()).strip() == ""


def test_stages_of_the_search_are_lines_in_a_pipe():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=False), quiet=False) as progress:
        progress.search(Stage("screened", 1_600, 0.31))
        progress(iteration(1))
    lines = text.getvalue().splitlines()
    assert lines[0] == "search  screened, 1,600 poses left, 0.3 s"
    assert len(lines) == 2
    assert "\x1b" not in text.getvalue()


def test_units_stand_in_the_head_of_the_table():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=True, width=200), quiet=False, unit="mm") as progress:
        progress(iteration(1))
    for name in ("rms [mm]", "kernel [mm]", "rotation [deg]", "step [size]"):
        assert name in text.getvalue()


def test_the_bar_moves_with_the_stages_and_says_how_long():
    seconds = [0.0]
    text = io.StringIO()
    live = LiveTable(Console(file=text, force_terminal=True, width=200), searching=True, now=lambda: seconds[0])
    with live:
        for name, after in (("proposed", 3.5), ("refined", 4.6)):
            seconds[0] = after
            live.search(Stage(name, 12, after))
        live._live.refresh()
    shown = visible(text.getvalue())
    assert "trying 12 symmetric poses" in shown
    # 46 % are usually gone when this stage ends: 4.6 of 10 seconds.
    assert "about 5 s left" in shown


def test_shares_of_the_steps_only_grow():
    seconds = [0.0]
    steps = Steps("reading", searching=True, now=lambda: seconds[0])
    assert steps.left() is None
    shares = []
    for name in SEARCHED:
        seconds[0] += 1.0
        steps = steps.searched(name, name)
        shares.append(steps.share)
    for number in range(40):
        seconds[0] += 0.1
        steps = steps.iterated(str(number))
        shares.append(steps.share)
    assert shares == sorted(shares)
    assert shares[-1] < 1.0
    # Between two steps the bar follows the clock, and waits at the next one.
    reached = []
    for after in (0.0, 1.0, 1e6):
        seconds[0] += after
        reached.append(steps.reached())
    assert reached == sorted(reached)
    assert reached[-1] == pytest.approx(steps.following)
    assert steps.left() == 0.0


def test_live_table_shows_the_latest():
    text = io.StringIO()
    with make_progress(Console(file=text, force_terminal=True, width=200), quiet=False) as progress:
        for number in range(1, 40):
            progress(iteration(number))
    last_screen = text.getvalue().rsplit("iteration", 1)[-1]
    assert "39" in last_screen
    assert " 12 " not in last_screen
