from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dqreg.errors import InputError
from dqreg.rigid import quaternion as quat
from tests.strategies import floats, unit_quaternions

fast = settings(deadline=None, max_examples=40)
triples = st.tuples(*[floats(-2, 2)] * 3).map(np.array)


def motion(q0, a, b):
    """q(t) = exp(u(t) / 2) q0 with u = a t + b t^2: at t = 0 its velocity is a and its acceleration 2 b."""
    return lambda t: quat.multiply(quat.exp([0, *((a * t + b * t * t) / 2)]), q0)


@fast
@given(unit_quaternions(), triples, triples)
def test_derivatives_against_central_differences(q0, a, b):
    # Jia eqs. 22, 25, 26 and 28.
    # For u(0) = 0: omega = J(u) u' = a, and alpha = 2 b, since the first-order term of J is u' x u' / 2 = 0.
    q, h = motion(q0, a, b), 1e-4
    first = (q(h) - q(-h)) / (2 * h)
    second = (q(h) - 2 * q0 + q(-h)) / h**2
    np.testing.assert_allclose(quat.derivative(q0, a), first, atol=1e-6)
    np.testing.assert_allclose(quat.second_derivative(q0, a, 2 * b), second, atol=1e-5)


@fast
@given(unit_quaternions(), triples, triples)
def test_rates_come_back(q, omega, alpha):
    # Jia eq. 27.
    q_dot, q_ddot = quat.derivative(q, omega), quat.second_derivative(q, omega, alpha)
    np.testing.assert_allclose(quat.angular_velocity(q, q_dot), omega, atol=1e-13)
    np.testing.assert_allclose(quat.angular_acceleration(q, q_dot, q_ddot), alpha, atol=1e-12)


@fast
@given(unit_quaternions(), triples, triples)
def test_derivatives_keep_the_unit_length(q, omega, alpha):
    # From |q|^2 = 1: q . q' = 0 and q . q'' = -|q'|^2.
    q_dot, q_ddot = quat.derivative(q, omega), quat.second_derivative(q, omega, alpha)
    assert q @ q_dot == pytest.approx(0, abs=1e-14)
    assert q @ q_ddot == pytest.approx(-(q_dot @ q_dot), abs=1e-13)


@fast
@given(unit_quaternions(), triples)
def test_body_frame_form(q, omega):
    # Appendix B: omega_body = q* omega q, and q' = q omega_body / 2.
    body = quat.rotate_frame(q, omega)
    np.testing.assert_allclose(quat.multiply(q, [0, *body]) / 2, quat.derivative(q, omega), atol=1e-14)


@fast
@given(unit_quaternions(), unit_quaternions(), triples, triples)
def test_product_rule(p, q, omega_p, omega_q):
    # The velocity of p q is omega_p + p omega_q p*.
    by_rule = quat.multiply(quat.derivative(p, omega_p), q) + quat.multiply(p, quat.derivative(q, omega_q))
    joint = omega_p + quat.rotate(p, omega_q)
    np.testing.assert_allclose(by_rule, quat.derivative(quat.multiply(p, q), joint), atol=1e-13)


def wobble(t):
    return np.array([np.sin(3 * t), 1.5 * np.cos(2 * t), 0.7 + t * t])


def error_after(steps, method):
    start = np.array([0.5, 0.5, -0.5, 0.5])
    exact = solve_ivp(
        lambda t, q: quat.derivative(q / np.linalg.norm(q), wobble(t)) * np.linalg.norm(q),
        (0, 2),
        start,
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
    ).y[:, -1]
    return np.linalg.norm(quat.integrate(start, wobble, np.linspace(0, 2, steps + 1), method=method)[-1] - exact)


@pytest.mark.parametrize(("method", "order", "steps"), [("euler", 1, 400), ("rk4", 4, 32)])
def test_order_of_convergence(method, order, steps):
    coarse, fine = error_after(steps, method), error_after(2 * steps, method)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize("frame", ["world", "body"])
def test_samples_keep_order_four_in_either_frame(frame):
    # A gyroscope measures the body's velocity at given times only. The truth: DOP853 on q' = w q / 2 or q w / 2.
    start = np.array([0.5, 0.5, -0.5, 0.5])

    def rate(t, q):
        w = np.array([0, *wobble(t)]) / 2
        return quat.multiply(w, q) if frame == "world" else quat.multiply(q, w)

    exact = solve_ivp(rate, (0, 2), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]

    def error(steps):
        times = np.linspace(0, 2, steps + 1)
        samples = np.array([wobble(t) for t in times])
        return np.linalg.norm(quat.integrate(start, samples, times, frame=frame)[-1] - exact)

    assert np.log2(error(64) / error(128)) == pytest.approx(4, abs=0.4)
    assert error(128) < 1e-7


def test_the_body_frame_is_the_conjugate_problem():
    start, times = np.array([0.5, 0.5, -0.5, 0.5]), np.linspace(0, 2, 41)
    for method in ("rk4", "euler"):
        body = quat.integrate(start, wobble, times, method=method, frame="body")
        np.testing.assert_array_equal(body[0], start)
        world = quat.integrate(quat.conjugate(start), lambda t: -wobble(t), times, method=method)
        np.testing.assert_allclose(body, quat.conjugate(world), atol=1e-15)
        # One constant velocity: q exp(w h / 2).
        one = quat.integrate(start, lambda t: [0.1, 0.2, 0.3], [0, 2], frame="body")[-1]
        np.testing.assert_allclose(one, quat.multiply(start, quat.exp([0, 0.1, 0.2, 0.3])), atol=1e-14)


def test_samples_of_several_bodies_and_backwards():
    times = np.linspace(0, 1, 65)
    samples = np.array([[wobble(t + body) for body in range(5)] for t in times])
    path = quat.integrate([1, 0, 0, 0], samples, times)
    assert path.shape == (65, 5, 4)
    np.testing.assert_allclose(path[:, 2], quat.integrate([1, 0, 0, 0], samples[:, 2], times), atol=1e-14)
    back = quat.integrate(path[-1], samples[::-1], times[::-1])
    np.testing.assert_allclose(back[-1], path[0], atol=1e-7)
    assert quat.integrate([1, 0, 0, 0], samples[:1, 0], times[:1]).shape == (1, 4)


def test_rk4_beats_euler_and_stays_on_the_sphere():
    path = quat.integrate([1, 0, 0, 0], wobble, np.linspace(0, 2, 50))
    np.testing.assert_allclose(quat.norm(path), 1, atol=1e-15)
    assert error_after(49, "rk4") < 1e-4 * error_after(49, "euler")


@fast
@given(unit_quaternions(), triples)
def test_constant_velocity_is_exact_in_one_step(q, omega):
    # Jia eqs. 23, 24.
    expected = quat.multiply(quat.exp([0, *(omega * 0.7 / 2)]), q)
    np.testing.assert_allclose(quat.integrate(q, lambda t: omega, [0.3, 1.0])[-1], expected, atol=1e-13)


def test_one_step_of_euler_is_the_notes_formula():
    q, omega, h = np.array([0.6, 0, 0.8, 0]), np.array([0.1, 0.2, 0.3]), 0.25
    step = q + h / 2 * quat.multiply([0, *omega], q)
    expected = step / np.linalg.norm(step)
    np.testing.assert_allclose(quat.integrate(q, lambda t: omega, [0, h], method="euler")[1], expected, atol=1e-15)


def test_backwards_in_time_returns_to_the_start():
    start = np.array([0.5, 0.5, -0.5, 0.5])
    there = quat.integrate(start, wobble, np.linspace(0, 1, 200))[-1]
    np.testing.assert_allclose(quat.integrate(there, wobble, np.linspace(1, 0, 200))[-1], start, atol=1e-8)


def test_many_orientations_at_once():
    starts = quat.normalize(np.random.default_rng(4).normal(size=(6, 4)))
    times = np.linspace(0, 1, 5)
    path = quat.integrate(starts, wobble, times)
    assert path.shape == (5, 6, 4)
    np.testing.assert_allclose(path[:, 3], quat.integrate(starts[3], wobble, times), atol=1e-15)
    rates = np.arange(9.0).reshape(3, 3) / 9
    assert quat.integrate(starts[0], lambda t: rates, times).shape == (5, 3, 4)


def test_errors():
    with pytest.raises(InputError, match="method"):
        quat.integrate([1, 0, 0, 0], wobble, [0, 1], method="rk5")
    with pytest.raises(InputError, match="times"):
        quat.integrate([1, 0, 0, 0], wobble, [])
    with pytest.raises(InputError, match="norm 1"):
        quat.integrate([2, 0, 0, 0], wobble, [0, 1])
    with pytest.raises(InputError, match="omega"):
        quat.integrate([1, 0, 0, 0], lambda t: [1.0, 2.0], [0, 1])
    with pytest.raises(InputError, match="norm 1"):
        quat.derivative(np.zeros(4), [1, 0, 0])
    for omega, words in (
        ([[1.0, 2, 3]], "one sample for each"),
        ([[np.nan] * 3] * 2, "NaN"),
        ([1.0, 2, 3], "one sample"),
    ):
        with pytest.raises(InputError, match=words):
            quat.integrate([1, 0, 0, 0], omega, [0, 1])
    with pytest.raises(InputError, match="differ"):
        quat.integrate([1, 0, 0, 0], np.zeros((3, 3)), [0, 1, 1])
    with pytest.raises(InputError, match="frame"):
        quat.integrate([1, 0, 0, 0], wobble, [0, 1], frame="sensor")
