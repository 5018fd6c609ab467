from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.rigid.finite_differences import ROUNDING, jacobian
from tests.strategies import unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=40)


def sandwich(q, v):
    return quat.multiply(quat.multiply(q, [0.0, *v]), quat.conjugate(q))[1:]


@fast
@given(unit_quaternions(), unit_vectors())
def test_by_the_vector(q, v):
    np.testing.assert_allclose(quat.d_rotate_d_v(q), jacobian(lambda x: sandwich(q, x), v), atol=ROUNDING)  # eq. 43
    backward = jacobian(lambda x: sandwich(quat.conjugate(q), x), v)
    np.testing.assert_allclose(quat.d_rotate_frame_d_v(q), backward, atol=ROUNDING)  # eqs. 44-45
    np.testing.assert_allclose(quat.d_rotate_d_v(q), quat.to_matrix(q), atol=0)
    np.testing.assert_allclose(quat.d_rotate_frame_d_v(q), quat.to_matrix(q).T, atol=1e-15)


@fast
@given(unit_quaternions(), unit_vectors())
def test_by_the_four_components(q, v):
    q, v = 1.5 * q, 2.0 * v
    np.testing.assert_allclose(quat.d_rotate_d_q(q, v), jacobian(lambda x: sandwich(x, v), q), atol=ROUNDING)  # eq. 46
    # Euler: the sandwich is of degree two in q.
    np.testing.assert_allclose(quat.d_rotate_d_q(q, v) @ q, 2 * sandwich(q, v), atol=1e-13)


@fast
@given(unit_quaternions(), unit_vectors())
def test_in_the_tangent_space_of_the_unit_sphere(q, v):
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


def test_stacks_and_errors():
    rng = np.random.default_rng(7)
    q, v = rng.normal(size=(5, 1, 4)), rng.normal(size=(3, 3))
    stack = quat.d_rotate_d_q(q, v)
    assert stack.shape == (5, 3, 3, 4)
    np.testing.assert_array_equal(stack[4, 2], quat.d_rotate_d_q(q[4, 0], v[2]))
    with pytest.raises(InputError, match="v must hold"):
        quat.d_rotate_d_q([1, 0, 0, 0], [1, 0])
    with pytest.raises(InputError, match="q must hold"):
        quat.d_rotate_d_v([1, 0, 0])
