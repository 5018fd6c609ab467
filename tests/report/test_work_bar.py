from __future__ import annotations

import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from dqreg.report.work_bar import TimeLeft, WorkBar


@given(st.lists(st.tuples(st.sampled_from("abc"), st.floats(0.1, 10.0)), min_size=1, max_size=12), st.data())
def test_work_at_one_rate_leaves_what_is_not_done_at_that_rate(jobs, data):
    rate, done = data.draw(st.floats(0.1, 10.0)), data.draw(st.integers(0, len(jobs)))
    left = TimeLeft(jobs)
    for kind, work in jobs[:done]:
        left.done(kind, work, rate * work)
    if done == 0:
        assert math.isnan(left.seconds)
    else:
        # Sums and quotients of at most a dozen numbers below a hundred.
        assert left.seconds == pytest.approx(rate * sum(work for _, work in jobs[done:]), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("terminal", "quiet"), [(True, False), (True, True), (False, False)])
def test_a_bar_is_drawn_on_a_terminal_alone(terminal, quiet):
    text = io.StringIO()
    console = Console(file=text, force_terminal=terminal, quiet=quiet, width=120)
    with WorkBar(console) as bar:
        assert bar.show(3, 7, 8.0, "row [red]x[/]") == (terminal and not quiet)
    assert (text.getvalue() != "") == (terminal and not quiet)
    if terminal and not quiet:
        assert "3/7" in text.getvalue()
        assert "about 8 s left" in text.getvalue()
        assert "row [red]x[/]" in text.getvalue()


def test_steps_count_themselves():
    text = io.StringIO()
    with WorkBar(Console(file=text, force_terminal=True, width=120)) as bar:
        step = bar.steps(2, "frames")
        step("whatever", 1)
        step()
    assert "2/2" in text.getvalue()
