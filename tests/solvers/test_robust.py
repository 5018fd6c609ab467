from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.kernels.search.many_poses import log_likelihoods
from dqreg.solvers.robust import LEAST_FRACTION, GemanMcClure, Huber, InlierMixture, Kernel, LeastSquares, Tukey, Welsch

SCALES = st.floats(1e-3, 1e3)
SHARES = st.floats(0.01, 0.99)
# Mixtures with outliers so rare and far that an exact distance is surely an inlier, and the opposite.
KERNELS = [
    LeastSquares(),
    Huber(0.7),
    Welsch(0.7),
    Tukey(0.7),
    GemanMcClure(0.7),
    InlierMixture(0.7, 0.5, 5.0),
    InlierMixture(0.01, 0.98, 5.0),
    InlierMixture(3.0, 0.05, 5.0),
]
NAMES = [f"{type(k).__name__}-{k.scale}" for k in KERNELS]
ALL = pytest.mark.parametrize("kernel", KERNELS, ids=NAMES)


def slope(kernel: Kernel, d: np.ndarray) -> np.ndarray:
    """cost'(d) to the fourth order of the step; no kink of any kernel is met at the distances asked for."""
    h = 1e-3 * d
    ends = [kernel.cost(d + k * h) for k in (-2, -1, 1, 2)]
    return (ends[0] - 8.0 * ends[1] + 8.0 * ends[2] - ends[3]) / (12.0 * h)


def density(mixture: InlierMixture, d: np.ndarray) -> np.ndarray:
    """Half-normal inliers among even outliers, written out."""
    inlier = 2.0 / np.sqrt(2.0 * np.pi) / mixture.scale * np.exp(-0.5 * (d / mixture.scale) ** 2)
    return mixture.inlier_fraction * inlier + (1.0 - mixture.inlier_fraction) / mixture.limit


def drawn(rng: np.random.Generator, count: int, scale: float, share: float, limit: float) -> np.ndarray:
    inlier = rng.random(count) < share
    return np.where(inlier, np.abs(rng.normal(0.0, scale, count)), rng.uniform(0.0, limit, count))


@ALL
def test_weight_is_the_slope_of_the_cost_over_twice_the_distance(kernel: Kernel) -> None:
    unit = kernel.scale if np.isfinite(kernel.scale) else 1.0
    # Up to three scales; beyond, differences of a saturated cost are rounding. 0.05 keeps off the kink at one scale.
    d = unit * (np.arange(60) + 0.5) * 0.05
    d = d[np.abs(d - unit) > 0.01 * unit]
    weight = kernel.weight(d)
    np.testing.assert_allclose(slope(kernel, d) / (2.0 * d), weight, rtol=1e-6, atol=1e-6 * weight.max())


@ALL
def test_a_small_distance_costs_its_square_times_the_weight_of_an_exact_pair(kernel: Kernel) -> None:
    unit = kernel.scale if np.isfinite(kernel.scale) else 1.0
    d = unit * np.array([1e-4, 1e-3])
    at_zero = kernel.weight(np.zeros(1))[0]
    # The next term is (d / scale)^2 times at most one.
    np.testing.assert_allclose(
        kernel.cost(d), at_zero * d**2, rtol=3e-6, atol=1e-15 * unit**2 if isinstance(kernel, InlierMixture) else 0.0
    )
    assert kernel.cost(np.zeros(1)) == 0.0
    if isinstance(kernel, InlierMixture):
        assert at_zero == pytest.approx(
            density(dataclasses.replace(kernel, limit=np.inf), np.zeros(1))[0] / density(kernel, np.zeros(1))[0],
            rel=1e-14,
        )
    else:
        assert at_zero == 1.0


@ALL
@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0.0, 1e6), min_size=2, max_size=20))
def test_weights_fall_within_zero_and_one_and_costs_rise(kernel: Kernel, values: list[float]) -> None:
    d = np.sort(np.array(values))
    weight, cost = kernel.weight(d), kernel.cost(d)
    assert weight.min() >= 0.0
    assert weight.max() <= 1.0
    assert np.diff(weight).max() <= 0.0
    assert np.diff(cost).min() >= -1e-15 * max(1.0, cost.max())


def test_limits_far_away() -> None:
    far = np.array([1e6])
    assert LeastSquares().weight(far) == 1.0
    assert Huber(0.5).weight(far) * far == pytest.approx(0.5)
    assert Welsch(0.5).weight(far) == 0.0
    assert Welsch(0.5).cost(far) == 0.25
    assert Tukey(0.5).weight(np.array([0.5])) == 0.0
    assert GemanMcClure(0.5).cost(far) == pytest.approx(0.25, rel=1e-9)
    assert Tukey(0.5).cost(far) == pytest.approx(0.25 / 3.0, rel=1e-15)
    mixture = InlierMixture(0.5, 0.9, 10.0)
    assert mixture.weight(far) == 0.0
    ratio = density(mixture, np.zeros(1)) / density(mixture, far)
    np.testing.assert_allclose(mixture.cost(far), 0.5 * np.log(ratio), rtol=1e-14)  # 2 sigma^2 = 0.5


def test_a_kernel_by_the_median_has_twice_the_standard_deviation_of_gaussian_distances() -> None:
    distances = np.abs(np.random.default_rng(0).normal(scale=3.0, size=100_000))
    assert GemanMcClure.of_median(distances, floor=0.1).scale == pytest.approx(6.0, rel=0.02)
    assert GemanMcClure.of_median(np.zeros(9), floor=0.1).scale == 0.2


def test_kernels_wider_than_all_distances_are_least_squares() -> None:
    d = np.linspace(0.0, 1.0, 11)
    for kernel in (Huber(1e8), Welsch(1e8), Tukey(1e8), GemanMcClure(1e8)):
        np.testing.assert_allclose(kernel.weight(d), 1.0, rtol=1e-15)
        np.testing.assert_allclose(kernel.cost(d), d**2, rtol=1e-14)


@settings(deadline=None, max_examples=50)
@given(SCALES, SHARES, st.floats(1.0, 1e3))
def test_a_mixture_weighs_by_bayes_and_costs_by_its_density(scale: float, share: float, reach: float) -> None:
    mixture = InlierMixture(scale, share, reach * scale)
    d = mixture.limit * np.linspace(0.0, 1.0, 21)
    outlier = (1.0 - share) / mixture.limit
    np.testing.assert_allclose(mixture.weight(d), 1.0 - outlier / density(mixture, d), rtol=1e-9, atol=1e-13)
    expected = -2.0 * scale**2 * np.log(density(mixture, d) / density(mixture, np.zeros(1)))
    np.testing.assert_allclose(mixture.cost(d), expected, rtol=1e-11, atol=1e-13 * scale**2)
    assert mixture.mean_nll(d, rejected=0) == pytest.approx(-np.log(density(mixture, d)).mean(), rel=1e-12, abs=1e-12)


def test_rejected_pairs_count_as_outliers_of_the_same_scan() -> None:
    mixture = InlierMixture(0.1, 0.8, 2.0)
    d = np.array([0.0, 0.1, 0.5, 1.9])
    # Two of six pairs are refused: the share among all is 0.8 * 4 / 6, and a refused pair has the density of outliers.
    among_all = dataclasses.replace(mixture, inlier_fraction=0.8 * 4 / 6)
    outlier = (1.0 - among_all.inlier_fraction) / mixture.limit
    expected = -(np.log(density(among_all, d)).sum() + 2 * np.log(outlier)) / 6
    assert mixture.mean_nll(d, rejected=2) == pytest.approx(expected, rel=1e-14)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32 - 1), st.floats(1e-3, 1.0), SHARES, st.floats(0.01, 1.0), SHARES, st.sampled_from([0.0, 2e-3])
)
def test_every_round_of_learning_raises_the_likelihood(
    seed: int, scale: float, share: float, guess: float, first_share: float, floor: float
) -> None:
    d = np.minimum(drawn(np.random.default_rng(seed), 300, scale, share, 1.0), 1.0)
    mixture = InlierMixture(guess, first_share, 1.0)
    surprises = [mixture.mean_nll(d, rejected=0)]
    for _ in range(30):
        mixture = mixture.fit(d, floor=floor)
        surprises.append(mixture.mean_nll(d, rejected=0))
    assert np.diff(surprises).max() <= 1e-12


@pytest.mark.parametrize(("scale", "share"), [(0.01, 0.25), (0.05, 0.5), (0.02, 0.95)])
def test_scale_and_share_of_drawn_data_come_back_within_their_standard_errors(scale: float, share: float) -> None:
    d = drawn(np.random.default_rng(3), 5_000, scale, share, 1.0)
    learned = InlierMixture(0.5, 0.5, 1.0).fit(d, rounds=300)
    truth = InlierMixture(scale, share, 1.0)
    # Fisher information from the scores of the draws at the truth; its inverse bounds the variance of both.
    scores = []
    for name in ("scale", "inlier_fraction"):
        value = getattr(truth, name)
        up, down = (density(dataclasses.replace(truth, **{name: value * k}), d) for k in (1 + 1e-6, 1 - 1e-6))
        scores.append((np.log(up) - np.log(down)) / (2e-6 * value))
    sigmas = np.sqrt(np.diag(np.linalg.inv(np.array(scores) @ np.array(scores).T)))
    assert abs(learned.scale - scale) <= 4.0 * sigmas[0]
    assert abs(learned.inlier_fraction - share) <= 4.0 * sigmas[1]


def test_learning_stays_above_the_floor_and_keeps_both_populations_alive() -> None:
    exact = np.zeros(50)
    learned = InlierMixture(0.5, 0.5, 1.0).fit(exact, floor=1e-4, rounds=20)
    assert learned.scale == 1e-4
    assert learned.inlier_fraction == 1.0 - LEAST_FRACTION
    # One exact pair among outliers would take it all with a width of nothing; the floor holds it.
    lone = InlierMixture(0.01, 0.01, 1.0).fit(np.r_[0.0, np.linspace(0.5, 1.0, 9_999)], floor=1e-4, rounds=200)
    assert lone.scale >= 1e-4
    assert lone.inlier_fraction >= LEAST_FRACTION


def test_pairs_that_are_all_beyond_hope_leave_the_mixture_as_it_was() -> None:
    mixture = InlierMixture(1e-3, 0.5, 1.0)
    assert mixture.fit(np.ones(5), rounds=3) == mixture


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), SHARES)
def test_millimetres_and_metres_learn_the_same(seed: int, share: float) -> None:
    d = drawn(np.random.default_rng(seed), 200, 0.02, share, 1.0)
    metres = InlierMixture(0.3, 0.5, 1.0).fit(d, floor=1e-3, rounds=20)
    millimetres = InlierMixture(300.0, 0.5, 1000.0).fit(1000.0 * d, floor=1.0, rounds=20)
    assert millimetres.inlier_fraction == pytest.approx(metres.inlier_fraction, rel=1e-9)
    assert millimetres.scale == pytest.approx(1000.0 * metres.scale, rel=1e-9)
    # A density per millimetre is a thousandth of that per metre.
    scaled = dataclasses.replace(metres, scale=1000.0 * metres.scale, limit=1000.0)
    difference = scaled.mean_nll(1000.0 * d, rejected=7) - metres.mean_nll(d, rejected=7)
    assert difference == pytest.approx(np.log(1000.0), rel=1e-13)


@pytest.mark.parametrize("share", [0.2, 0.7])
def test_log_likelihoods_at_a_fixed_scale_take_the_likeliest_share(share: float) -> None:
    d = drawn(np.random.default_rng(4), 2_000, 0.02, share, 1.0)
    d[:100] = np.inf  # Beyond the limit an outlier is all that is left.
    mixture = InlierMixture.starting(0.02, 1.0)
    rows = mixture.inlier_densities(d)[None]
    log_likelihoods(0, 1, rows, 1.0 / mixture.limit, mixture.inlier_fraction, LEAST_FRACTION, 200)
    found = rows[0]
    within = np.minimum(d, 2.0)
    others = [
        np.log(np.where(d < 1.0, density(InlierMixture(0.02, s, 1.0), within), 1.0 - s)).sum()
        for s in np.linspace(0.01, 0.99, 99)
    ]
    assert found.sum() >= max(others)
    fitted = InlierMixture(0.02, 1.0 - np.exp(found[0]), 1.0)
    expected = np.where(d < 1.0, density(fitted, within), 1.0 - fitted.inlier_fraction)
    np.testing.assert_allclose(found, np.log(expected), rtol=1e-9)


def test_the_widest_start_is_half_the_limit_and_never_below_the_floor() -> None:
    assert InlierMixture.widest(4.0, 0.1) == InlierMixture(2.0, 0.5, 4.0)
    assert InlierMixture.widest(4.0, 3.0) == InlierMixture(3.0, 0.5, 4.0)


@pytest.mark.parametrize("scale", [0.0, 1e-308, 1.0])
def test_exact_data_without_a_floor_teach_a_mixture(scale: float) -> None:
    learned = InlierMixture.starting(scale, 1.0).fit(np.zeros(20), rounds=30)
    assert 0.0 < learned.scale <= 1e-300
    assert learned.inlier_fraction > 0.99
