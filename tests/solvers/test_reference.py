from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dqreg.rigid.quaternion import conjugate, from_matrix, left_matrix, multiply, right_matrix
from dqreg.solvers import horn, read_matches
from dqreg.solvers.jia import P, Q
from dqreg.solvers.least_squares import centre
from tests.solvers.problems import euclidean_cost, fast, problems
from tests.strategies import floats, unit_quaternions

vectors = arrays(np.float64, 3, elements=floats(-10, 10))
pointwise = problems(directions=False, weights=False, far=False)


@fast
@given(vectors, unit_quaternions())
def test_P_and_Q_are_products_with_a_vector(v, q):
    pure = np.array([0.0, *v])
    np.testing.assert_allclose(P(v[None])[0] @ q, multiply(q, pure), rtol=0, atol=1e-13)
    np.testing.assert_allclose(Q(v[None])[0] @ q, multiply(pure, q), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(P(v[None])[0], right_matrix(pure))
    np.testing.assert_array_equal(Q(v[None])[0], left_matrix(pure))


@fast
@given(vectors, vectors, unit_quaternions())
def test_17_the_turned_product_moves_to_the_other_side(p, q, r):
    # Jia eq. 17.
    pure_p, pure_q = np.array([0.0, *p]), np.array([0.0, *q])
    turned = multiply(multiply(r, pure_p), conjugate(r))
    assert turned @ pure_q == pytest.approx(multiply(r, pure_p) @ multiply(pure_q, r), abs=1e-11)


@fast
@given(pointwise)
def test_11_12_the_sums_about_the_means_are_zero(problem):
    # Jia eqs. 11, 12.
    c = centre(read_matches(*problem.args))
    np.testing.assert_allclose(c.p.sum(axis=0), np.zeros(3), rtol=0, atol=1e-13)
    np.testing.assert_allclose(c.q.sum(axis=0), np.zeros(3), rtol=0, atol=1e-13)


@fast
@given(pointwise)
def test_10_13_14_the_translation_joins_the_means(problem):
    # Jia eqs. 10 and 13, 14.
    fit, c = horn(*problem.args), centre(read_matches(*problem.args))
    R, b = fit.T_target_source[:3, :3], fit.T_target_source[:3, 3]
    np.testing.assert_allclose(b, c.mean_target - R @ c.mean_source, rtol=0, atol=1e-13)  # (13)
    assert ((c.p @ R.T - c.q) ** 2).sum() == pytest.approx(fit.cost, rel=1e-9, abs=1e-20)  # (14)
    assert euclidean_cost(fit.T_target_source, problem) == pytest.approx(fit.cost, rel=1e-9, abs=1e-20)  # (10)


@fast
@given(pointwise, unit_quaternions())
def test_15_16_no_other_unit_quaternion_fits_better(problem, other):
    # Jia eqs. 15, 16.
    c = centre(read_matches(*problem.args))
    M = np.einsum("iab,iac->bc", P(c.p), Q(c.q))
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-11)
    R = horn(*problem.args).T_target_source[:3, :3]
    q = from_matrix(R)
    assert (c.p @ R.T * c.q).sum() == pytest.approx(q @ M @ q, rel=1e-12)  # (15) is (16)
    assert q @ M @ q == pytest.approx(np.linalg.eigvalsh(M)[-1], rel=1e-12)
    assert q @ M @ q >= other @ M @ other - 1e-11


@fast
@given(st.data())
def test_each_matrix_product_is_symmetric(data):
    p, q = data.draw(vectors)[None], data.draw(vectors)[None]
    product = P(p)[0].T @ Q(q)[0]
    np.testing.assert_allclose(product, product.T, rtol=0, atol=1e-13)
