"""What a covariance of a pose is, at each door that takes one."""

from collections.abc import Callable

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.odometry.prediction import Prediction
from dqreg.rigid import pose
from dqreg.solvers import PoseCost

SIZES = [(1.0, 1.0), (1e-3, 1e6), (1e-4, 1e3), (1e2, 1e-5)]


def predicted(C: object) -> np.ndarray:
    return Prediction.of(np.eye(4), C).information


def believed(C: object) -> np.ndarray:
    return PoseCost.prior(np.eye(4), C).information(np.eye(4))


def fused(C: object) -> np.ndarray:
    # With a second pose of which all is known, whose information is one.
    found = pose.mean(np.stack([np.eye(4)] * 2), covariances=[C, np.eye(6)])
    return np.linalg.inv(found.covariance) - np.eye(6)


DOORS = [predicted, believed, fused]
Door = Callable[[object], np.ndarray]


def drawn(rng: np.random.Generator, turn: float, shift: float) -> np.ndarray:
    A = rng.normal(size=(6, 8))
    size = np.repeat([turn, shift], 3)
    return A @ A.T * size * size[:, None]


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(("turn", "shift"), SIZES)
def test_a_covariance_in_any_units_is_taken_and_inverted(door: Door, turn: float, shift: float) -> None:
    rng = np.random.default_rng(20065)
    size = np.repeat([turn, shift], 3)
    for _ in range(20):
        C = drawn(rng, turn, shift)
        unit = door(C) * size * size[:, None]
        # The information of the second pose takes digits where it is the larger one.
        atol = 1e-9 + 1e-12 * (door is fused) * max(turn, shift) ** 2
        np.testing.assert_allclose(unit, np.linalg.inv(C / size / size[:, None]), rtol=1e-6, atol=atol)


@pytest.mark.parametrize("door", DOORS)
def test_what_is_unknown_has_an_infinite_variance_and_no_information(door: Door) -> None:
    variances = np.array([1e-2, 1e-2, np.inf, 4.0, np.inf, np.inf])
    np.testing.assert_allclose(door(np.diag(variances)), np.diag(1.0 / variances), atol=1e-9)


@pytest.mark.parametrize("door", [predicted, believed])
def test_six_variances_are_a_covariance(door: Door) -> None:
    np.testing.assert_allclose(door([1, 1, 4, 1, 1, 4]), np.diag([1, 1, 0.25, 1, 1, 0.25]), atol=1e-12)


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({(0, 1): 9e-7, (1, 0): -9e-7, (0, 0): 1e-6, (1, 1): 1e-6, (5, 5): 1e4}, "symmetric"),
        ({(0, 1): 1.0, (1, 0): 1.0}, "positive definite"),
        ({(2, 2): 0.0}, "above 0"),
        ({(2, 2): np.nan}, "NaN"),
        ({(2, 2): np.inf, (2, 3): 0.1, (3, 2): 0.1}, "zeros beside"),
    ],
)
def test_what_is_none_is_refused_in_the_same_words(
    door: Door, changed: dict[tuple[int, int], float], words: str
) -> None:
    C = np.eye(6)
    for at, value in changed.items():
        C[at] = value
    with pytest.raises(InputError, match=words):
        door(C)


def test_what_neither_frame_nor_prediction_knows_is_nan_and_does_not_move_the_pose() -> None:
    # The frame knows all but the places along x and z; the prediction x alone, 7 above, where a turn displaces it.
    expected = Prediction.of(
        pose.from_parts(np.eye(3), [0.5, 0.0, 7.0]), [np.inf, np.inf, np.inf, 0.01, np.inf, np.inf]
    )
    T, covariance = expected.fused(np.eye(4), np.diag([1e4, 1e4, 1e4, 0.0, 1e4, 0.0]))
    np.testing.assert_allclose(T[:3, 3], [0.5, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.diag(covariance), [1e-4, 1e-4, 1e-4, 0.01 + 1e-4 * 7.0**2, 1e-4, np.nan], rtol=1e-9)
    assert expected.spread == np.inf
    assert Prediction.of(np.eye(4), [np.inf, 1, 1, 0.01, 0.04, 0.01]).spread == pytest.approx(3 * 0.2)
