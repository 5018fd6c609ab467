"""`PoseCost.prior`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost
from tests.solvers.cost_cases import frames, mixed, numeric_slopes
from tests.solvers.problems import fast
from tests.strategies import poses

SEEDS = st.integers(0, 1000)


def covariance(seed: int, size: float = 1.0) -> np.ndarray:
    A = np.random.default_rng(seed).normal(size=(6, 8))
    return size * (A @ A.T / 8.0 + 0.05 * np.eye(6))


def moved(frame: np.ndarray, six: np.ndarray, T: np.ndarray) -> np.ndarray:
    return frame @ pose.exp(six) @ pose.inverse(frame) @ T


@fast
@given(SEEDS, SEEDS, SEEDS)
def test_its_information_is_the_inverse_of_the_covariance(seed: int, at: int, frame: int) -> None:
    C, T, F = covariance(seed), frames(at), frames(frame)
    prior = PoseCost.prior(T, C, F)
    information = prior.information(T, F)
    np.testing.assert_allclose(information @ C, np.eye(6), atol=1e-10)
    np.testing.assert_allclose(prior.hessian(T, F), 2.0 * information, atol=1e-11 * np.abs(information).max())
    assert prior.value(T) <= 1e-13 * prior.form.scale
    assert np.abs(prior.gradient(T, F)).max() <= 1e-12 * np.abs(information).max() * 10


@fast
@given(SEEDS, SEEDS, st.floats(-4.0, -1.0))
def test_near_its_pose_it_is_the_squared_twist(seed: int, at: int, exponent: float) -> None:
    C, T, F = covariance(seed), frames(at), frames(at + 1)
    six = 10.0**exponent * np.random.default_rng(seed).normal(size=6)
    expected = six @ np.linalg.solve(C, six)
    # What is left out is of third order in the twist.
    assert (
        abs(PoseCost.prior(T, C, F).value(moved(F, six, T)) - expected)
        <= 3.0 * np.linalg.norm(six) * 40.0 * expected + 1e-12
    )


@pytest.mark.parametrize("frame", [np.eye(4), frames(1)], ids=["target", "frame"])
def test_its_slopes_agree_with_finite_differences(frame: np.ndarray) -> None:
    prior, T = PoseCost.prior(frames(2), covariance(3), frame), frames(5)
    gradient, hessian = numeric_slopes(lambda x: prior.value(moved(frame, x, T)), 1e-3)
    size = np.abs(hessian).max()
    np.testing.assert_allclose(prior.gradient(T, frame), gradient, atol=1e-9 * size)
    np.testing.assert_allclose(prior.hessian(T, frame), hessian, atol=1e-5 * size)


@fast
@given(SEEDS, poses())
def test_its_only_minimum_is_its_pose(seed: int, T: np.ndarray) -> None:
    T[:3, 3] %= 10.0
    cost = PoseCost.prior(T, covariance(seed))
    np.testing.assert_allclose(cost.minimise().T_target_source, T, atol=1e-9)
    # Also from half a turn away.
    away = pose.about(pose.exp([np.pi, 0, 0, 1, 2, 3]), T[:3, 3]) @ T
    np.testing.assert_allclose(cost.minimise(near=away).T_target_source, T, atol=1e-9)


def test_turns_count_by_twice_the_sine_of_half_the_angle() -> None:
    variances = [0.01, 0.04, 0.09, 1, 1, 1]
    for k, angle_rad in enumerate([0.3, 2.0, np.pi]):
        T = pose.exp(np.r_[angle_rad * np.eye(3)[k], 0, 0, 0])
        expected = (2.0 * np.sin(angle_rad / 2.0)) ** 2 / variances[k]
        assert PoseCost.prior(np.eye(4), variances).value(T) == pytest.approx(expected, rel=1e-12)


@fast
@given(SEEDS, SEEDS)
def test_the_information_of_data_and_prior_is_their_sum(seed: int, at: int) -> None:
    case, prior, T = mixed(seed), PoseCost.prior(frames(at), covariance(seed)), frames(at + 1)
    total = case.cost.information(T) + prior.information(T)
    np.testing.assert_allclose((case.cost + prior).information(T), total, atol=1e-12 * np.abs(total).max())


def test_a_strong_prior_pins_and_a_weak_one_vanishes() -> None:
    case = mixed(1, 0.5, noise=0.1)
    believed = case.truth @ pose.exp([0.1, -0.2, 0.1, 0.3, 0.2, -0.1])
    alone = case.cost.minimise().T_target_source
    strong = (case.cost + PoseCost.prior(believed, 1e-12 * np.ones(6))).minimise().T_target_source
    weak = (case.cost + PoseCost.prior(believed, 1e12 * np.ones(6))).minimise().T_target_source
    # The pull of the other side, some 100, times the variance.
    np.testing.assert_allclose(strong, believed, atol=1e-9)
    np.testing.assert_allclose(weak, alone, atol=1e-9)
    between = (case.cost + PoseCost.prior(believed, 0.01 * np.ones(6))).minimise().T_target_source
    assert 0.01 < pose.angle_between(between, alone) < pose.angle_between(believed, alone)
    assert 0.01 < pose.angle_between(between, believed) < pose.angle_between(believed, alone)


def test_linear_gaussian_data_and_prior_meet_where_bayes_says() -> None:
    # Shifts only: everything is linear, so the posterior mean is the weighted mean of both.
    rng = np.random.default_rng(0)
    p, seen, believed = rng.normal(size=(10, 3)), np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0, -1.0])
    C = covariance(4)[3:, 3:]
    full = np.eye(6)
    full[3:, 3:] = C
    cost = PoseCost.points(p, p + seen, weights=4.0) + PoseCost.prior(pose.from_parts(np.eye(3), believed), full)
    fit = cost.minimise(dof="t", reference=np.eye(4))
    posterior = np.linalg.solve(40.0 * np.eye(3) + np.linalg.inv(C), 40.0 * seen + np.linalg.solve(C, believed))
    np.testing.assert_allclose(fit.T_target_source[:3, 3], posterior, atol=1e-12)


def test_what_is_not_known_is_left_to_the_data() -> None:
    inf = np.inf
    level = PoseCost.prior(np.eye(4), [1e-4, 1e-4, inf, inf, inf, 1e-2])
    # Any turn about z and any shift along the floor are as good.
    for yaw in (0.3, 2.0, np.pi):
        T = pose.from_parts(pose.exp([0, 0, yaw, 0, 0, 0])[:3, :3], [3.0, -2.0, 0.0])
        assert level.value(T) == pytest.approx(0.0, abs=1e-9)
        # A tilt of one sigma; at y = -2 it lowers the part by 0.02, a fifth of a sigma.
        tilted = pose.exp([0.01, 0, 0, 0, 0, 0]) @ T
        assert level.value(tilted) == pytest.approx(1.0 + 0.04, rel=1e-3)
    np.testing.assert_allclose(np.diag(level.information(np.eye(4))), [1e4, 1e4, 0, 0, 0, 1e2], atol=1e-9)


def test_a_prior_holds_what_the_features_leave_free() -> None:
    # A shaft: planes along a cylinder, a million of weight, and a weak belief about spin and slide.
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * np.pi, 300)
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    p = ring + np.outer(rng.uniform(-1, 1, 300), [0, 0, 1])
    truth = pose.exp([0.1, 0.2, 0.0, 0.3, 0.1, 0.2])
    shaft = PoseCost.planes(p, pose.apply(truth, p), pose.rotate(truth, ring), weights=1e6)
    believed = truth @ pose.exp([0, 0, 0.2, 0, 0, 0.4])
    fit = (shaft + PoseCost.prior(believed, np.ones(6), frame=truth)).minimise()
    found = Freedom.only("all", frame=truth).coordinates(fit.T_target_source, truth)
    assert found[5] == pytest.approx(0.4, abs=1e-6)
    np.testing.assert_allclose(found[[0, 1, 3, 4]], 0.0, atol=1e-4)


@fast
@given(SEEDS, SEEDS)
def test_a_prior_moves_with_its_frame(seed: int, at: int) -> None:
    # The same belief about another frame: the covariance is carried by the adjoint.
    C, T, F = covariance(seed), frames(at), frames(at + 2)
    carried = pose.adjoint(F) @ C @ pose.adjoint(F).T
    a, b = PoseCost.prior(T, C, F).information(T), PoseCost.prior(T, carried).information(T)
    np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(a).max())


BAD = [
    (np.eye(5), "6x6 matrix"),
    (np.eye(6) * np.nan, "infinite variance"),
    (np.zeros((6, 6)), "variances above 0"),
    (-np.eye(6), "variances above 0"),
    (np.eye(6) + np.eye(6, k=1), "symmetric"),
    (np.ones((6, 6)), "positive definite"),
    (np.diag([np.inf] * 6) + 0.1 * (1 - np.eye(6)), "zeros beside"),
]


@pytest.mark.parametrize(("given_covariance", "words"), BAD)
def test_bad_covariances_are_named(given_covariance: np.ndarray, words: str) -> None:
    with np.errstate(invalid="ignore"), pytest.raises(InputError) as error:
        PoseCost.prior(np.eye(4), given_covariance)
    assert words in str(error.value)
