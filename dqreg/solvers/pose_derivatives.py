"""Exact first and second derivatives of a quadratic form of the pose, by its motions.

`derivatives` are by left twists about the target origin of the form: ``T = about(exp(twist), origin) @ T0``.
`split_derivatives` are by a turn about any point and a shift after it: the same to first order, and cheaper to follow.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.solvers.quadratic import QuadraticForm

Slopes = tuple[FloatArray, FloatArray, FloatArray]

_GENERATORS = np.zeros((3, 3, 3))
for _k in range(3):
    _GENERATORS[_k] = np.cross(np.eye(3)[_k], np.eye(3)).T
_PRODUCTS = np.einsum("kia,lab->klib", _GENERATORS, _GENERATORS).reshape(9, 9)


def turn(w: FloatArray) -> FloatArray:
    """Rotation by a rotation vector, less the identity: what is small stays exact.

    Shapes: returns (3, 3).
    """
    # Plain numbers: the loop calls this once a step, and arrays of three would cost five times as much.
    x, y, z = w.tolist()
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    ratio = math.sin(half) / half if half > 0.0 else 1.0
    skew = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    change: FloatArray = ratio * math.cos(half) * skew + 0.5 * ratio * ratio * (skew @ skew)
    return change


def derivatives(form: QuadraticForm, T: FloatArray) -> Slopes:
    """Gradient and Hessian of the cost with respect to a left twist, at zero.

    From ``R' = (I + W + W^2/2) R`` and ``t' = (I + W + W^2/2) t + (I + W/2) v`` up to second order.

    Shapes: gradient (6,), hessian (6, 6), squares (6, 6).
    """
    y = form.coordinates(T)
    gradient, hessian, squares = split_derivatives(form, T[:3, :3], y, y[9:12])
    # exp(twist) carries the centre to v + w x v / 2, to second order.
    mixed = 0.5 * (_GENERATORS.transpose(0, 2, 1) @ gradient[3:])
    hessian[:3, 3:] += mixed
    hessian[3:, :3] += mixed.T
    return gradient, hessian, squares


def split_derivatives(form: QuadraticForm, R: FloatArray, y: FloatArray, arm: FloatArray) -> Slopes:
    """Gradient and Hessian for a turn about a point and a shift after it, at zero.

    ``R' = exp(w) R`` and ``t' = t + (exp(w) - I) arm + shift``, both along the target's axes.

    Shapes: R (3, 3), y (13,), gradient (6,), hessian (6, 6), squares (6, 6).
    """
    J = np.zeros((13, 6))
    J[:9, :3] = (_GENERATORS @ R).reshape(3, 9).T
    J[9:12, :3] = (_GENERATORS @ arm).T
    J[9:12, 3:] = np.eye(3)
    slope = 2.0 * form.matrix @ y
    squares = 2.0 * J.T @ form.matrix @ J
    hessian = squares.copy()
    # <slope, second derivative of y>: W_k W_l summed both ways, against (R, arm).
    pull = slope[:9].reshape(3, 3) @ R.T + np.outer(slope[9:12], arm)
    curved = (_PRODUCTS @ pull.ravel()).reshape(3, 3)
    hessian[:3, :3] += 0.5 * (curved + curved.T)
    return J.T @ slope, hessian, squares
