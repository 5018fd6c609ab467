from __future__ import annotations

import numpy as np
import pytest

from dqreg.search.scoring import CLEAR_LOG_RATIO, CLEAR_POINTS, CLEAR_SUM_RATIO, PoseScores, symmetric_scores


def scores_of(*other: float | tuple[int, float]) -> PoseScores:
    """Log-likelihoods of 2,000 points: 0 under the first pose; under each other one so many have this instead."""
    rows = [np.zeros(2_000)]
    for changes in other:
        row, at = np.zeros(2_000), 0
        for count, value in changes:
            row[at : at + count], at = value, at + count
        rows.append(row)
    return PoseScores(np.array(rows), np.zeros((len(rows), 2_000)), 1.0)


@pytest.mark.parametrize(
    ("changes", "clearly"),
    [
        ([], False),
        # A notch: few points, all in favour of one pose.
        ([(CLEAR_POINTS, -2.0 * CLEAR_LOG_RATIO)], True),
        ([(CLEAR_POINTS - 1, -2.0 * CLEAR_LOG_RATIO)], False),
        # Noise, however many points of it.
        ([(1_000, -0.9 * CLEAR_LOG_RATIO)], False),
        # The part deviates from its model: some points favour either pose.
        ([(200, -2.0 * CLEAR_LOG_RATIO), (200, 2.0 * CLEAR_LOG_RATIO)], False),
        ([(200, -2.0 * CLEAR_LOG_RATIO), (int(200 / CLEAR_SUM_RATIO) - 1, 2.0 * CLEAR_LOG_RATIO)], True),
    ],
)
def test_few_points_that_all_favour_one_pose_decide(changes, clearly):
    found = scores_of(changes).distinguishable(0)
    # No pose is distinguishable from itself.
    assert found.tolist() == [False, clearly]


@pytest.mark.parametrize(
    ("on_the_first", "gaps", "told"),
    [
        # One hole, seen by three points, none of which is explained at the other pose.
        (True, (11.0, 11.0, 11.0), True),
        # Less than chance may give; two points; outliers, on the target at neither pose; one that says the opposite.
        (True, (6.0, 6.0, 6.0), False),
        (True, (11.0, 11.0), False),
        (False, (11.0, 11.0, 11.0), False),
        (True, (11.0, 11.0, 11.0, -11.0), False),
    ],
)
def test_few_points_decide_that_lie_on_the_target_at_one_pose_alone(on_the_first, gaps, told):
    likelihoods, distances = np.zeros((2, 2_000)), np.zeros((2, 2_000))
    for k, gap in enumerate(gaps):
        worse = int(gap > 0.0)
        likelihoods[worse, k] = -abs(gap)
        distances[worse, k], distances[1 - worse, k] = 20.0, 0.0 if on_the_first else 20.0
    scores = PoseScores(likelihoods, distances, 1.0)
    assert list(scores.distinguishable(0)) == [False, told]


def test_every_point_of_both_sides_has_the_same_weight():
    rng = np.random.default_rng(0)
    sides = [PoseScores(rng.normal(size=(3, n)), rng.random((3, n)), width) for n, width in ((400, 1.0), (100, 2.0))]
    both = symmetric_scores(*sides)
    np.testing.assert_allclose(both.means, 0.8 * sides[0].means + 0.2 * sides[1].means, rtol=1e-12)
    assert both.distances.shape == (3, 500)
    assert both.width == 1.0
