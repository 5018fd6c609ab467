"""Where a frame is expected: as constant velocity leads, or as the change of the motion does."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry.spacing import Spread
from dqreg.odometry.starts import REMEMBERED_FRAMES, Pace
from dqreg.rigid import twist

SPREAD = Spread.of(np.random.default_rng(0).normal(size=(100, 3)))


def driven(pace: Pace, changes: list[float]) -> float:
    """Drive on with a turn that changes so much from frame to frame; how far off the last one was expected."""
    T, motion, turn = np.eye(4), np.eye(4), 0.0
    for change in changes:
        turn += change
        expected, _ = pace.expect(T, motion, 1.0)
        before, motion = motion, twist.exp(np.array([0.0, 0.0, turn, 1.0, 0.0, 0.0]))
        T = T @ motion
        pace.learn(SPREAD, T, before, motion)
    return SPREAD.motion(expected, T)


def test_a_turn_that_grows_steadily_is_foreseen() -> None:
    assert driven(Pace(), [0.02] * (REMEMBERED_FRAMES + 3)) < 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_that_jerks_to_and_fro_is_taken_to_stay(sign: float) -> None:
    # Its change goes on nowhere: twice as far off as where nothing changes.
    jerks = [sign * 0.02 * (-1.0) ** k for k in range(REMEMBERED_FRAMES + 3)]
    stays = SPREAD.motion(twist.exp(np.zeros(6)), twist.exp(np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])))
    assert driven(Pace(), jerks) < 1.1 * stays


def test_what_others_expect_is_what_is_remembered() -> None:
    pace = Pace()
    pace.leave(twist.exp(np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0])))
    pace.learn(SPREAD, np.eye(4), np.eye(4), np.eye(4))
    assert pace.off == pytest.approx(0.5)
    assert pace.steps == 1
