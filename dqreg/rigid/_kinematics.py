"""Unit quaternions that change with time, the angular velocity and acceleration behind them, and integration.

Equation numbers: Jia, *Quaternions* (2020), appendix B. The angular velocity is that of the body against the
world, in world coordinates; the notes' velocity in terms of the body frame is ``rotate_frame(q, omega)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.rigid._algebra import conjugate, multiply, normalize
from dqreg.rigid._operands import as_quaternions, as_triples, as_unit_quaternions
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

    Examples
    --------
    >>> derivative([1, 0, 0, 0], [0, 0, 2]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return np.asarray(multiply(_pure(omega, "omega"), as_unit_quaternions(q, "q")) / 2.0)


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

    Examples
    --------
    >>> second_derivative([1, 0, 0, 0], [0, 0, 2], [4, 0, 0]).tolist()
    [-1.0, 2.0, 0.0, 0.0]
    """
    array, rate = as_unit_quaternions(q, "q"), as_triples(omega, "omega")
    square = np.sum(rate * rate, axis=-1, keepdims=True)
    return np.asarray(multiply(_pure(alpha, "alpha"), array) / 2.0 - square / 4.0 * array)


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
    omega: AngularVelocity,
    times: ArrayLike,
    *,
    method: Literal["rk4", "euler"] = "rk4",
) -> FloatArray:
    """Follow an angular velocity from a starting orientation: solve eq. 22 step by step.

    Parameters
    ----------
    start : array_like, (..., 4)
        Unit quaternion at the first time, scalar first; several are followed at once.
    omega : callable
        Gives the angular velocity in world coordinates, (..., 3), at a time.
    times : array_like, (n,)
        Times in order, forwards or backwards; one step leads from each to the next.
    method : {"rk4", "euler"}
        ``"rk4"``: Munthe-Kaas' Runge-Kutta method of order 4, whose steps are rotations and stay on the unit
        sphere by themselves. ``"euler"``: the notes' step ``q + h omega q / 2``, normalised, of order 1.

    Returns
    -------
    ndarray, (n, ..., 4)
        Unit quaternions at the times.

    Examples
    --------
    A quarter-turn about z in one step:

    >>> integrate([1, 0, 0, 0], lambda t: [0, 0, np.pi / 2], [0, 1])[-1].round(6).tolist()
    [0.707107, 0.0, 0.0, 0.707107]
    """
    steps = {"rk4": _munthe_kaas_step, "euler": _euler_step}
    if method not in steps:
        raise InputError(f"method must be one of {sorted(steps)}; got {method!r}")
    moments = as_float(times, "times")
    if moments.ndim != 1 or moments.size == 0:
        raise InputError(f"times must be a row of at least one time; got shape {moments.shape}")
    path = [as_unit_quaternions(start, "start")]
    for t, h in zip(moments[:-1], np.diff(moments), strict=True):
        path.append(steps[method](path[-1], omega, float(t), float(h)))
    # Several angular velocities make several orientations out of one start; the first entry must follow.
    return np.stack(np.broadcast_arrays(*path))


def _euler_step(q: FloatArray, omega: AngularVelocity, t: float, h: float) -> FloatArray:
    return normalize(q + h / 2.0 * multiply(_pure(omega(t), "omega"), q))


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
    return normalize(multiply(exp(_pure(u / 2.0, "u")), q))


def _pure(v: ArrayLike, name: str) -> FloatArray:
    vectors = as_triples(v, name)
    return as_quaternions(np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1), name)
