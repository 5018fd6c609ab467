"""A loop that goes to and fro within what the pose is known by has converged; one that goes farther has not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.registration.fit.loop_status import status_of
from dqreg.rigid import twist
from dqreg.trust import Information

WIDTH = 0.1
# Translation along y is held by a hundredth of what the other motions are: its standard deviation is ten times theirs.
VALUES = np.array([0.01, 1.0, 1.0, 1.0, 1.0, 1.0])
MOTIONS = np.roll(np.eye(6), -4, axis=1)
SIGMA = 10.0 * WIDTH / np.sqrt(100.0)


def ended(steps: list[np.ndarray], values: np.ndarray = VALUES) -> str:
    """Status of a run that stalled at the identity after steps, (6,) twists."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    history = [SimpleNamespace(T_target_source=twist.exp(step)) for step in steps]
    run = SimpleNamespace(status="stalled", history=history, mixture=SimpleNamespace(scale=WIDTH))
    information = Information(values, MOTIONS, 100.0, WIDTH, 1.0, np.zeros(3))
    return status_of(
        SimpleNamespace(
            run=run,
            prepared=SimpleNamespace(scan=PointCloud(points)),
            T_target_source=np.eye(4),
            information=information,
        )
    )  # type: ignore[arg-type]


def to_and_fro(motion: int, far: float) -> list[np.ndarray]:
    return [sign * far * np.eye(6)[motion] for sign in (1.0, -1.0)] * 10


@pytest.mark.parametrize("far", [0.5 * SIGMA, 0.99 * SIGMA, 1.01 * SIGMA, 3.0 * SIGMA])
def test_along_a_motion_that_little_holds_it_may_go_as_far_as_that_is_known(far: float) -> None:
    assert ended(to_and_fro(4, far)) == ("converged" if far < SIGMA else "stalled")


def test_a_motion_that_is_known_better_has_to_settle_down_to_the_noise() -> None:
    assert ended(to_and_fro(3, 0.5 * SIGMA)) == "stalled"
    assert ended(to_and_fro(3, 0.09 * WIDTH)) == "converged"


def test_what_nothing_holds_may_wander() -> None:
    free = np.where(np.arange(6) == 0, 0.0, VALUES)
    assert ended(to_and_fro(4, 3.0 * SIGMA), free) == "converged"


def test_a_run_that_is_short_or_far_from_its_end_once_has_stalled() -> None:
    assert ended(to_and_fro(4, 0.5 * SIGMA)[:9]) == "stalled"
    assert ended([*to_and_fro(4, 0.5 * SIGMA)[:9], 3.0 * SIGMA * np.eye(6)[4]]) == "stalled"
