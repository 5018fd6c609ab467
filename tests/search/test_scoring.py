from __future__ import annotations

import numpy as np
import pytest

from dqreg.search.scoring import CLEAR, UNANIMOUS, WITNESSES, Judgement, both_ways


def judgement(*other: float | tuple[int, float]) -> Judgement:
    """Log-likelihoods of 2,000 points: 0 under the first pose; under each other one so many have this instead."""
    rows = [np.zeros(2_000)]
    for changes in other:
        row, at = np.zeros(2_000), 0
        for count, value in changes:
            row[at : at + count], at = value, at + count
        rows.append(row)
    return Judgement(np.array(rows), np.zeros((len(rows), 2_000)), 1.0)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ([], False),
        # A notch: few points, all of one opinion.
        ([(WITNESSES, -2.0 * CLEAR)], True),
        ([(WITNESSES - 1, -2.0 * CLEAR)], False),
        # Noise, however many points of it.
        ([(1_000, -0.9 * CLEAR)], False),
        # The part is not quite its drawing: points speak for either pose.
        ([(200, -2.0 * CLEAR), (200, 2.0 * CLEAR)], False),
        ([(200, -2.0 * CLEAR), (int(200 / UNANIMOUS) - 1, 2.0 * CLEAR)], True),
    ],
)
def test_what_few_points_say_with_one_voice_decides(changes, told):
    found = judgement(changes).told_apart(0)
    # No pose is told apart from itself.
    assert found.tolist() == [False, told]


def test_both_sides_have_as_much_to_say_as_they_have_points():
    rng = np.random.default_rng(0)
    sides = [Judgement(rng.normal(size=(3, n)), rng.random((3, n)), width) for n, width in ((400, 1.0), (100, 2.0))]
    both = both_ways(*sides)
    np.testing.assert_allclose(both.means, 0.8 * sides[0].means + 0.2 * sides[1].means, rtol=1e-12)
    assert both.distances.shape == (3, 500)
    assert both.width == 1.0
