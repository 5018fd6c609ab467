from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from dqreg.rigid import pose
from dqreg.solvers.cramer_rao import covariance_of_weights, cramer_rao, rms_of, weighted_information


@pytest.fixture
def problem():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(4, 3))
    return rng.normal(size=(5, 3)), directions / np.linalg.norm(directions, axis=1, keepdims=True), rng.normal(size=3)


def test_information_is_the_curvature_of_the_log_likelihood(problem):
    # Oracle: Jacobian by finite differences of all residuals, each over its sigma.
    points, directions, centre = problem
    sigma_p, sigma_n = 0.1, 0.02

    def residuals(twist):
        moved = pose.about(pose.exp(twist), centre)
        return np.concatenate(
            [
                (pose.apply(moved, points) - points).ravel() / sigma_p,
                (pose.rotate(moved, directions) - directions).ravel() / sigma_n,
            ]
        )

    J = approx_fprime(np.zeros(6), residuals, 1e-7)
    information = weighted_information(points, directions, centre, sigma_p**-2, sigma_n**-2)
    np.testing.assert_allclose(information, J.T @ J, rtol=1e-5, atol=1e-5 * np.abs(information).max())


def test_no_weights_undercut_the_bound_and_likelihood_reaches_it(problem):
    sigmas = (0.1, 0.02)
    best = cramer_rao(*problem, *sigmas)
    for beta in np.geomspace(1e-6, 1e6, 13):
        excess = covariance_of_weights(*problem, sigmas, (beta, 1.0)) - best
        assert np.linalg.eigvalsh(excess).min() > -1e-12
    likely = covariance_of_weights(*problem, sigmas, (sigmas[0] ** -2, sigmas[1] ** -2))
    np.testing.assert_allclose(likely, best, rtol=1e-9, atol=1e-15)


def test_the_rotation_bound_does_not_depend_on_the_centre(problem):
    points, directions, centre = problem
    here, there = (rms_of(cramer_rao(points, directions, c, 0.1, 0.02)) for c in (centre, centre + 10.0))
    assert here[0] == pytest.approx(there[0], rel=1e-9)
    assert here[1] < there[1]
