"""Gaps between angles round an axis."""

import numpy as np

from dqreg.geometry.angles import gaps_around


def test_gaps_close_the_round_and_turn_with_the_angles() -> None:
    angles = np.random.default_rng(20_065).uniform(-np.pi, np.pi, (50, 7))
    ordered, gaps = gaps_around(angles)
    assert (gaps >= 0.0).all()
    np.testing.assert_allclose(gaps.sum(axis=1), 2.0 * np.pi, atol=1e-12)
    np.testing.assert_array_equal(np.diff(ordered, axis=1), gaps[:, :-1])
    # The widest one is the same wherever the round begins.
    turned = (angles + 1.234 + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(gaps_around(turned)[1].max(axis=1), gaps.max(axis=1), atol=1e-12)
    np.testing.assert_array_equal(gaps_around(angles[3])[1], gaps[3])
