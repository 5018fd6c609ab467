from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.rigid.finite_differences import ROUNDING, jacobian
from tests.strategies import unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=30)


def pure(v):
    return np.array([0.0, *v])


def by_conjugate(p, q):
    return quat.multiply(p, quat.conjugate(q))


CASES = {  # name: (equation, Jacobian from (p, q, v), function of what varies, what varies)
    "d_pq_d_p": (35, lambda p, q, v: quat.d_pq_d_p(q), lambda p, q, v: (lambda x: quat.multiply(x, q), p)),
    "d_pqc_d_p": (
        36,
        lambda p, q, v: quat.d_pqc_d_p(q),
        lambda p, q, v: (lambda x: by_conjugate(x, q), p),
    ),
    "d_pq_d_q": (37, lambda p, q, v: quat.d_pq_d_q(p), lambda p, q, v: (lambda x: quat.multiply(p, x), q)),
    "d_pqc_d_q": (
        38,
        lambda p, q, v: quat.d_pqc_d_q(p),
        lambda p, q, v: (lambda x: by_conjugate(p, x), q),
    ),
    "d_qv_d_q": (39, lambda p, q, v: quat.d_qv_d_q(v), lambda p, q, v: (lambda x: quat.multiply(x, pure(v)), q)),
    "d_vq_d_q": (40, lambda p, q, v: quat.d_vq_d_q(v), lambda p, q, v: (lambda x: quat.multiply(pure(v), x), q)),
    "d_vq_d_v": (41, lambda p, q, v: quat.d_vq_d_v(q), lambda p, q, v: (lambda x: quat.multiply(pure(x), q), v)),
    "d_qv_d_v": (42, lambda p, q, v: quat.d_qv_d_v(q), lambda p, q, v: (lambda x: quat.multiply(q, pure(x)), v)),
}


def printed(p, q, v):
    """The matrices as the notes print them, eqs. 35-42."""
    p0, pv, q0, qv, eye, skew = p[0], p[1:], q[0], q[1:], np.eye(3), quat.cross_matrix

    def block(a, b, c, d):
        return np.block([[np.atleast_2d(a), np.atleast_2d(b)], [np.reshape(c, (3, 1)), d]])

    return {
        "d_pq_d_p": block(q0, -qv, qv, q0 * eye - skew(qv)),
        "d_pqc_d_p": block(q0, qv, -qv, q0 * eye + skew(qv)),
        "d_pq_d_q": block(p0, -pv, pv, p0 * eye + skew(pv)),
        "d_pqc_d_q": block(p0, pv, pv, -p0 * eye - skew(pv)),
        "d_qv_d_q": block(0, -v, v, -skew(v)),
        "d_vq_d_q": block(0, -v, v, skew(v)),
        "d_vq_d_v": np.vstack([-qv, q0 * eye - skew(qv)]),
        "d_qv_d_v": np.vstack([-qv, q0 * eye + skew(qv)]),
    }


@pytest.mark.parametrize("name", CASES)
@fast
@given(unit_quaternions(), unit_quaternions(), unit_vectors())
def test_against_finite_differences_and_the_printed_matrix(name, p, q, v):
    # Jia eqs. 35 to 42.
    _, matrix, problem = CASES[name]
    p, v = 1.5 * p, 3.0 * v  # nothing here asks for unit length
    np.testing.assert_allclose(matrix(p, q, v), jacobian(*problem(p, q, v)), atol=ROUNDING)
    np.testing.assert_array_equal(matrix(p, q, v), printed(p, q, v)[name])


@fast
@given(unit_vectors(), unit_vectors())
def test_derivatives_of_the_cross_product(u, v):
    # Start of appendix D.
    np.testing.assert_allclose(quat.cross_matrix(u), jacobian(lambda x: np.cross(u, x), v), atol=ROUNDING)
    np.testing.assert_allclose(-quat.cross_matrix(v), jacobian(lambda x: np.cross(x, v), u), atol=ROUNDING)


def test_stacks_and_errors():
    q = np.random.default_rng(6).normal(size=(5, 4))
    for function in (quat.d_pq_d_p, quat.d_pqc_d_p, quat.d_pq_d_q, quat.d_pqc_d_q, quat.d_vq_d_v, quat.d_qv_d_v):
        np.testing.assert_array_equal(function(q)[3], function(q[3]))
        with pytest.raises(InputError, match="must hold quaternions"):
            function([1.0, 2.0, 3.0])
    for function in (quat.d_qv_d_q, quat.d_vq_d_q):
        np.testing.assert_array_equal(function(q[:, :3])[3], function(q[3, :3]))
        with pytest.raises(InputError, match="v must hold"):
            function([1.0, 2.0])


def sandwich(q, v):
    return quat.multiply(quat.multiply(q, [0.0, *v]), quat.conjugate(q))[1:]


@fast
@given(unit_quaternions(), unit_vectors())
def test_by_the_vector(q, v):
    # Jia eqs. 43 to 45.
    np.testing.assert_allclose(quat.d_rotate_d_v(q), jacobian(lambda x: sandwich(q, x), v), atol=ROUNDING)  # eq. 43
    backward = jacobian(lambda x: sandwich(quat.conjugate(q), x), v)
    np.testing.assert_allclose(quat.d_rotate_frame_d_v(q), backward, atol=ROUNDING)  # eqs. 44-45
    np.testing.assert_allclose(quat.d_rotate_d_v(q), quat.to_matrix(q), atol=0)
    np.testing.assert_allclose(quat.d_rotate_frame_d_v(q), quat.to_matrix(q).T, atol=1e-15)


@fast
@given(unit_quaternions(), unit_vectors())
def test_by_the_four_components(q, v):
    # Jia eq. 46.
    q, v = 1.5 * q, 2.0 * v
    np.testing.assert_allclose(quat.d_rotate_d_q(q, v), jacobian(lambda x: sandwich(x, v), q), atol=ROUNDING)  # eq. 46
    # Euler: the sandwich is of degree two in q.
    np.testing.assert_allclose(quat.d_rotate_d_q(q, v) @ q, 2 * sandwich(q, v), atol=1e-13)


@fast
@given(unit_quaternions(), unit_vectors())
def test_in_the_tangent_space_of_the_unit_sphere(q, v):
    # Jia eq. 46.
    v = 3.0 * v

    def turned(w):
        return quat.rotate(quat.multiply(quat.exp([0, *(w / 2)]), q), v)

    tangent = quat.right_matrix(q)[:, 1:] / 2
    by_rotation_vector = quat.d_rotate_d_q(q, v) @ tangent
    np.testing.assert_allclose(by_rotation_vector, jacobian(turned, np.zeros(3)), atol=ROUNDING)
    np.testing.assert_allclose(by_rotation_vector, -quat.cross_matrix(quat.rotate(q, v)), atol=1e-14)


@fast
@given(unit_vectors(), unit_vectors())
def test_the_two_helpers_before_equation_46(q, v):
    squares = jacobian(lambda x: (x @ x) * v, q)
    np.testing.assert_allclose(2 * np.outer(v, q), squares, atol=ROUNDING)
    products = jacobian(lambda x: (x @ v) * x, q)
    np.testing.assert_allclose((v @ q) * np.eye(3) + np.outer(q, v), products, atol=ROUNDING)


def test_stacks_and_errors_of_rotated_vectors():
    rng = np.random.default_rng(7)
    q, v = rng.normal(size=(5, 1, 4)), rng.normal(size=(3, 3))
    stack = quat.d_rotate_d_q(q, v)
    assert stack.shape == (5, 3, 3, 4)
    np.testing.assert_array_equal(stack[4, 2], quat.d_rotate_d_q(q[4, 0], v[2]))
    with pytest.raises(InputError, match="v must hold"):
        quat.d_rotate_d_q([1, 0, 0, 0], [1, 0])
    with pytest.raises(InputError, match="q must hold"):
        quat.d_rotate_d_v([1, 0, 0])
