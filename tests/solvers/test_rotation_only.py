from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.solvers import likelihood_weights, solve_rotation
from tests.solvers.exact_oracle import EPS, angle_between, best_rotation, random_rotation


def drawn(seed, count=5, noise=0.0):
    rng = np.random.default_rng(seed)
    m, R = rng.normal(size=(count, 3)), random_rotation(rng)
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    return m, m @ R.T + noise * rng.normal(size=m.shape), R, rng.uniform(0.5, 2.0, count)


@pytest.mark.parametrize("seed", range(5))
def test_the_rotation_is_that_of_scipy(seed):
    m, n, _, w = drawn(seed, noise=0.1)
    fit = solve_rotation(m, n, w)
    theirs, root = Rotation.align_vectors(n, m, w)
    np.testing.assert_allclose(fit.R_target_source, theirs.as_matrix(), rtol=0, atol=1e-14)
    assert fit.cost == pytest.approx(root**2, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_an_exact_direction_is_met_and_the_rest_is_that_of_scipy(seed):
    m, n, _, w = drawn(seed, noise=0.1)
    w[2] = np.inf
    fit = solve_rotation(m, n, w)
    np.testing.assert_allclose(fit.R_target_source @ m[2], n[2] / np.linalg.norm(n[2]), rtol=0, atol=1e-15)
    np.testing.assert_allclose(fit.R_target_source, Rotation.align_vectors(n, m, w)[0].as_matrix(), rtol=0, atol=1e-14)
    # The limit of ever larger weights.
    w[2] = 1e12
    np.testing.assert_allclose(fit.R_target_source, solve_rotation(m, n, w).R_target_source, rtol=0, atol=1e-10)
    assert fit.covariance @ fit.R_target_source @ m[2] == pytest.approx(
        np.trace(fit.covariance) * n[2] / np.linalg.norm(n[2]), rel=1e-9
    )


def test_two_exact_directions_leave_nothing_open():
    m, n, R, _ = drawn(1)
    n[2:] = np.random.default_rng(0).normal(size=(3, 3))
    fit = solve_rotation(m, n, [np.inf, np.inf, 1, 1, 1])
    np.testing.assert_allclose(fit.R_target_source, R, rtol=0, atol=1e-14)
    assert not fit.covariance.any()


@pytest.mark.parametrize("apart_rad", [1e-2, 1e-5, 1e-7])
def test_two_directions_nearly_parallel_keep_their_digits(apart_rad):
    rng = np.random.default_rng(2)
    V, R = random_rotation(rng), random_rotation(rng)
    m = np.array([[1.0, 0, 0], [np.cos(apart_rad), np.sin(apart_rad), 0]]) @ V.T
    exact = best_rotation(None, (m, m @ R.T))
    assert angle_between(solve_rotation(m, m @ R.T).R_target_source, exact) < 20 * EPS / apart_rad


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("fixed", [False, True])
def test_errors_are_as_large_as_the_covariance_says(absolute, fixed):
    # Mean of a chi-square with three degrees of freedom (one beside an exact direction) over 200 trials.
    rng, sigma, trials = np.random.default_rng(31), 0.01, 200
    m, n, R, _ = drawn(4, 30)
    total = 0.0
    alpha = np.full(30, likelihood_weights(1.0, sigma**2).direction_weights)
    if fixed:
        alpha[0] = np.inf
    for _ in range(trials):
        seen = n + np.cross(sigma * rng.normal(size=n.shape), n)
        seen[0] = n[0] if fixed else seen[0]
        fit = solve_rotation(m, seen, alpha, absolute_weights=absolute)
        e = Rotation.from_matrix(R @ fit.R_target_source.T).as_rotvec()
        total += e @ np.linalg.pinv(fit.covariance, hermitian=True, rcond=1e-9) @ e
    freedoms = 1 if fixed else 3
    assert total / trials == pytest.approx(freedoms, abs=3.5 * np.sqrt(2 * freedoms / trials) + 0.06)


BAD = {
    "parallel": (DegenerateGeometryError, ([[0, 0, 1], [0, 0, 2]], [[1, 0, 0], [2, 0, 0]]), "parallel: add one across"),
    "one": (DegenerateGeometryError, ([[0, 0, 1]], [[1, 0, 0]]), "for a rotation alone, two directions"),
    "reversed": (DegenerateGeometryError, (np.eye(3), -np.eye(3)), "check the handedness"),
    "exact alone": (DegenerateGeometryError, (np.eye(3)[:1], np.eye(3)[:1], np.inf), "Add a direction across it"),
    "NaN weight": (InputError, (np.eye(3), np.eye(3), np.nan), "NaN"),
    "negative": (InputError, (np.eye(3), np.eye(3), [1, -1, 1]), "must not be negative"),
    "minus infinity": (InputError, (np.eye(3), np.eye(3), [1, -np.inf, 1]), "weights"),
    "none": (InputError, (np.zeros((0, 3)), np.zeros((0, 3))), "no rows"),
    "zero exact": (InputError, ([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0]], [np.inf, 1]), "length zero"),
    "huge exact": (InputError, (np.eye(3) * 1e200, np.eye(3), [np.inf, 1, 1]), "unit length"),
    "huge": (InputError, (np.eye(3) * 1e200, np.eye(3)), "unit length"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_solved_is_named(case):
    error, arguments, words = BAD[case]
    with pytest.raises(error, match=words):
        solve_rotation(*arguments)
