from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.strategies import quaternions, unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=40)
i, j, k = np.eye(4)[1:]


def test_hamiltons_rules():
    # Jia eqs. 1, 2.
    one = np.eye(4)[0]
    for square in (
        quat.multiply(i, i),
        quat.multiply(j, j),
        quat.multiply(k, k),
        quat.multiply(quat.multiply(i, j), k),
    ):
        np.testing.assert_array_equal(square, -one)
    for left, right, product in ((i, j, k), (j, k, i), (k, i, j)):
        np.testing.assert_array_equal(quat.multiply(left, right), product)
        np.testing.assert_array_equal(quat.multiply(right, left), -product)


def test_example_1_of_the_notes():
    p, q = np.array([3, 1, -2, 1]), np.array([2, -1, 2, 3])
    np.testing.assert_array_equal(quat.add(p, q), [5, 0, 0, 4])
    np.testing.assert_array_equal(quat.multiply(p, q), [8, -9, -2, 11])


@fast
@given(quaternions(), quaternions(), quaternions())
def test_ring(p, q, r):
    a, b, c = np.linalg.norm([p, q, r], axis=1)
    associated = quat.multiply(quat.multiply(p, q), r), quat.multiply(p, quat.multiply(q, r))
    np.testing.assert_allclose(*associated, rtol=0, atol=1e-14 * a * b * c)
    distributed = quat.multiply(p, quat.add(q, r)), quat.add(quat.multiply(p, q), quat.multiply(p, r))
    np.testing.assert_allclose(*distributed, rtol=0, atol=1e-14 * a * (b + c))


@fast
@given(quaternions(), quaternions())
def test_product_agrees_with_equation_3(p, q):
    # Jia eq. 3.
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    expected = np.array([p[0] * q[0] - p[1:] @ q[1:], *vector])
    np.testing.assert_allclose(
        quat.multiply(p, q), expected, rtol=0, atol=1e-14 * np.linalg.norm(p) * np.linalg.norm(q)
    )


@fast
@given(quaternions(), quaternions())
def test_conjugate_norm_and_inverse(p, q):
    # Jia eq. 4.
    one = [1.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(quat.conjugate(quat.conjugate(q)), q)
    np.testing.assert_array_equal(quat.add(q, quat.conjugate(q)), [2 * q[0], 0, 0, 0])
    np.testing.assert_allclose(
        quat.multiply(quat.conjugate(q), q), quat.norm(q) ** 2 * np.array(one), rtol=1e-12, atol=1e-9
    )
    np.testing.assert_allclose(  # eq. 4
        quat.conjugate(quat.multiply(p, q)), quat.multiply(quat.conjugate(q), quat.conjugate(p)), rtol=1e-12, atol=1e-9
    )
    assert quat.norm(quat.multiply(p, q)) == pytest.approx(quat.norm(p) * quat.norm(q), rel=1e-12)
    np.testing.assert_allclose(quat.multiply(quat.inverse(q), q), one, atol=1e-12)
    np.testing.assert_allclose(quat.multiply(q, quat.inverse(q)), one, atol=1e-12)
    assert quat.norm(quat.normalize(q)) == pytest.approx(1.0, abs=1e-15)


@fast
@given(unit_quaternions())
def test_canonical_form_is_one_of_the_two_and_the_same_for_both(q):
    form = quat.canonical(q)
    np.testing.assert_array_equal(form, quat.canonical(-q))
    assert np.array_equal(form, q) or np.array_equal(form, -q)
    assert form[np.flatnonzero(form)[0]] > 0
    assert not np.signbit(form[form == 0]).any()


@fast
@given(unit_vectors(), unit_vectors())
def test_cross_matrix(u, v):
    # Walker eq. 5.
    np.testing.assert_allclose(quat.cross_matrix(u) @ v, np.cross(u, v), atol=1e-15)
    np.testing.assert_array_equal(quat.cross_matrix(u).T, -quat.cross_matrix(u))


def test_leading_axes_broadcast():
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(5, 1, 4)), rng.normal(size=(3, 4))
    product = quat.multiply(p, q)
    assert product.shape == (5, 3, 4)
    np.testing.assert_array_equal(product[4, 2], quat.multiply(p[4, 0], q[2]))
    assert quat.canonical(q).shape == (3, 4)
    assert quat.cross_matrix(p[..., 1:]).shape == (5, 1, 3, 3)


@pytest.mark.parametrize("function", [quat.inverse, quat.normalize, quat.log, quat.polar, lambda q: quat.power(q, 0.5)])
def test_zero_is_refused(function):
    with pytest.raises(InputError, match="zero"):
        function(np.zeros(4))
    with pytest.raises(InputError, match="zero"):
        function([[1.0, 0, 0, 0], [0, 0, 0, 0]])


@pytest.mark.parametrize("bad", [[1.0, 2.0, 3.0], 1.0, np.zeros((4, 3)), "text", [1j, 0, 0, 0]])
def test_wrong_shapes_are_named(bad):
    with pytest.raises(InputError, match="q must"):
        quat.conjugate(bad)


def test_numbers_that_are_not_finite_stay_visible():
    assert np.isnan(quat.multiply([np.nan, 0, 0, 0], [1, 0, 0, 0])).all()
