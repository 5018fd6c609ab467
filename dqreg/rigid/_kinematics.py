"""Unit quaternions that change with time, the angular velocity and acceleration behind them, and integration.

Equation numbers: Jia, *Quaternions* (2020), appendix B. The angular velocity is that of the body against the
world, in world coordinates; the notes' velocity in terms of the body frame is ``rotate_frame(q, omega)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float, require_finite
from dqreg.errors import InputError
from dqreg.rigid._algebra import conjugate, multiply, normalize
from dqreg.rigid._jacobians import pure
from dqreg.rigid._operands import as_triples, as_unit_quaternions
from dqreg.rigid._powers import exp
from dqreg.rigid.rotations import left_jacobian_inverse

AngularVelocity = Callable[[float], ArrayLike]


def derivative(q: ArrayLike, omega: ArrayLike) -> FloatArray:
    """First derivative of a unit quaternion: omega q / 2 (eq. 22, theorem 3; also q omega_body / 2).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    omega : array_like, (..., 3)
        Angular velocities in world coordinates, radians per unit of time.

    Returns
    -------
    ndarray, (..., 4)
        dq/dt, perpendicular to q.

    Raises
    ------
    InputError
        If q is not of norm 1, or omega does not hold three numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> derivative([1, 0, 0, 0], [0, 0, 2]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return np.asarray(multiply(pure(omega, "omega"), as_unit_quaternions(q, "q")) / 2.0)


def second_derivative(q: ArrayLike, omega: ArrayLike, alpha: ArrayLike) -> FloatArray:
    """Second derivative of a unit quaternion: (-|omega|^2 / 4 + alpha / 2) q (eq. 28).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    omega : array_like, (..., 3)
        Angular velocities in world coordinates, radians per unit of time.
    alpha : array_like, (..., 3)
        Their derivatives, the angular accelerations.

    Returns
    -------
    ndarray, (..., 4)
        d2q/dt2.

    Raises
    ------
    InputError
        If q is not of norm 1, or omega or alpha does not hold three numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> second_derivative([1, 0, 0, 0], [0, 0, 2], [4, 0, 0]).tolist()
    [-1.0, 2.0, 0.0, 0.0]
    """
    array, rate = as_unit_quaternions(q, "q"), as_triples(omega, "omega")
    square = np.sum(rate * rate, axis=-1, keepdims=True)
    return np.asarray(multiply(pure(alpha, "alpha"), array) / 2.0 - square / 4.0 * array)


def angular_velocity(q: ArrayLike, q_dot: ArrayLike) -> FloatArray:
    """Angular velocity behind a derivative: 2 q_dot q* (eq. 27).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    q_dot : array_like, (..., 4)
        First derivatives; a part along q, which a unit quaternion cannot have, is left out.

    Returns
    -------
    ndarray, (..., 3)
        Angular velocities in world coordinates.

    Raises
    ------
    InputError
        If q is not of norm 1, or q_dot does not hold four numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> angular_velocity([1, 0, 0, 0], [0, 0, 0, 1]).tolist()
    [0.0, 0.0, 2.0]
    """
    return np.asarray(2.0 * multiply(q_dot, conjugate(as_unit_quaternions(q, "q")))[..., 1:])


def angular_acceleration(q: ArrayLike, q_dot: ArrayLike, q_ddot: ArrayLike) -> FloatArray:
    """Angular acceleration behind two derivatives: 2 (q_ddot q* - (q_dot q*)^2) (appendix B, after eq. 28).

    Parameters
    ----------
    q : array_like, (..., 4)
        Unit quaternions, scalar first.
    q_dot : array_like, (..., 4)
        First derivatives.
    q_ddot : array_like, (..., 4)
        Second derivatives.

    Returns
    -------
    ndarray, (..., 3)
        Angular accelerations in world coordinates.

    Raises
    ------
    InputError
        If q is not of norm 1, or a derivative does not hold four numbers in the last axis.
    ValueError
        If leading axes do not broadcast.

    Examples
    --------
    >>> angular_acceleration([1, 0, 0, 0], [0, 0, 0, 1], [-1, 2, 0, 0]).tolist()
    [4.0, 0.0, 0.0]
    """
    back = conjugate(as_unit_quaternions(q, "q"))
    half_rate = multiply(q_dot, back)
    return np.asarray(2.0 * (multiply(q_ddot, back) - multiply(half_rate, half_rate))[..., 1:])


def integrate(
    start: ArrayLike,
    omega: AngularVelocity | ArrayLike,
    times: ArrayLike,
    *,
    method: Literal["rk4", "euler"] = "rk4",
    frame: Literal["world", "body"] = "world",
) -> FloatArray:
    """Follow an angular velocity from a starting orientation: solve eq. 22 step by step.

    Parameters
    ----------
    start : array_like, (..., 4)
        Unit quaternion at the first time, scalar first; several are followed at once.
    omega : callable, or array_like, (n, ..., 3)
        Gives the angular velocity, (..., 3), at a time; or its samples at ``times``, as a gyroscope measures them.
        Between samples a cubic spline (not-a-knot) is followed, which keeps the method's order.
    times : array_like, (n,)
        Times in order, forwards or backwards; one step leads from each to the next.
    method : {"rk4", "euler"}
        ``"rk4"``: Munthe-Kaas' Runge-Kutta method of order 4, whose steps are rotations and stay on the unit
        sphere by themselves. ``"euler"``: the notes' step ``q + h omega q / 2``, normalised, of order 1.
    frame : {"world", "body"}
        In whose coordinates the velocity is given: ``q' = omega q / 2``, or ``q' = q omega / 2``, which is what a
        sensor on the body measures.

    Returns
    -------
    ndarray, (n, ..., 4)
        Unit quaternions at the times.

    Raises
    ------
    InputError
        If frame or method is no known word, there is no time, start is not of norm 1, omega does not hold three numbers
        in the last axis, or its samples are not one for each time, finite, at times that are finite and differ.

    Examples
    --------
    A quarter-turn about z in one step:

    >>> integrate([1, 0, 0, 0], lambda t: [0, 0, np.pi / 2], [0, 1])[-1].round(6).tolist()
    [0.707107, 0.0, 0.0, 0.707107]
    """
    if frame not in ("world", "body"):
        raise InputError(f'frame must be "world" or "body"; got {frame!r}')
    steps = {"rk4": _munthe_kaas_step, "euler": _euler_step}
    if method not in steps:
        raise InputError(f"method must be one of {sorted(steps)}; got {method!r}")
    moments = as_float(times, "times")
    if moments.ndim != 1 or moments.size == 0:
        raise InputError(f"times must be a row of at least one time; got shape {moments.shape}")
    rate: AngularVelocity = omega if callable(omega) else _spline(moments, omega)
    first = as_unit_quaternions(start, "start")
    if frame == "body":
        # The conjugate of q' = q omega / 2 is the world's equation for q*, with -omega.
        back, given = conjugate(first), rate
        rate = lambda t: -as_triples(given(t), "omega")  # noqa: E731
    path = [back if frame == "body" else first]
    for t, h in zip(moments[:-1], np.diff(moments), strict=True):
        path.append(steps[method](path[-1], rate, float(t), float(h)))
    # Several angular velocities make several orientations out of one start; the first entry must follow.
    found = np.stack(np.broadcast_arrays(*path))
    return conjugate(found) if frame == "body" else found


def _spline(times: FloatArray, samples: ArrayLike) -> AngularVelocity:
    """Angular velocity through samples (n, ..., 3) at times (n,)."""
    rates = as_triples(samples, "omega")
    if rates.ndim < 2 or len(rates) != len(times):
        raise InputError(f"omega must hold one sample for each of {len(times)} times; got shape {rates.shape}")
    require_finite(rates, "omega")
    if len(times) == 1:
        return lambda _: rates[0]
    order = np.argsort(times)
    if not np.all(np.diff(times[order]) > 0.0) or not np.isfinite(times).all():
        raise InputError("times of samples must be finite and differ")
    from scipy.interpolate import CubicSpline

    curve: AngularVelocity = CubicSpline(times[order], rates[order])
    return curve


def _euler_step(q: FloatArray, omega: AngularVelocity, t: float, h: float) -> FloatArray:
    return normalize(q + h / 2.0 * multiply(pure(omega(t), "omega"), q))


def _munthe_kaas_step(q: FloatArray, omega: AngularVelocity, t: float, h: float) -> FloatArray:
    # Write q(t + h) = exp(u / 2) q(t): the rotation vector u starts at zero and moves by u' = J(u)^-1 omega,
    # with the left Jacobian J. In these flat coordinates the classical method keeps its order.
    def rate(u: FloatArray, at: float) -> FloatArray:
        velocity = as_triples(omega(at), "omega")
        return np.asarray((left_jacobian_inverse(u) @ velocity[..., np.newaxis])[..., 0])

    k1 = rate(np.zeros(3), t)
    k2 = rate(h / 2.0 * k1, t + h / 2.0)
    k3 = rate(h / 2.0 * k2, t + h / 2.0)
    k4 = rate(h * k3, t + h)
    u = h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    # Products of unit quaternions drift by rounding only; normalising keeps that from adding up.
    return normalize(multiply(exp(pure(u / 2.0, "u")), q))
