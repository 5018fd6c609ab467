"""What was checked when a result was made stays so: its arrays cannot be written to, the caller's own can."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg import solvers
from dqreg.rigid import pose
from dqreg.trust.records import Alternative
from tests.icp.scenes import bracket_mesh, bracket_points
from tests.multiway.edges_of_truth import registration

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
MOTIONS = pose.random(np.random.default_rng(0), reach=1.0, shape=(6,))


def registered() -> dqreg.Registration:
    return dqreg.register(bracket_points(25, seed=0), bracket_mesh(), "identity", effort="fast")


RESULTS: dict[str, Any] = {
    "a registration": registered,
    "one made by hand": lambda: registration(np.eye(4), np.eye(6), np.zeros(3)),
    "an iteration": lambda: registered().history[0],
    "an alternative": lambda: Alternative(np.eye(4), 0.1),
    "a fit": lambda: dqreg.solve(POINTS, POINTS),
    "the fit of 1991": lambda: solvers.walker1991(POINTS, POINTS),
    "a fit of a cost": lambda: dqreg.PoseCost.points(POINTS, POINTS).minimise(),
    "a rotation": lambda: solvers.solve_rotation(POINTS[1:], POINTS[1:]),
    "a calibration": lambda: solvers.hand_eye(MOTIONS, MOTIONS),
}


@pytest.mark.parametrize("name", RESULTS)
def test_the_arrays_of_a_result_cannot_be_written_to(name: str) -> None:
    result = RESULTS[name]()
    names = [*vars(result), *({"covariance"} if hasattr(result, "covariance") else ())]
    arrays = {key: getattr(result, key) for key in names if isinstance(getattr(result, key), np.ndarray)}
    assert arrays
    for array in arrays.values():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_what_a_result_was_made_of_stays_the_callers() -> None:
    T, covariance = np.eye(4), np.eye(6)
    registration(T, covariance, np.zeros(3))
    T[0, 3] = covariance[0, 0] = 2.0
    assert (T[0, 3], covariance[0, 0]) == (2.0, 2.0)
