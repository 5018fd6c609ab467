from __future__ import annotations

import numpy as np
import pytest

from dqreg.papers.accuracy import METHODS, _layout, accuracy_section, measure_accuracy
from dqreg.papers.solution_time import SAMPLE_COUNTS, measure_time, time_section

CENTRED = ("solve", "svd", "horn")


@pytest.fixture(scope="module")
def outcomes():
    return {outcome.layout: outcome for outcome in measure_accuracy(np.random.default_rng(0), trials=5)}


def test_centred_methods_lose_no_more_than_the_input(outcomes):
    # 20 points of size 1: the error of a rotation is some ten roundings of a coordinate.
    for layout in ("at the origin", "1,000 sizes away", "a million sizes away", "a billion sizes away", "in a plane"):
        for name in CENTRED:
            assert outcomes[layout].refused[name] == 0
            assert outcomes[layout].worst_rad[name] < 100 * outcomes[layout].floor_rad


def test_the_algorithm_as_printed_loses_digits_far_away(outcomes):
    far = outcomes["1,000 sizes away"]
    assert far.worst_rad["walker1991"] > 100 * far.worst_rad["solve"]
    assert outcomes["a billion sizes away"].refused["walker1991"] == 5


def test_free_rotations_are_refused_by_all(outcomes):
    for layout in (
        "strip along the axes, exactly on a line",
        "strip in general position, exactly on a line",
        "one point, repeated",
    ):
        assert outcomes[layout].refused == dict.fromkeys(METHODS, 5)
        assert np.isnan(list(outcomes[layout].worst_rad.values())).all()


def test_size_does_not_matter(outcomes):
    for layout in ("size 1e-12", "size 1e12"):
        assert max(outcomes[layout].worst_rad.values()) < 1e-13


def test_refusals_are_words_in_the_table(outcomes):
    section = accuracy_section(tuple(outcomes.values()))
    cells = {row[0]: row[2:] for row in section.tables[0].rows}
    assert cells["strip along the axes, exactly on a line"] == ("refused",) * 4
    assert all(isinstance(cell, float) for cell in cells["at the origin"])


def test_solve_keeps_the_digits_of_narrow_strips_in_either_position(outcomes):
    # 1e-9 may be refused; down to 1e-7 the coordinates leave eps over the width, times some ten roundings.
    strips = [o for o in outcomes.values() if "strip" in o.layout and o.floor_rad < 1e-8]
    assert {o.aligned for o in strips} == {True, False}
    for outcome in strips:
        assert outcome.refused["solve"] == 0, outcome.layout
        assert outcome.worst_rad["solve"] < 100 * outcome.floor_rad, outcome.layout


def test_a_strip_along_the_axes_lies_along_them():
    for aligned in (True, False):
        source = _layout(np.random.default_rng(0), (1.0, 1e-3, 1e-3), 0.0, aligned)[0]
        assert bool(np.ptp(source, axis=0)[1:].max() < 1e-3) is aligned


def test_times_have_a_line_through_them():
    timings = measure_time(np.random.default_rng(0), most=100, repeats=2)
    assert [timing.samples for timing in timings] == [SAMPLE_COUNTS[:5]] * 2
    for timing in timings:
        assert all(seconds > 0.0 for seconds in timing.seconds)
        assert 0.0 <= timing.r_squared <= 1.0
        n, t = np.array(timing.samples), np.array(timing.seconds)
        relative = (t - timing.start - timing.slope * n) / t
        # Least relative squares: what is left is orthogonal to the line.
        assert abs(relative @ (1.0 / t)) < 1e-6 * np.sum(1.0 / t)
        assert abs(relative @ (n / t)) < 1e-6 * np.sum(n / t)
    assert time_section(timings).tables[0].rows[0][1] == 1000.0


def test_both_sides_go_away_and_the_turn_is_the_truth():
    source, target, T = _layout(np.random.default_rng(0), (1.0, 1.0, 1.0), 1e3)
    for side in (source, target):
        # 20 points of a unit box: their mean is within 0.3 of its middle.
        assert np.linalg.norm(side.mean(axis=0)) == pytest.approx(1e3, abs=0.5)
    np.testing.assert_allclose((source - source[0]) @ T[:3, :3].T, target - target[0], atol=1e-11)
