from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dqreg.icp.stopping import Stopping

MOTIONS = st.lists(st.floats(1e-12, 1.0), min_size=1, max_size=40)


def first_verdict(stopping: Stopping, motions: list[float]) -> tuple[int, str | None]:
    for n in range(1, len(motions) + 1):
        if status := stopping.status(motions[:n]):
            return n, status
    return len(motions), None


def test_a_motion_at_the_tolerance_has_converged() -> None:
    stopping = Stopping(convergence=1e-3)
    assert stopping.status([1e-3]) == "converged"
    assert stopping.status([np.nextafter(1e-3, 1.0)]) is None
    assert stopping.status([1e-9, 0.5]) is None  # only the last one counts


def test_converging_in_the_last_iteration_allowed_counts_as_converged() -> None:
    assert Stopping(convergence=1e-3, iterations=2).status([0.1, 1e-4]) == "converged"
    assert Stopping(convergence=1e-3, iterations=2).status([0.1, 0.1]) == "iteration limit"


@given(st.integers(1, 30))
def test_the_limit_is_reached_in_exactly_that_many_iterations(limit: int) -> None:
    falling = [0.5**k for k in range(30)]
    assert first_verdict(Stopping(convergence=0.0, iterations=limit), falling) == (limit, "iteration limit")


@given(st.integers(1, 10), st.integers(0, 10))
def test_patience_counts_from_the_smallest_motion(patience: int, falls: int) -> None:
    motions = [0.9 - 0.01 * k for k in range(falls + 1)] + [0.95] * 30
    stopping = Stopping(convergence=0.0, iterations=1000, patience=patience)
    assert first_verdict(stopping, motions) == (falls + 1 + patience, "stalled")


def test_equal_motions_are_no_progress() -> None:
    assert first_verdict(Stopping(convergence=0.0, iterations=1000, patience=5), [0.1] * 30) == (6, "stalled")


def test_steps_taken_back_are_infinite_and_never_converge() -> None:
    assert Stopping().status([0.1, np.inf]) is None
    assert Stopping(patience=2).status([0.1, np.inf, np.inf]) == "stalled"


@given(MOTIONS, st.integers(-60, 60))
def test_the_verdict_is_about_ratios(motions: list[float], power: int) -> None:
    # Powers of two scale without rounding.
    factor = 2.0**power
    plain = Stopping(convergence=1e-3, iterations=30, patience=4).status(motions)
    scaled = Stopping(convergence=1e-3 * factor, iterations=30, patience=4).status([factor * m for m in motions])
    assert plain == scaled
