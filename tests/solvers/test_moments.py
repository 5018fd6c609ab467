from __future__ import annotations

import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.solvers import Moments, moments_of, read_matches, solve, solve_moments
from dqreg.solvers.feature_sums import BLOCK_ROWS, STACK_BLOCKS, feature_sums
from tests.solvers.problems import assert_same_pose, fast, problems

SIZES = [1, 2, 63, BLOCK_ROWS - 1, BLOCK_ROWS, BLOCK_ROWS + 1, 3 * BLOCK_ROWS + 5, BLOCK_ROWS * (STACK_BLOCKS + 1) + 1]


def draw(count: int, seed: int = 0):
    """Points, directions and weights of both sides, by a seeded generator."""
    rng = np.random.default_rng(seed)
    return (*(rng.normal(size=(count, 3)) for _ in range(4)), rng.uniform(0, 2, count), rng.uniform(0, 2, count))


def assert_close(a: Moments, b: Moments, tolerance: float = 1e-12) -> None:
    assert (a.aligned is None) == (b.aligned is None)
    for name in set(Moments.__slots__) - {"aligned"}:
        mine, other = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(mine, other, rtol=tolerance, atol=tolerance * max(1.0, b.constant), err_msg=name)


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("shifted", [False, True])
def test_blocks_sum_what_the_definition_says(count, weighted, shifted):
    a, b, _, _, w, _ = draw(count)
    origin = (np.array([1.0, 2, 3]), np.array([-3.0, 0, 5])) if shifted else None
    sums = feature_sums(a, b, w if weighted else None, origin)
    if shifted:
        a, b = a - origin[0], b - origin[1]
    if not weighted:
        w = np.ones(count)
    expected = (w.sum(), w @ a, w @ b, np.einsum("n,ni,nj->ij", w, b, a), w @ (a * a).sum(1), w @ (b * b).sum(1))
    for got, want in zip(sums, expected, strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-11 * count)


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("away", [0.0, 1.0, 100.0, 1e6])
def test_moments_are_central_however_far_the_points_are(count, away):
    p, q, m, n, beta, alpha = draw(count)
    # Binary fractions, so that moving them away rounds nothing.
    p, q = np.round(p * 2**20) / 2**20, np.round(q * 2**20) / 2**20
    near, far = moments_of(p, q, m, n, beta, alpha), moments_of(p + away, q - away, m, n, beta, alpha)
    np.testing.assert_allclose(far.point_cross, near.point_cross, rtol=0, atol=1e-13 * max(1.0, near.constant))
    assert far.spread_source == pytest.approx(near.spread_source, rel=1e-13, abs=1e-13)
    np.testing.assert_allclose(far.mean_source, near.mean_source + away, rtol=4e-16, atol=1e-15)
    centred = p - np.average(p, axis=0, weights=beta)
    np.testing.assert_allclose(near.point_cross, (beta[:, None] * q).T @ centred, rtol=0, atol=1e-11 * count)


def test_a_few_heavy_points_far_from_all_others_keep_their_digits():
    # The sample that guesses the origin sees none of the four heavy points, a million units away.
    p, q, *_ = draw(3 * BLOCK_ROWS)
    heavy = np.arange(1, 5)
    p[heavy] = np.round(p[heavy] * 2**20) / 2**20 + 1e6
    q[heavy] = p[heavy]
    beta = np.zeros(len(p))
    beta[heavy] = 1.0
    beta[0] = 1e-30
    np.testing.assert_allclose(solve(p, q, point_weights=beta).T_target_source[:3, :3], np.eye(3), rtol=0, atol=1e-12)


@fast
@given(problems(far=False), st.data())
def test_moments_of_two_parts_add_up_to_those_of_the_whole(problem, data):
    p, q, m, n, beta, alpha = problem.args
    i, j = data.draw(st.integers(0, len(p))), data.draw(st.integers(0, len(m)))
    first = moments_of(p[:i], q[:i], m[:j], n[:j], beta[:i], alpha[:j])
    rest = moments_of(p[i:], q[i:], m[j:], n[j:], beta[i:], alpha[j:])
    whole = moments_of(p, q, m, n, beta, alpha)
    assert_close(first + rest, whole)
    assert_close(rest + first, whole)


@fast
@given(problems())
def test_the_pose_follows_from_the_sums_alone(problem):
    p, q, m, n, beta, alpha = problem.args
    fit = solve_moments(moments_of(p, q, m, n, beta, alpha))
    full = solve(*problem.args)
    assert_same_pose(fit.T_target_source, full.T_target_source)
    # The difference of like sums: 1e-14 of the constant, which is some 1e3 here.
    assert fit.cost == pytest.approx(full.cost, abs=1e-10)
    assert fit.cost >= 0.0


def test_empty_sums_are_the_neutral_element():
    p, q, m, n, beta, alpha = draw(10)
    none = np.zeros((0, 3))
    whole = moments_of(p, q, m, n, beta, alpha)
    assert_close(whole + moments_of(none, none), whole)
    assert_close(moments_of(none, none) + whole, whole)


def same(a: Moments, b: Moments) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in set(Moments.__slots__) - {"aligned"})


OLD_ORDER = {
    "point weights": lambda p, q, m, n, beta, alpha: ((p, q, beta), {}, (p, q, None, None, beta)),
    "all": lambda p, q, m, n, beta, alpha: ((p, q, beta, m, n, alpha), {}, (p, q, m, n, beta, alpha)),
    "no point weights": lambda p, q, m, n, beta, alpha: ((p, q, None, m, n), {}, (p, q, m, n)),
    "the rest by name": lambda p, q, m, n, beta, alpha: (
        (p, q, beta),
        {"directions_source": m, "directions_target": n},
        (p, q, m, n, beta),
    ),
}


@pytest.mark.parametrize("case", OLD_ORDER)
def test_the_old_order_of_arguments_is_told_and_understood(case):
    old, named, new = OLD_ORDER[case](*draw(10))
    with pytest.warns(DeprecationWarning, match="is the old order of"):
        found = moments_of(*old, **named)
    assert same(found, moments_of(*new))


def test_the_order_of_arguments_is_that_of_all_solvers():
    expected = list(inspect.signature(solve).parameters)[:6]
    for function in (moments_of, read_matches):
        assert list(inspect.signature(function).parameters)[:6] == expected


P, Q, M, N, BETA, ALPHA = draw(9)
MISFITS = {
    "points of one side": ((P, Q[:8]), "points_source has 9 rows and points_target 8"),
    "one direction": ((P, Q, M), "directions_target is missing"),
    "a point alone": ((P[0], Q[0]), r"points_source must have shape \(n, 3\)"),
    "rows of four": ((P, Q, np.ones((9, 4)), np.ones((9, 4))), r"directions_source must have shape \(n, 3\)"),
    "few weights": ((P, Q, M, N, BETA[:8]), "point_weights must be one number or 9 numbers"),
    "weights of directions": ((P, Q, M[:4], N[:4], BETA, ALPHA), "direction_weights must be one number or 4 numbers"),
    "no directions": ((P, Q, None, None, BETA, ALPHA), "direction_weights was given without directions"),
}


@pytest.mark.parametrize("case", MISFITS)
def test_what_does_not_fit_together_is_named(case):
    arguments, words = MISFITS[case]
    with pytest.raises(InputError, match=words):
        moments_of(*arguments)
