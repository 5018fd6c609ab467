"""The covariance of a fit: consistent with the errors of simulated measurements, and the same from every solver."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.rigid import pose
from dqreg.solvers import cramer_rao, horn, likelihood_weights, solve, solve_many, solve_moments, svd, walker1991
from dqreg.solvers.moments import moments_of
from dqreg.solvers.uncertainty import residual_variance
from tests.solvers.exact_oracle import random_rotation

# Mean of a chi-square with six degrees of freedom over 2,000 trials: 6 with a standard error of sqrt(12 / 2000) = 0.08.
TRIALS, SIX, ALLOWED = 2000, 6.0, 0.2
SIGMA_P, SIGMA_N = 0.01, 0.004
KINDS = {"points": (8, 0), "directions": (1, 6), "points and directions": (4, 4)}


def measured(rng, n, m, trials=TRIALS):
    """Points and directions, the true pose, and noisy measurements of them."""
    p, d = rng.uniform(-1, 1, (n, 3)), rng.normal(size=(m, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    T = pose.from_parts(random_rotation(rng), [3.0, -2.0, 5.0])
    q = pose.apply(T, p) + SIGMA_P * rng.normal(size=(trials, n, 3))
    seen = pose.rotate(T, d) if m else d
    tilts = SIGMA_N * rng.normal(size=(trials, m, 3))
    seen = seen + np.cross(tilts, seen)
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    return p, d, T, q, seen


def errors(T_true, T, centre):
    """Twists of ``T_true = about(exp(e), centre) @ T``, (..., 6)."""
    local = np.broadcast_to(np.eye(4), T.shape).copy()
    local[..., :3, 3] = -centre
    back = local.copy()
    back[..., :3, 3] = centre
    return pose.log(local @ T_true @ pose.inverse(T) @ back)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("absolute", [True, False])
def test_errors_are_as_large_as_the_covariance_says(kind, absolute):
    rng = np.random.default_rng(101)
    n, m = KINDS[kind]
    # Where the residuals give the scale, enough of them that their own scatter is below the tolerance.
    n, m = (n, m) if absolute else (n * 25, m * 25)
    p, d, T, q, seen = measured(rng, n, m)
    beta, alpha = likelihood_weights(SIGMA_P, SIGMA_N**2)
    factor = 1.0 if absolute else 7.0
    b, a = (np.full((TRIALS, k), factor * w) for k, w in ((n, beta), (m, alpha)))
    sides = (np.broadcast_to(d, seen.shape), seen) if m else (None, None)
    fits = solve_many(np.broadcast_to(p, q.shape), q, *sides, b, a if m else None, absolute_weights=absolute)
    e = errors(T, fits.T_target_source, fits.centre)
    nees = np.einsum("ti,tij,tj->t", e, np.linalg.inv(fits.covariance), e)
    assert nees.mean() == pytest.approx(SIX, abs=ALLOWED)
    # And no larger than it need be.
    bound = cramer_rao(pose.apply(T, p), pose.rotate(T, d) if m else None, None, SIGMA_P, SIGMA_N)
    mean = fits.covariance.mean(axis=0)
    np.testing.assert_allclose(mean.diagonal(), bound.diagonal(), rtol=0.03)


@pytest.mark.parametrize("absolute", [True, False])
def test_every_solver_reports_the_same_covariance(absolute):
    rng = np.random.default_rng(5)
    p, d, _, q, seen = measured(rng, 6, 4, trials=1)
    beta, alpha = rng.uniform(1, 3, 6), rng.uniform(1, 3, 4)
    beta[2] = 0.0
    rows = (p, q[0], d, seen[0], beta, alpha)
    fit = solve(*rows, absolute_weights=absolute)
    many = solve_many(*(side[None] for side in rows), absolute_weights=absolute)
    expected = fit.covariance
    others = [
        svd(*rows, absolute_weights=absolute),
        horn(*rows, absolute_weights=absolute),
        walker1991(*rows[:4], 4 * beta, alpha, absolute_weights=absolute),
    ]
    for other in others:
        np.testing.assert_allclose(other.covariance, expected, rtol=1e-9, atol=1e-12 * expected.max())
        np.testing.assert_allclose(other.centre, fit.centre, rtol=1e-12)
    np.testing.assert_allclose(many.covariance[0], expected, rtol=1e-9, atol=1e-12 * expected.max())
    np.testing.assert_allclose(many.centre[0], fit.centre, rtol=1e-12)
    # From the residuals: five points and four directions leave 15 + 8 - 6 of them.
    scale = 1.0 if absolute else fit.cost / 17
    np.testing.assert_allclose(expected, scale * _by_information(fit, *rows), rtol=0, atol=0.02 * expected.max())
    alone = solve_moments(moments_of(p, q[0], d, seen[0], beta, alpha))
    np.testing.assert_allclose(alone.covariance * scale, expected, rtol=1e-9)


def _by_information(fit, p, q, m, n, beta, alpha):
    from dqreg.solvers import PoseCost

    cost = PoseCost.points(p, q, beta) + PoseCost.directions(m, n, alpha)
    return np.linalg.inv(cost.information(fit.T_target_source, fit.centre))


def test_a_narrow_strip_knows_how_little_it_knows_of_its_roll():
    rng = np.random.default_rng(8)
    for width in (1e-3, 1e-7):
        p = rng.uniform(-1, 1, (12, 3)) * [1.0, width, width]
        R = random_rotation(rng)
        fit = solve(p @ R.T, p, point_weights=1.0, absolute_weights=True)
        away = p - p.mean(axis=0)
        # In the target's axes, nearly those of the strip, the information keeps its digits once it is scaled.
        K = (away**2).sum() * np.eye(3) - away.T @ away
        K[0, 0] = (away[:, 1:] ** 2).sum()
        scale = np.sqrt(K.diagonal())
        exact = np.linalg.inv(K / scale / scale[:, None]) / scale / scale[:, None]
        assert fit.covariance[0, 0] == pytest.approx(exact[0, 0], rel=1e-6)
        many = solve_many((p @ R.T)[None], p[None], absolute_weights=True)
        assert many.covariance[0, 0, 0] == pytest.approx(fit.covariance[0, 0], rel=1e-6)


def test_noise_about_a_line_leaves_a_roll_without_bounds():
    # Turned by any angle about its line, and saying so: the standard deviation is a fifth of a radian and more.
    rng = np.random.default_rng(9)
    line = np.outer(np.linspace(-1, 1, 20), [1.0, 0, 0])
    for noise in (1e-1, 1e-3, 1e-6):
        p, q = line + noise * rng.normal(size=line.shape), line + noise * rng.normal(size=line.shape)
        assert np.sqrt(solve(p, q).covariance[0, 0]) > 0.2


def test_no_residual_left_no_covariance():
    # One point and two directions: seven numbers, six of them used. Without a residual the scale is unknown.
    one = np.zeros((1, 3))
    assert np.isfinite(solve(one, one, np.eye(3)[:2], np.eye(3)[:2]).covariance).all()
    assert np.isnan(residual_variance(1.0, 2, 0))
    degenerate = solve_many(np.zeros((1, 3, 3)), np.zeros((1, 3, 3)))
    assert np.isnan(degenerate.covariance).all()
