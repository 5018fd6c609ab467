from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.solvers import likelihood_weights, normal_variance, solve, solve_many
from dqreg.solvers.cramer_rao import cramer_rao
from tests.solvers.problems import TETRAHEDRON


def test_weights_are_one_over_the_variance():
    beta, alpha = likelihood_weights([0.5, 2.0], [0.01, np.inf])
    np.testing.assert_allclose(beta, [4.0, 0.25], rtol=1e-15)
    np.testing.assert_allclose(alpha, [100.0, 0.0], rtol=1e-15)


def test_without_directions_there_are_no_weights_of_them():
    assert likelihood_weights(0.5).direction_weights.shape == (0,)


def test_shared_neighbours_divide_alpha():
    alone, shared = (likelihood_weights(1.0, [0.1, 0.2], shared_neighbours=k).direction_weights for k in (1, 20))
    np.testing.assert_allclose(shared, alone / 20, rtol=1e-15)


def test_a_fitted_normal_scatters_as_the_formula_says():
    # A plane fitted by least squares to 400 fixed places of standard deviations 2 and 0.5, noise 0.01 off the plane.
    # 4,000 fits tell a variance to 2 % (one sigma), which the tolerance exceeds four times over.
    rng = np.random.default_rng(11)
    at = rng.normal(size=(400, 2)) * [2.0, 0.5]
    at -= at.mean(axis=0)
    heights = rng.normal(scale=0.01, size=(400, 4000))
    slopes = np.linalg.lstsq(at, heights, rcond=None)[0]
    covariance = np.linalg.eigvalsh(np.cov(at.T, bias=True))
    predicted = normal_variance(0.01, covariance, 400)
    # Per tilt axis: the mean over both slopes, not their sum.
    assert (slopes**2).mean() == pytest.approx(predicted, rel=0.08)


@pytest.mark.parametrize("elongation", [1.0, 1.2])
def test_fitted_normals_with_the_weights_of_their_formula_reach_the_bound(elongation):
    """The two functions mean the same sigma: fed into each other they lose less than 1 % against Cramer-Rao.

    The noise is such that points and normals hold the rotation about equally, where a factor of two in alpha costs
    most: 2 to 5 %. 20,000 trials know an rms of three angles to 0.3 %. A patch longer than wide tilts unlike both
    ways, which no single weight can use; its bound is taken for the mean of both.
    """
    rng = np.random.default_rng(21)
    trials, patches, k, sigma_p, sigma_r = 20_000, 6, 24, 0.02, 0.02
    p = rng.uniform(-1, 1, (5, 3))
    frames = np.linalg.qr(rng.normal(size=(patches, 3, 3)))[0]
    # k places of a patch: standard deviations exactly 0.5 and 0.5 / elongation, uncorrelated.
    places = np.linalg.qr(rng.normal(size=(k, 2)) - rng.normal(size=(k, 2)).mean(axis=0))[0]
    places -= places.mean(axis=0)
    places = np.linalg.qr(places)[0] * np.sqrt(k) * [0.5, 0.5 / elongation]
    heights = sigma_r * rng.normal(size=(k, trials * patches))
    slopes = (np.linalg.pinv(places) @ heights).reshape(2, trials, patches)
    tilted = np.stack([-slopes[0], -slopes[1], np.ones_like(slopes[0])], axis=-1)
    n = np.einsum("pij,tpj->tpi", frames, tilted / np.linalg.norm(tilted, axis=-1, keepdims=True))
    m = np.broadcast_to(frames[:, :, 2], n.shape)
    sigma2 = normal_variance(sigma_r, [0.25, 0.25 / elongation**2], k)
    beta, alpha = likelihood_weights(sigma_p, sigma2)
    q = p + sigma_p * rng.normal(size=(trials, 5, 3))
    fits = solve_many(np.broadcast_to(p, q.shape), q, m, n, beta, alpha)
    R = fits.T_target_source[:, :3, :3]
    angles = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]])
    per_axis = float(np.mean(slopes**2))
    bound = cramer_rao(p, frames[:, :, 2], p.mean(axis=0), sigma_p, np.sqrt(per_axis))
    rms = np.sqrt((angles**2).sum(axis=0).mean())
    assert rms / np.sqrt(np.trace(bound[:3, :3])) == pytest.approx(1.0, abs=0.01)


def test_weights_of_maximum_likelihood_scatter_least():
    # Half of the points are ten times as noisy; weights from the noise must beat equal ones by a wide margin.
    rng = np.random.default_rng(4)
    p = rng.uniform(-1, 1, (40, 3))
    sigma = np.repeat([0.01, 0.1], 20)
    beta = likelihood_weights(sigma).point_weights
    weighed, plain = [], []
    for _ in range(200):
        q = p + rng.normal(size=p.shape) * sigma[:, None]
        weighed.append(solve(p, q, point_weights=beta).T_target_source[:3])
        plain.append(solve(p, q).T_target_source[:3])
    assert np.std(weighed, axis=0).sum() < 0.4 * np.std(plain, axis=0).sum()


def test_a_narrow_strip_has_an_uncertain_normal():
    wide, narrow, line = normal_variance(0.1, [[1.0, 1.0], [1.0, 1e-4], [1.0, 0.0]], 10)
    assert narrow > 1000 * wide
    assert line == np.inf
    alpha = likelihood_weights(0.1, [wide, narrow, line]).direction_weights
    assert alpha[2] == 0.0
    solve(TETRAHEDRON, TETRAHEDRON, np.eye(3), np.eye(3), direction_weights=alpha)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: likelihood_weights(0.0), "point_sigma must be positive"),
        (lambda: likelihood_weights([1.0, -1.0]), "the smallest is -1"),
        (lambda: likelihood_weights(float("nan")), "NaN"),
        (lambda: likelihood_weights(float("inf")), "infinite"),
        (lambda: likelihood_weights(1.0, 0.0), "direction_variance must be positive"),
        (lambda: likelihood_weights(1.0, float("nan")), "NaN"),
        (lambda: likelihood_weights(1.0, [1.0], shared_neighbours=0.5), "1 or more"),
        (lambda: likelihood_weights(1.0, [1.0], shared_neighbours=[2, 3]), "one per direction"),
        (lambda: normal_variance(0.0, [1, 1], 5), "residual_sigma must be positive"),
        (lambda: normal_variance(1.0, [1, 1, 1], 5), "two numbers"),
        (lambda: normal_variance(1.0, [1, -1], 5), "must not be negative"),
        (lambda: normal_variance(1.0, [1, 1], 2), "3 or more"),
    ],
)
def test_bad_numbers_are_named(call, words):
    with pytest.raises(InputError, match=words):
        call()
