from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from dqreg.rigid import quaternion as quat
from tests.strategies import floats, quaternions, unit_quaternions, unit_vectors

fast = settings(deadline=None, max_examples=50)


@fast
@given(quaternions())
def test_polar_form(q):
    # Jia eq. 18.
    length, axis, angle_rad = quat.polar(q)
    assert 0 <= angle_rad <= np.pi
    assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-15)
    rebuilt = length * np.array([np.cos(angle_rad), *(np.sin(angle_rad) * axis)])
    np.testing.assert_allclose(rebuilt, q, rtol=0, atol=1e-14 * length)


@fast
@given(quaternions())
def test_exp_undoes_log(q):
    # Jia eq. 21.
    np.testing.assert_allclose(quat.exp(quat.log(q)), q, rtol=0, atol=1e-13 * np.linalg.norm(q))


@fast
@given(unit_vectors(), floats(0, 3.14), floats(-2, 2))
def test_log_undoes_exp(u, angle_rad, scalar):
    # Jia eq. 21.
    q = np.array([scalar, *(angle_rad * u)])
    np.testing.assert_allclose(quat.log(quat.exp(q)), q, atol=1e-12)


def test_log_undoes_exp_within_pi_only():
    # Jia, appendix A: eqs. 20 and 21 are inverses of each other only up to a length of pi of the vector part.
    u = np.array([0.6, 0.0, 0.8])
    for angle_rad in (3.0, 4.0):
        q = np.array([0.5, *(angle_rad * u)])
        off = np.linalg.norm(quat.log(quat.exp(q)) - q)
        assert off == pytest.approx(0.0 if angle_rad < np.pi else 2 * np.pi, abs=1e-12)


@fast
@given(unit_vectors(), floats(0, 3), floats(-2, 2))
def test_exp_is_the_power_series(u, angle_rad, scalar):
    # Jia eq. 20.
    # The matrix of a product turns the series over quaternions into the matrix exponential.
    q = np.array([scalar, *(angle_rad * u)])
    np.testing.assert_allclose(quat.left_matrix(quat.exp(q)), expm(quat.left_matrix(q)), atol=1e-12)


@fast
@given(unit_quaternions())
def test_log_is_half_the_rotation_vector(q):
    vector = 2 * quat.log(quat.canonical(q))[1:]
    expected = Rotation.from_quat(np.roll(quat.canonical(q), -1)).as_rotvec()
    np.testing.assert_allclose(vector, expected, atol=1e-13)


@pytest.mark.parametrize("angle_rad", [1e-300, 1e-12, 1e-7])
def test_small_angles_keep_all_digits(angle_rad):
    q = quat.exp([0, 0, angle_rad, 0])
    assert quat.log(q)[2] == pytest.approx(angle_rad, rel=1e-15, abs=0)
    assert quat.power(q, 0.5)[2] == pytest.approx(angle_rad / 2, rel=1e-15, abs=0)


@fast
@given(quaternions(), floats(-3, 3), floats(-3, 3))
def test_laws_of_powers(q, a, b):
    # Jia eq. 19.
    product = quat.multiply(quat.power(q, a), quat.power(q, b))
    np.testing.assert_allclose(product, quat.power(q, a + b), rtol=0, atol=1e-12 * np.linalg.norm(q) ** (a + b))


@fast
@given(quaternions())
def test_whole_powers(q):
    # Jia eq. 19.
    n = np.linalg.norm(q)
    np.testing.assert_allclose(quat.power(q, 0), [1, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(quat.power(q, 1), q, rtol=0, atol=1e-14 * n)
    np.testing.assert_allclose(quat.power(q, 2), quat.multiply(q, q), rtol=0, atol=1e-13 * n**2)
    np.testing.assert_allclose(quat.power(q, -1), quat.inverse(q), rtol=0, atol=1e-14 / n)


def test_a_negative_number_is_taken_about_x():
    np.testing.assert_allclose(quat.log([-1, 0, 0, 0]), [0, np.pi, 0, 0], atol=0)
    np.testing.assert_allclose(quat.power([-4, 0, 0, 0], 0.5), [0, 2, 0, 0], atol=1e-15)


def test_stacks():
    rng = np.random.default_rng(3)
    q = rng.normal(size=(6, 4))
    for function in (quat.exp, quat.log, lambda x: quat.power(x, 0.3)):
        np.testing.assert_allclose(function(q)[4], function(q[4]), rtol=1e-15)
    assert quat.power(q[0], np.linspace(0, 1, 9)).shape == (9, 4)
    assert quat.power(q, np.linspace(0, 1, 9)[:, None]).shape == (9, 6, 4)
